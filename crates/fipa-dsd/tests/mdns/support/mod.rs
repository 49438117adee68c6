//! Network namespaces and processes for tests with real mDNS.
pub(crate) mod cpp;
pub(crate) mod namespace;
pub(crate) mod peer;

use std::time::Duration;

use fipa_directory::{Entry, Location, MESSAGE_TRANSPORT};
use fipa_dsd::{DiscoveredPeer, DiscoveryEvent, Mdns, MdnsConfig};

use namespace::{Namespace, isolated};
use peer::Peer;

/// Runs `body` in a namespace that has only loopback, with a runtime.
pub(crate) fn on_loopback<F: Future<Output = ()>>(test: &str, body: impl FnOnce() -> F) {
    isolated(test, || {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .enable_all()
            .build()
            .unwrap();
        runtime.block_on(body());
    });
}

/// Two namespaces joined by a cable, with the addresses 10.77.0.1 and 10.77.0.2.
pub(crate) fn two_hosts() -> (Namespace, Namespace) {
    let (a, b) = (Namespace::new(), Namespace::new());
    a.connect("cable", &b, "cable");
    a.ip("addr add 10.77.0.1/24 dev cable");
    b.ip("addr add 10.77.0.2/24 dev cable");
    (a, b)
}

/// Daemon `n` in a process of its own.
pub(crate) fn peer(namespace: &Namespace, n: u8, endpoints: &str) -> Peer {
    Peer::start(namespace, "peer_process", n, endpoints)
}

/// The entry of an agent on loopback.
pub(crate) fn agent(name: &str) -> Entry {
    let mut entry = Entry::new(name);
    entry.locations = vec![Location {
        address: "tcp://127.0.0.1:7001".into(),
        signature: MESSAGE_TRANSPORT.into(),
    }];
    entry
}

/// The instance id that belongs to a small number.
pub(crate) fn id(n: u8) -> fipa_directory::InstanceId {
    fipa_directory::InstanceId::from_bytes([n; 16])
}

/// The configuration of daemon `n`, named `robot <n>`, without a scope.
pub(crate) fn config(n: u8, endpoints: &[&str]) -> MdnsConfig {
    MdnsConfig {
        instance: id(n),
        name: format!("robot {n}"),
        scope: String::new(),
        endpoints: endpoints
            .iter()
            .map(|endpoint| endpoint.parse().unwrap())
            .collect(),
        quic: None,
        interfaces: Vec::new(),
        agents: fipa_dsd::DEFAULT_AGENTS,
        port: 5353,
    }
}

/// The next report of a peer, which must come `within` that time.
pub(crate) async fn found(mdns: &mut Mdns, within: Duration) -> DiscoveredPeer {
    match event(mdns, within).await {
        Some(DiscoveryEvent::Found(peer)) => peer,
        other => panic!("no peer found, but {other:?}"),
    }
}

/// The next event, if one comes `within` that time.
pub(crate) async fn event(mdns: &mut Mdns, within: Duration) -> Option<DiscoveryEvent> {
    let next = tokio::time::timeout(within, mdns.next()).await.ok()?;
    Some(next.expect("mDNS runs"))
}
