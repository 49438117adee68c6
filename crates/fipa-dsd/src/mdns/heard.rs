//! What an announcement of another daemon says, without the types of `mdns-sd`.
use std::net::{IpAddr, Ipv6Addr, SocketAddr, SocketAddrV6};

use mdns_sd::{ResolvedService, ScopedIp};

use super::txt;
use crate::interface::is_loopback_index;

/// One announcement, as far as it is known by now.
#[derive(Clone, Debug)]
pub(super) struct Heard {
    /// The name of the service instance, under which its removal will be reported.
    pub(super) fullname: String,
    pub(super) id: Option<String>,
    pub(super) name: String,
    pub(super) scope: String,
    pub(super) version: String,
    /// The UDP port of QUIC.
    pub(super) quic: Option<u16>,
    /// The usable addresses, in no order.
    pub(super) addresses: Vec<SocketAddr>,
}

impl Heard {
    pub(super) fn new(service: &ResolvedService) -> Heard {
        let text = |key| service.get_property_val_str(key).map(str::to_owned);
        let addresses = service.get_addresses().iter();
        let addresses = addresses.filter(|_| service.get_port() != 0);
        Heard {
            fullname: service.get_fullname().to_owned(),
            id: text(txt::ID),
            name: text(txt::NAME).unwrap_or_default(),
            scope: text(txt::SCOPE).unwrap_or_default(),
            version: text(txt::VERSION).unwrap_or_default(),
            quic: text(txt::QUIC).and_then(|port| port.parse().ok()),
            addresses: addresses
                .filter_map(|ip| usable(ip, service.get_port()))
                .collect(),
        }
    }
}

/// The address as this host can use it.
///
/// A loopback address is that of the host where it was heard: heard on a loopback interface it is
/// ours, heard from elsewhere it would lead a connection astray to ourselves.
fn usable(ip: &ScopedIp, port: u16) -> Option<SocketAddr> {
    let plain = ip.to_ip_addr();
    if plain.is_unspecified() || plain.is_multicast() {
        return None;
    }
    if plain.is_loopback() && !heard_on(ip).into_iter().any(is_loopback_index) {
        return None;
    }
    match (plain, ip) {
        (IpAddr::V6(address), ScopedIp::V6(scoped)) if address.is_unicast_link_local() => {
            Some(on_link(address, port, scoped.scope_id().index))
        }
        _ => Some(SocketAddr::new(plain, port)),
    }
}

fn on_link(address: Ipv6Addr, port: u16, interface: u32) -> SocketAddr {
    SocketAddr::V6(SocketAddrV6::new(address, port, 0, interface))
}

/// The indexes of the interfaces on which the address was heard.
fn heard_on(ip: &ScopedIp) -> Vec<u32> {
    match ip {
        ScopedIp::V4(v4) => v4
            .interface_ids()
            .iter()
            .map(|interface| interface.index)
            .collect(),
        ScopedIp::V6(v6) => vec![v6.scope_id().index],
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use if_addrs::Interface;

    use super::*;

    /// The address as if heard on `interface`.
    fn heard(ip: &str, interface: &Interface) -> ScopedIp {
        let mut carrier = interface.clone();
        carrier.addr = match ip.parse().unwrap() {
            IpAddr::V4(ip) => if_addrs::IfAddr::V4(if_addrs::Ifv4Addr {
                ip,
                netmask: std::net::Ipv4Addr::UNSPECIFIED,
                prefixlen: 0,
                broadcast: None,
            }),
            IpAddr::V6(ip) => if_addrs::IfAddr::V6(if_addrs::Ifv6Addr {
                ip,
                netmask: Ipv6Addr::UNSPECIFIED,
                prefixlen: 0,
                broadcast: None,
            }),
        };
        ScopedIp::from(&carrier)
    }

    fn loopback() -> Option<Interface> {
        if_addrs::get_if_addrs()
            .ok()?
            .into_iter()
            .find(Interface::is_loopback)
    }

    #[test]
    fn loopback_addresses_count_only_where_heard_on_loopback() {
        let Some(lo) = loopback() else {
            println!("skipped: needs a loopback interface");
            return;
        };
        let mut elsewhere = lo.clone();
        elsewhere.index = Some(u32::MAX);
        for ip in ["127.0.0.1", "::1"] {
            assert!(usable(&heard(ip, &lo), 7000).is_some(), "{ip}");
            assert_eq!(usable(&heard(ip, &elsewhere), 7000), None, "{ip}");
        }
        let address = usable(&heard("10.0.0.1", &elsewhere), 7000).unwrap();
        assert_eq!(address.to_string(), "10.0.0.1:7000");
    }

    #[test]
    fn link_local_addresses_carry_their_interface() {
        let Some(mut interface) = loopback() else {
            println!("skipped: needs a loopback interface");
            return;
        };
        interface.index = Some(4);
        let address = usable(&heard("fe80::1", &interface), 7000).unwrap();
        assert_eq!(address.to_string(), "[fe80::1%4]:7000");
        let address = usable(&heard("fd00::1", &interface), 7000).unwrap();
        assert_eq!(address.to_string(), "[fd00::1]:7000");
    }

    #[test]
    fn addresses_of_nobody_are_dropped() {
        for ip in ["0.0.0.0", "224.0.0.251", "::", "ff02::fb"] {
            let ip = ScopedIp::from(ip.parse::<IpAddr>().unwrap());
            assert_eq!(usable(&ip, 7000), None);
        }
    }
}
