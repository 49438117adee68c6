//! mDNS and the platform: what is found is handed to the message transport service.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::Address;
use fipa_dsd::{DiscoveredPeer, DiscoveryEvent, Mdns, MdnsConfig, MdnsError};
use fipa_mts::{Announced, Mts};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use crate::names::NameLock;
use crate::node::Node;

/// How long the network is asked whether a default name is taken.
const NAME_PATIENCE: Duration = Duration::from_millis(300);

/// The pause before mDNS that could not be spoken is tried again; each further one is twice as
/// long, up to the longest.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// mDNS, with what was heard before anybody listened.
///
/// An interface may come up after the platform, as a radio does that is not associated yet: mDNS
/// that cannot be spoken is tried again.
pub(crate) struct Discovery {
    config: MdnsConfig,
    mdns: Option<Mdns>,
    pause: Duration,
    early: VecDeque<DiscoveryEvent>,
}

impl Discovery {
    /// Begins to speak. An interface that was asked for by name must be there at once.
    pub(crate) fn start(config: MdnsConfig) -> Result<Discovery, MdnsError> {
        let mdns = match Mdns::start(config.clone()) {
            Ok(mdns) => Some(mdns),
            Err(error) if config.interfaces.is_empty() => {
                tracing::warn!("mDNS is not spoken yet: {error}");
                None
            }
            Err(error) => return Err(error),
        };
        Ok(Discovery {
            config,
            mdns,
            pause: FIRST_PAUSE,
            early: VecDeque::new(),
        })
    }

    /// Whether another platform of this name is heard.
    pub(crate) async fn is_name_taken(&mut self, name: &str) -> bool {
        let Some(mdns) = &mut self.mdns else {
            return false;
        };
        let listen = async {
            while let Some(event) = mdns.next().await {
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
        if let Some(mdns) = self.mdns {
            mdns.shutdown().await;
        }
    }

    /// The next event. Cancel-safe.
    async fn next(&mut self) -> DiscoveryEvent {
        loop {
            if let Some(event) = self.early.pop_front() {
                return event;
            }
            match &mut self.mdns {
                Some(mdns) => match mdns.next().await {
                    Some(event) => return event,
                    None => {
                        tracing::warn!("mDNS has ended, and is begun anew");
                        self.mdns = None;
                    }
                },
                None => {
                    tokio::time::sleep(self.pause).await;
                    self.start_again();
                }
            }
        }
    }

    fn start_again(&mut self) {
        match Mdns::start(self.config.clone()) {
            Ok(mdns) => {
                tracing::info!("mDNS is spoken now");
                self.mdns = Some(mdns);
                self.pause = FIRST_PAUSE;
            }
            Err(error) => {
                tracing::debug!("mDNS is not spoken yet: {error}");
                self.pause = (self.pause * 2).min(LONGEST_PAUSE);
            }
        }
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
    mut verify: mpsc::UnboundedReceiver<Announced>,
    mut until: oneshot::Receiver<()>,
) {
    loop {
        tokio::select! {
            event = discovery.next() => hand_over(&node, event),
            Some(announced) = verify.recv() => {
                // Of other agents than platforms mDNS tells nothing, so there is nothing to ask.
                if let Announced::Platform(instance) = announced
                    && let Some(Err(error)) =
                        discovery.mdns.as_ref().map(|mdns| mdns.verify(instance))
                {
                    tracing::debug!("mDNS does not verify: {error}");
                }
            }
            _ = &mut until => break,
        }
    }
    discovery.shutdown().await;
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
