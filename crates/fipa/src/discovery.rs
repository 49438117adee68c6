//! mDNS and the platform: what is found is handed to the message transport service.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, Change};
use fipa_dsd::{DiscoveredPeer, DiscoveryEvent, Mdns, MdnsConfig, MdnsError};
use fipa_mts::{Announced, Mts};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use crate::announcing::Announcing;
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
    /// Whether mDNS was begun and does not know our agents yet.
    fresh: bool,
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
            fresh: mdns.is_some(),
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

    /// mDNS, if it is spoken and does not know our agents yet.
    fn fresh(&mut self) -> Option<&mut Mdns> {
        let fresh = std::mem::take(&mut self.fresh);
        self.mdns.as_mut().filter(|_| fresh)
    }

    /// The next event; `None` when mDNS was begun anew. Cancel-safe.
    async fn next(&mut self) -> Option<DiscoveryEvent> {
        loop {
            if let Some(event) = self.early.pop_front() {
                return Some(event);
            }
            match &mut self.mdns {
                Some(mdns) => match mdns.next().await {
                    Some(event) => return Some(event),
                    None => {
                        tracing::warn!("mDNS has ended, and is begun anew");
                        self.mdns = None;
                    }
                },
                None => {
                    tokio::time::sleep(self.pause).await;
                    self.start_again();
                    if self.fresh {
                        return None;
                    }
                }
            }
        }
    }

    fn start_again(&mut self) {
        match Mdns::start(self.config.clone()) {
            Ok(mdns) => {
                tracing::info!("mDNS is spoken now");
                self.mdns = Some(mdns);
                self.fresh = true;
                self.pause = FIRST_PAUSE;
            }
            Err(error) => {
                tracing::debug!("mDNS is not spoken yet: {error}");
                self.pause = (self.pause * 2).min(LONGEST_PAUSE);
            }
        }
    }
}

/// Keeps the service told of who is there, and the network of our agents, until the sender says
/// goodbye.
pub(crate) fn run(
    node: &Arc<Node<Mts>>,
    discovery: Discovery,
    lock: Option<NameLock>,
) -> (oneshot::Sender<()>, JoinHandle<()>) {
    let (goodbye, until) = oneshot::channel();
    let (verify, changes) = node.with(|_, _, hub| (hub.verifications(), hub.changes()));
    let listener = Listener {
        node: Arc::clone(node),
        discovery,
        announcing: Announcing::default(),
    };
    let task = tokio::spawn(async move {
        listener.listen(verify, changes, until).await;
        drop(lock);
    });
    (goodbye, task)
}

/// What stands between mDNS and the service.
struct Listener {
    node: Arc<Node<Mts>>,
    discovery: Discovery,
    announcing: Announcing,
}

impl Listener {
    async fn listen(
        mut self,
        mut verify: mpsc::UnboundedReceiver<Announced>,
        mut changes: mpsc::UnboundedReceiver<Change>,
        mut until: oneshot::Receiver<()>,
    ) {
        loop {
            if let Some(mdns) = self.discovery.fresh() {
                self.announcing.begin(&self.node, mdns);
            }
            tokio::select! {
                event = self.discovery.next() => {
                    event.into_iter().for_each(|event| hand_over(&self.node, event));
                }
                Some(announced) = verify.recv() => self.verify(announced),
                Some(change) = changes.recv() => {
                    if let Some(mdns) = &mut self.discovery.mdns {
                        self.announcing.follow(&self.node, mdns, change);
                    }
                }
                _ = &mut until => break,
            }
        }
        self.discovery.shutdown().await;
    }

    /// Asks the network whether something is still there.
    fn verify(&mut self, announced: Announced) {
        let Some(mdns) = &mut self.discovery.mdns else {
            return;
        };
        let asked = match &announced {
            Announced::Platform(instance) => mdns.verify(*instance),
            Announced::Agent(name) => mdns.verify_agent(name),
        };
        match (asked, announced) {
            // Its goodbye is still to be handed over, or mDNS was begun anew without hearing it.
            (Err(MdnsError::UnknownAgent(_)), Announced::Agent(name)) => {
                self.node.with(|now, mts, _| mts.neighbour_gone(now, &name));
            }
            (Err(error), _) => tracing::debug!("mDNS does not verify: {error}"),
            (Ok(()), _) => {}
        }
    }
}

fn hand_over(node: &Arc<Node<Mts>>, event: DiscoveryEvent) {
    match event {
        DiscoveryEvent::Found(DiscoveredPeer {
            instance,
            name,
            addresses,
            quic,
        }) => {
            let host = |a: &std::net::SocketAddr| {
                // A link-local address needs its interface, which the text of it carries.
                match a {
                    std::net::SocketAddr::V6(v6) if v6.scope_id() != 0 => {
                        format!("{}%{}", v6.ip(), v6.scope_id())
                    }
                    other => other.ip().to_string(),
                }
            };
            let tcp = addresses.iter().map(|a| Address::tcp(host(a), a.port()));
            let quic = quic.into_iter().flat_map(|port| {
                let at = addresses.iter();
                at.map(move |a| Address::quic(host(a), port))
            });
            let addresses = tcp.chain(quic).collect();
            let name = Text::from(name);
            node.with(|now, mts, _| mts.discovered(now, instance, name, addresses));
        }
        DiscoveryEvent::Lost(instance) => {
            node.with(|now, mts, _| mts.undiscovered(now, instance));
        }
        // The agents of a daemon of ours come over the link with it.
        DiscoveryEvent::AgentFound(agent) if agent.instance.is_none() => {
            node.with(|now, mts, _| mts.neighbour_found(now, agent.entry));
        }
        DiscoveryEvent::AgentGone {
            name,
            instance: None,
        } => node.with(|now, mts, _| mts.neighbour_gone(now, &name)),
        DiscoveryEvent::AgentFound(_) | DiscoveryEvent::AgentGone { .. } => {}
        DiscoveryEvent::Warning(warning) => tracing::warn!("mDNS: {warning}"),
    }
}
