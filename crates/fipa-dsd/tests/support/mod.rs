//! Network namespaces and processes for tests with real mDNS.
pub(crate) mod namespace;
pub(crate) mod peer;

use std::time::Duration;

use fipa_dsd::{DiscoveredPeer, DiscoveryEvent, Mdns, MdnsConfig};

/// The instance id that belongs to a small number.
pub(crate) fn id(n: u8) -> fipa_directory::InstanceId {
    fipa_directory::InstanceId::from_bytes([n; 16])
}

/// The configuration of daemon `n`, named `robot <n>`, of the scope `plant`.
pub(crate) fn config(n: u8, endpoints: &[&str]) -> MdnsConfig {
    MdnsConfig {
        instance: id(n),
        name: format!("robot {n}"),
        scope: "plant".to_owned(),
        endpoints: endpoints
            .iter()
            .map(|endpoint| endpoint.parse().unwrap())
            .collect(),
        interfaces: Vec::new(),
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
