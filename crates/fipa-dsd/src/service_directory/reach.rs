//! Which locations of an agent are told to C++ neighbours.
use std::net::{IpAddr, Ipv4Addr};

use fipa_directory::{Address, Location, MESSAGE_TRANSPORT};

/// The addresses of this host, as others can use them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Reach {
    /// What stands for `0.0.0.0` and `::`.
    pub(crate) hosts: Vec<IpAddr>,
    /// Whether only this host listens.
    pub(crate) loopback: bool,
}

impl Reach {
    /// The addresses of IPv4.
    pub(crate) fn ipv4(&self) -> Vec<Ipv4Addr> {
        let ipv4 = self.hosts.iter().filter_map(|host| match host {
            IpAddr::V4(address) => Some(*address),
            IpAddr::V6(_) => None,
        });
        ipv4.collect()
    }

    /// The locations of an agent as others can use them, in the order in which `fipa_services` is
    /// to try them: TCP over IPv4, then other TCP, then UDT, with which it may be built, then the
    /// rest under signatures that it passes over.
    pub(crate) fn locations(&self, locations: &[Location]) -> Vec<Location> {
        let mut ranked: Vec<(u8, Location)> = Vec::new();
        for location in locations {
            let Some((scheme, authority)) = location.address.split_once("://") else {
                continue;
            };
            let (tcp, udt) = (scheme == "tcp", scheme == "udt");
            let ours = location.signature == MESSAGE_TRANSPORT;
            let signature = match ours && !tcp && !udt {
                true => format!("fipa.{scheme}").into(),
                false => location.signature.clone(),
            };
            for (host, address) in self.addresses(scheme, authority) {
                let rank = match (tcp, host) {
                    (true, Some(IpAddr::V4(_))) => 0,
                    (true, _) => 1,
                    (false, _) if udt => 2,
                    (false, _) => 3,
                };
                let signature = signature.clone();
                let address = address.into();
                let location = Location { address, signature };
                if !ranked.iter().any(|(_, known)| *known == location) {
                    ranked.push((rank, location));
                }
            }
        }
        ranked.sort_by_key(|(rank, _)| *rank);
        ranked.into_iter().map(|(_, location)| location).collect()
    }

    /// The addresses that one address stands for, each with its host if that is an IP address.
    fn addresses(&self, scheme: &str, authority: &str) -> Vec<(Option<IpAddr>, String)> {
        if scheme == "unix" {
            return Vec::new();
        }
        let whole = || format!("{scheme}://{authority}");
        // Other schemes may have more than a host and a port, which then stays as it is.
        let Ok(Address::Tcp { host, port }) = format!("tcp://{authority}").parse() else {
            return vec![(None, whole())];
        };
        let Ok(ip) = host.parse::<IpAddr>() else {
            let local = host == "localhost" && !self.loopback;
            // An interface is named by an address of the link, which others cannot use.
            let unusable = local || host.contains('%');
            return (!unusable).then(|| (None, whole())).into_iter().collect();
        };
        let hosts = self.hosts.iter().copied();
        let hosts: Vec<IpAddr> = match ip.is_unspecified() {
            true => hosts.filter(|h| h.is_ipv4() == ip.is_ipv4()).collect(),
            false => vec![ip],
        };
        let usable = |ip: &IpAddr| match ip {
            IpAddr::V6(v6) if v6.is_unicast_link_local() => false,
            ip => self.loopback || !ip.is_loopback(),
        };
        let address = |ip: IpAddr| match ip {
            IpAddr::V4(_) => (Some(ip), format!("{scheme}://{ip}:{port}")),
            IpAddr::V6(_) => (Some(ip), format!("{scheme}://[{ip}]:{port}")),
        };
        hosts.into_iter().filter(usable).map(address).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reach(hosts: &[&str]) -> Reach {
        let hosts: Vec<IpAddr> = hosts.iter().map(|host| host.parse().unwrap()).collect();
        let loopback = hosts.iter().all(IpAddr::is_loopback);
        Reach { hosts, loopback }
    }

    fn told(reach: &Reach, addresses: &[&str]) -> Vec<String> {
        let locations = addresses.iter().map(|address| Location {
            address: (*address).into(),
            signature: MESSAGE_TRANSPORT.into(),
        });
        let locations = reach.locations(&locations.collect::<Vec<_>>());
        let shown = locations.iter();
        shown
            .map(|l| format!("{} {}", l.address, l.signature))
            .map(|shown| shown.replace(MESSAGE_TRANSPORT, "MT"))
            .collect()
    }

    #[test]
    fn ipv4_comes_first_and_other_transports_last_under_their_own_signature() {
        let addresses = [
            "quic://10.0.0.1:1",
            "udt://10.0.0.1:5",
            "http://robot:80/acc",
            "tcp://[fd00::1]:2",
            "tcp://robot.local:3",
            "tcp://10.0.0.1:4",
        ];
        let expected = [
            "tcp://10.0.0.1:4 MT",
            "tcp://[fd00::1]:2 MT",
            "tcp://robot.local:3 MT",
            "udt://10.0.0.1:5 MT",
            "quic://10.0.0.1:1 fipa.quic",
            "http://robot:80/acc fipa.http",
        ];
        assert_eq!(told(&reach(&["10.0.0.1"]), &addresses), expected);
    }

    #[test]
    fn a_wildcard_stands_for_the_addresses_of_its_family() {
        let reach = reach(&["10.0.0.1", "192.168.0.1", "fd00::1", "fe80::1"]);
        let expected = [
            "tcp://10.0.0.1:1 MT",
            "tcp://192.168.0.1:1 MT",
            "tcp://[fd00::1]:1 MT",
        ];
        let addresses = ["tcp://[::]:1", "tcp://0.0.0.0:1", "tcp://10.0.0.1:1"];
        assert_eq!(told(&reach, &addresses), expected);
    }

    #[test]
    fn what_only_this_host_can_use_is_told_to_this_host_only() {
        let here = [
            "tcp://127.0.0.1:1",
            "tcp://[::1]:1",
            "tcp://localhost:1",
            "unix:///run/fipad.sock",
            "tcp://[fe80::1]:1",
            "tcp://[fe80::1%2]:1",
        ];
        assert_eq!(told(&reach(&["10.0.0.1"]), &here), [""; 0]);
        let expected = [
            "tcp://127.0.0.1:1 MT",
            "tcp://[::1]:1 MT",
            "tcp://localhost:1 MT",
        ];
        assert_eq!(told(&reach(&["127.0.0.1", "::1"]), &here), expected);
    }
}
