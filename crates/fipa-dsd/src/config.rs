use std::fmt;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::str::FromStr;

use fipa_directory::InstanceId;

/// The UDP port of multicast DNS.
pub const MDNS_PORT: u16 = 5353;

/// A UDP port at which nobody speaks now, for daemons that want to be undisturbed by others.
pub fn free_mdns_port() -> io::Result<u16> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    Ok(socket.local_addr()?.port())
}

/// What a daemon announces of itself, and where it looks for others.
#[derive(Clone, Debug)]
pub struct MdnsConfig {
    /// The identity of this run of the daemon; others know it by this id alone.
    pub instance: InstanceId,
    /// The name of the daemon, for people. It is cut where it does not fit (250 bytes).
    pub name: String,
    /// Only daemons of the same scope find each other; at most 249 bytes.
    ///
    /// C++ robots call the DNS-SD service type of their directory the scope. Without a scope the
    /// agents of the daemon are announced under the type that they use by themselves,
    /// `_fipa_service_directory._udp`. The scope `plant` means `_plant._udp`, which is then the
    /// scope of the C++ robots of that fleet; a scope that is a type (`_plant._udp`, `_plant._tcp`)
    /// is taken by its word. Capital letters are small ones there. A scope that makes no type, for
    /// being longer than 30 letters, say, keeps the daemon from C++ robots altogether.
    pub scope: String,
    /// The TCP endpoints the daemon listens on. `0.0.0.0` stands for every IPv4 address of the
    /// chosen interfaces and `::` for every IPv6 address: a socket that serves both families is
    /// given as both.
    ///
    /// One port is announced: that of the first endpoint that is not on loopback, or else of the
    /// first one. Endpoints with another port are not announced.
    pub endpoints: Vec<SocketAddr>,
    /// The UDP port at which QUIC is spoken at the same addresses, if it is.
    pub quic: Option<u16>,
    /// Where mDNS is spoken. Empty means: on loopback only while all endpoints are loopback
    /// addresses, else on loopback and on the interfaces that hold a listening address.
    /// Interfaces that are down or point-to-point are never used.
    pub interfaces: Vec<InterfaceSelector>,
    /// How many agents are announced to C++ robots at most; the usual number is
    /// [`DEFAULT_AGENTS`](crate::DEFAULT_AGENTS), 0 announces none.
    pub agents: usize,
    /// The UDP port, [`MDNS_PORT`] unless a test or a demonstration wants to be undisturbed.
    pub port: u16,
}

/// A choice of network interfaces.
///
/// As text: an interface name (`wlan0`), a network (`10.0.0.0/8`, `fe80::/10`) or a single
/// address, which is the network that holds only this address.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum InterfaceSelector {
    /// The interface of this name, with all its addresses.
    Name(String),
    /// Every interface address within this network; the other addresses of the same interface are
    /// not used.
    Network {
        /// Any address of the network.
        address: IpAddr,
        /// How many leading bits of the address make up the network: at most 32 for IPv4, 128 for
        /// IPv6. A greater number selects nothing.
        prefix: u8,
    },
}

impl fmt::Display for InterfaceSelector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            InterfaceSelector::Name(name) => f.write_str(name),
            InterfaceSelector::Network { address, prefix } => write!(f, "{address}/{prefix}"),
        }
    }
}

/// The text is neither an interface name nor a network.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is neither an interface name nor a network such as 10.0.0.0/8")]
pub struct ParseSelectorError(String);

impl FromStr for InterfaceSelector {
    type Err = ParseSelectorError;

    fn from_str(text: &str) -> Result<InterfaceSelector, ParseSelectorError> {
        let wrong = || ParseSelectorError(text.to_owned());
        if let Some((address, prefix)) = text.split_once('/') {
            let address: IpAddr = address.parse().map_err(|_| wrong())?;
            let prefix = prefix.parse().map_err(|_| wrong())?;
            if prefix > bits(address) {
                return Err(wrong());
            }
            return Ok(InterfaceSelector::Network { address, prefix });
        }
        if let Ok(address) = text.parse::<IpAddr>() {
            return Ok(InterfaceSelector::Network {
                address,
                prefix: bits(address),
            });
        }
        if text.is_empty() || text.contains(|c: char| c.is_whitespace() || c == ',') {
            return Err(wrong());
        }
        Ok(InterfaceSelector::Name(text.to_owned()))
    }
}

fn bits(address: IpAddr) -> u8 {
    if address.is_ipv4() { 32 } else { 128 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selectors_are_names_networks_or_addresses() {
        let name = InterfaceSelector::Name("wlan0".into());
        assert_eq!("wlan0".parse(), Ok(name));
        for (text, shown) in [
            ("10.0.0.0/8", "10.0.0.0/8"),
            ("fe80::/10", "fe80::/10"),
            ("10.1.2.3", "10.1.2.3/32"),
            ("::1", "::1/128"),
            ("0.0.0.0/0", "0.0.0.0/0"),
        ] {
            let selector: InterfaceSelector = text.parse().unwrap();
            assert!(
                matches!(selector, InterfaceSelector::Network { .. }),
                "{text}"
            );
            assert_eq!(selector.to_string(), shown);
        }
    }

    #[test]
    fn nonsense_is_refused() {
        for text in [
            "",
            "10.0.0.0/33",
            "::/129",
            "10.0.0/8",
            "wlan0/8",
            "a b",
            "10.0.0.0/x",
        ] {
            assert!(text.parse::<InterfaceSelector>().is_err(), "{text:?}");
        }
    }
}
