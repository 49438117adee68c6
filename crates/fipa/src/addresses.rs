//! Where a platform is reached: the addresses of the machine's interfaces, as they come and go.

use std::net::{IpAddr, SocketAddr};
use std::slice::from_ref;
use std::sync::Arc;
use std::time::Duration;

use fipa_directory::Address;
use fipa_mts::Mts;

use crate::node::Node;

/// How often the interfaces are looked at.
const LOOK: Duration = Duration::from_secs(2);

pub(crate) fn socket_address(address: &Address) -> Option<SocketAddr> {
    match address {
        Address::Tcp { host, port }
        | Address::Quic { host, port }
        | Address::Other { host, port, .. } => Some(SocketAddr::new(host.parse().ok()?, *port)),
        Address::Http { host, port, .. } => Some(SocketAddr::new(host.parse().ok()?, *port)),
        Address::Unix(_) => None,
    }
}

/// Where bound endpoints are reached, with every address of the machine in place of the
/// unspecified one.
pub(crate) fn reached_at(bound: &[Address]) -> Vec<Address> {
    let mut endpoints = Vec::new();
    for address in bound.iter().flat_map(concrete) {
        if !endpoints.contains(&address) {
            endpoints.push(address);
        }
    }
    endpoints
}

/// Tells others when the machine's addresses change, as when a robot joins another network. While
/// it has none for others it is not told to forget those that it had.
///
/// `http` is where letters are posted to it, as long as that is not told otherwise.
pub(crate) async fn follow(
    node: Arc<Node<Mts>>,
    bound: Option<Vec<Address>>,
    http: Option<Address>,
) {
    let bound = bound.filter(|bound| bound.iter().any(is_unspecified));
    let http = http.filter(is_unspecified);
    while bound.is_some() || http.is_some() {
        tokio::time::sleep(LOOK).await;
        node.with(|now, mts, _| {
            let known = &mts.config().endpoints;
            if let Some(endpoints) = bound.as_deref().and_then(|bound| changed(known, bound)) {
                mts.set_endpoints(now, endpoints);
            }
            let known = &mts.config().http;
            if let Some(urls) = http.as_ref().and_then(|url| changed(known, from_ref(url))) {
                mts.set_http(urls);
            }
        });
    }
}

/// Where bound endpoints are reached now, if that is news.
fn changed(known: &[Address], bound: &[Address]) -> Option<Vec<Address>> {
    let endpoints = reached_at(bound);
    let for_others = |all: &[Address]| all.iter().any(Address::is_for_others);
    let is_news = known != endpoints && (for_others(&endpoints) || !for_others(known));
    is_news.then_some(endpoints)
}

fn is_unspecified(address: &Address) -> bool {
    socket_address(address).is_some_and(|bound| bound.ip().is_unspecified())
}

/// The addresses at which a bound endpoint is reached.
fn concrete(address: &Address) -> Vec<Address> {
    let Some(bound) = socket_address(address).filter(|bound| bound.ip().is_unspecified()) else {
        return vec![address.clone()];
    };
    let mut found: Vec<IpAddr> = match if_addrs::get_if_addrs() {
        Ok(interfaces) => interfaces.iter().map(if_addrs::Interface::ip).collect(),
        Err(_) => Vec::new(),
    };
    // An IPv6 link-local address means something only together with an interface of the reader.
    found.retain(|ip| match ip {
        IpAddr::V4(_) => bound.is_ipv4(),
        IpAddr::V6(ip) => bound.is_ipv6() && !ip.is_unicast_link_local(),
    });
    found.sort_by_key(|ip| (ip.is_loopback(), *ip));
    found
        .into_iter()
        .map(|ip| match address {
            Address::Http { path, .. } => Address::http(ip.to_string(), bound.port(), path),
            Address::Quic { .. } => Address::quic(ip.to_string(), bound.port()),
            Address::Other { scheme, .. } => Address::Other {
                scheme: scheme.clone(),
                host: ip.to_string(),
                port: bound.port(),
            },
            _ => Address::tcp(ip.to_string(), bound.port()),
        })
        .collect()
}
