//! On which interfaces mDNS is spoken, and which of their addresses are announced.
use std::collections::{BTreeMap, HashSet};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use if_addrs::Interface;

use crate::service_directory::reach::Reach;
use crate::{InterfaceSelector, MdnsConfig, MdnsError};

/// The rule for interfaces, asked again whenever the interfaces of the host have changed.
#[derive(Clone, Debug)]
pub(crate) struct Rule {
    spoken: Spoken,
    /// The endpoints with the announced port.
    announced: Vec<SocketAddr>,
}

#[derive(Clone, Debug)]
enum Spoken {
    Loopback,
    LoopbackAnd(HashSet<String>),
    Everywhere,
    Selected(Vec<InterfaceSelector>),
}

/// Where mDNS is listened to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Post {
    /// An address of the interface.
    pub(crate) address: Ipv4Addr,
    /// Tells it from a later interface with the same address.
    pub(crate) index: Option<u32>,
    /// Whether only this host can be heard there.
    pub(crate) on_loopback: bool,
}

impl Rule {
    /// The rule that `config` asks for, on a host with these interfaces.
    pub(crate) fn new(config: &MdnsConfig, interfaces: &[Interface]) -> Result<Rule, MdnsError> {
        let endpoints: Vec<_> = config.endpoints.iter().copied().map(canonical).collect();
        if let Some(endpoint) = endpoints.iter().find(|endpoint| endpoint.port() == 0) {
            return Err(MdnsError::EndpointWithoutPort(*endpoint));
        }
        let outer = endpoints
            .iter()
            .find(|endpoint| !endpoint.ip().is_loopback());
        let port = outer
            .or(endpoints.first())
            .ok_or(MdnsError::NoEndpoint)?
            .port();
        let spoken = if config.interfaces.is_empty() {
            default_choice(&endpoints, interfaces)
        } else {
            selected(&config.interfaces, interfaces)?
        };
        let announced = endpoints
            .into_iter()
            .filter(|endpoint| endpoint.port() == port)
            .collect();
        Ok(Rule { spoken, announced })
    }

    /// The TCP port that is announced.
    pub(crate) fn port(&self) -> u16 {
        self.announced[0].port()
    }

    /// The addresses that were named one by one. Not all of them need be the address of an
    /// interface: one may listen on any of 127.0.0.0/8.
    pub(crate) fn explicit_addresses(&self) -> Vec<IpAddr> {
        let addresses = self.announced.iter().map(SocketAddr::ip);
        addresses
            .filter(|address| !address.is_unspecified())
            .collect()
    }

    /// Whether the daemon listens on IPv4 (`true`) or IPv6 (`false`).
    pub(crate) fn listens_on(&self, ipv4: bool) -> bool {
        self.announced
            .iter()
            .any(|endpoint| endpoint.is_ipv4() == ipv4)
    }

    /// Whether mDNS is spoken from this interface address.
    pub(crate) fn speaks_on(&self, interface: &Interface) -> bool {
        match &self.spoken {
            Spoken::Loopback => interface.is_loopback(),
            Spoken::LoopbackAnd(names) => {
                interface.is_loopback() || names.contains(&interface.name)
            }
            Spoken::Everywhere => true,
            Spoken::Selected(selectors) => selectors.iter().any(|s| matches(s, interface)),
        }
    }

    /// The addresses that may be told to all who hear mDNS from here. Those of loopback are told
    /// only while mDNS is spoken nowhere else, because everybody is told the same.
    pub(crate) fn reach(&self, interfaces: &[Interface]) -> Reach {
        let spoken = interfaces.iter().filter(|i| self.speaks_on(i));
        let (loopback, outer): (Vec<_>, Vec<_>) = spoken.partition(|i| i.is_loopback());
        let alone = outer.is_empty();
        let chosen = if alone { loopback } else { outer };
        let mut hosts: Vec<_> = chosen.iter().map(|interface| interface.ip()).collect();
        hosts.sort();
        Reach {
            hosts,
            loopback: alone,
        }
    }

    /// A place of every interface on which mDNS is spoken over IPv4.
    pub(crate) fn listening_posts(&self, interfaces: &[Interface]) -> Vec<Post> {
        let mut posts: BTreeMap<&str, Post> = BTreeMap::new();
        for interface in interfaces.iter().filter(|i| self.speaks_on(i)) {
            if let IpAddr::V4(address) = interface.ip() {
                posts.entry(&interface.name).or_insert(Post {
                    address,
                    index: interface.index,
                    on_loopback: interface.is_loopback(),
                });
            }
        }
        posts.into_values().collect()
    }

    /// Whether this interface address is announced: one that is not listened on must not be.
    pub(crate) fn announces(&self, interface: &Interface) -> bool {
        self.speaks_on(interface) && self.announced.iter().any(|e| listens_at(e, interface))
    }
}

/// The addresses of this host on which mDNS can be spoken: those of interfaces that are up and not
/// point-to-point.
pub(crate) fn usable_interfaces() -> Result<Vec<Interface>, MdnsError> {
    let all = if_addrs::get_if_addrs().map_err(MdnsError::Interfaces)?;
    Ok(all
        .into_iter()
        .filter(|i| i.is_oper_up() && !i.is_p2p())
        .collect())
}

/// The interfaces as they are told to people: `lo (127.0.0.1, ::1), wlan0 (10.0.0.7)`.
pub(crate) fn describe(interfaces: &[Interface]) -> String {
    let mut by_name: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for interface in interfaces {
        by_name
            .entry(&interface.name)
            .or_default()
            .push(interface.ip().to_string());
    }
    let shown = by_name
        .iter()
        .map(|(name, ips)| format!("{name} ({})", ips.join(", ")));
    let shown: Vec<_> = shown.collect();
    if shown.is_empty() {
        "none".to_owned()
    } else {
        shown.join(", ")
    }
}

/// Whether the interface with this index is a loopback interface, as far as the system tells.
pub(crate) fn is_loopback_index(index: u32) -> bool {
    let all = if_addrs::get_if_addrs().unwrap_or_default();
    all.iter()
        .any(|interface| interface.index == Some(index) && interface.is_loopback())
}

/// An IPv4 address written as IPv6 is compared as what it is.
fn canonical(endpoint: SocketAddr) -> SocketAddr {
    match endpoint.ip().to_canonical() {
        ip if ip == endpoint.ip() => endpoint,
        ip => SocketAddr::new(ip, endpoint.port()),
    }
}

fn default_choice(endpoints: &[SocketAddr], interfaces: &[Interface]) -> Spoken {
    if endpoints.iter().all(|endpoint| endpoint.ip().is_loopback()) {
        return Spoken::Loopback;
    }
    if endpoints
        .iter()
        .any(|endpoint| endpoint.ip().is_unspecified())
    {
        return Spoken::Everywhere;
    }
    let holders = interfaces
        .iter()
        .filter(|i| endpoints.iter().any(|e| listens_at(e, i)));
    Spoken::LoopbackAnd(holders.map(|interface| interface.name.clone()).collect())
}

fn selected(
    selectors: &[InterfaceSelector],
    interfaces: &[Interface],
) -> Result<Spoken, MdnsError> {
    let unmatched = selectors
        .iter()
        .find(|s| !interfaces.iter().any(|i| matches(s, i)));
    match unmatched {
        None => Ok(Spoken::Selected(selectors.to_vec())),
        Some(selector) => Err(MdnsError::NoInterface {
            selector: selector.clone(),
            available: describe(interfaces),
        }),
    }
}

fn matches(selector: &InterfaceSelector, interface: &Interface) -> bool {
    match selector {
        InterfaceSelector::Name(name) => *name == interface.name,
        InterfaceSelector::Network { address, prefix } => within(interface.ip(), *address, *prefix),
    }
}

fn within(ip: IpAddr, network: IpAddr, prefix: u8) -> bool {
    let prefix = u32::from(prefix);
    match (ip, network) {
        // Shifting by all bits is no shift at all: a prefix of 0 contains everything.
        (IpAddr::V4(ip), IpAddr::V4(network)) if prefix <= 32 => {
            let differing = u32::from(ip) ^ u32::from(network);
            differing.checked_shr(32 - prefix).unwrap_or(0) == 0
        }
        (IpAddr::V6(ip), IpAddr::V6(network)) if prefix <= 128 => {
            let differing = u128::from(ip) ^ u128::from(network);
            differing.checked_shr(128 - prefix).unwrap_or(0) == 0
        }
        _ => false,
    }
}

fn listens_at(endpoint: &SocketAddr, interface: &Interface) -> bool {
    let ip = interface.ip();
    if endpoint.ip().is_unspecified() {
        return endpoint.is_ipv4() == ip.is_ipv4();
    }
    // The same link-local address may be on several interfaces: the scope id tells which is meant.
    let same_link = match endpoint {
        SocketAddr::V6(v6) => v6.scope_id() == 0 || interface.index == Some(v6.scope_id()),
        SocketAddr::V4(_) => true,
    };
    endpoint.ip() == ip && same_link
}

#[cfg(test)]
mod tests;
