//! mDNS and the platform: what is found is handed to the message transport service.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId};
use fipa_dsd::{DiscoveredPeer, DiscoveryEvent, Mdns, MdnsConfig, MdnsError};
use fipa_mts::Mts;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use crate::names::NameLock;
use crate::node::Node;

/// How long the network is asked whether a default name is taken.
const NAME_PATIENCE: Duration = Duration::from_millis(300);

/// mDNS as it is spoken, with what was heard before anybody listened.
pub(crate) struct Discovery {
    mdns: Mdns,
    early: VecDeque<DiscoveryEvent>,
}

impl Discovery {
    pub(crate) fn start(config: MdnsConfig) -> Result<Discovery, MdnsError> {
        Ok(Discovery {
            mdns: Mdns::start(config)?,
            early: VecDeque::new(),
        })
    }

    /// Whether another platform of this name is heard.
    pub(crate) async fn is_name_taken(&mut self, name: &str) -> bool {
        let listen = async {
            while let Some(event) = self.mdns.next().await {
                let taken = matches!(&event, DiscoveryEvent::Found(peer) if peer.name == name);
                self.early.push_back(event);
                if taken {
                    return true;
                }
            }
            false
        };
        tokio::time::timeout(NAME_PATIENCE, listen)
            .await
            .unwrap_or(false)
    }

    pub(crate) async fn shutdown(self) {
        self.mdns.shutdown().await;
    }
}

/// Keeps the service told of who is there, until the sender says goodbye.
pub(crate) fn run(
    node: &Arc<Node<Mts>>,
    discovery: Discovery,
    lock: Option<NameLock>,
) -> (oneshot::Sender<()>, JoinHandle<()>) {
    let (goodbye, until) = oneshot::channel();
    let verify = node.with(|_, _, hub| hub.verifications());
    let node = Arc::clone(node);
    let task = tokio::spawn(async move {
        listen(node, discovery, verify, until).await;
        drop(lock);
    });
    (goodbye, task)
}

async fn listen(
    node: Arc<Node<Mts>>,
    mut discovery: Discovery,
    mut verify: mpsc::UnboundedReceiver<InstanceId>,
    mut until: oneshot::Receiver<()>,
) {
    while let Some(event) = discovery.early.pop_front() {
        hand_over(&node, event);
    }
    loop {
        tokio::select! {
            event = discovery.mdns.next() => match event {
                Some(event) => hand_over(&node, event),
                None => {
                    tracing::warn!("mDNS has ended: platforms that appear now are not found by it");
                    return;
                }
            },
            Some(instance) = verify.recv() => {
                if let Err(error) = discovery.mdns.verify(instance) {
                    tracing::debug!("mDNS does not verify: {error}");
                }
            }
            _ = &mut until => break,
        }
    }
    discovery.mdns.shutdown().await;
}

fn hand_over(node: &Arc<Node<Mts>>, event: DiscoveryEvent) {
    match event {
        DiscoveryEvent::Found(DiscoveredPeer {
            instance,
            name,
            addresses,
        }) => {
            let address = |a: &std::net::SocketAddr| {
                // A link-local address needs its interface, which the text of it carries.
                let host = match a {
                    std::net::SocketAddr::V6(v6) if v6.scope_id() != 0 => {
                        format!("{}%{}", v6.ip(), v6.scope_id())
                    }
                    other => other.ip().to_string(),
                };
                Address::tcp(host, a.port())
            };
            let addresses = addresses.iter().map(address).collect();
            let name = Text::from(name);
            node.with(|now, mts, _| mts.discovered(now, instance, name, addresses));
        }
        DiscoveryEvent::Lost(instance) => {
            node.with(|now, mts, _| mts.undiscovered(now, instance));
        }
        DiscoveryEvent::Warning(warning) => tracing::warn!("mDNS: {warning}"),
    }
}
