//! What is known of another message transport service, and the table of all of them.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now, Source, State};

use super::dialling::Dialling;
use super::waiting::Waiting;
use crate::machine::ConnId;

/// Platforms that are known, by instance and by name.
#[derive(Debug, Default)]
pub(super) struct Peers {
    peers: BTreeMap<InstanceId, Peer>,
    names: HashMap<Text, BTreeSet<InstanceId>>,
}

impl Peers {
    pub(super) fn get(&self, instance: InstanceId) -> Option<&Peer> {
        self.peers.get(&instance)
    }

    pub(super) fn get_mut(&mut self, instance: InstanceId) -> Option<&mut Peer> {
        self.peers.get_mut(&instance)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (InstanceId, &Peer)> {
        self.peers.iter().map(|(instance, peer)| (*instance, peer))
    }

    pub(super) fn values_mut(&mut self) -> impl Iterator<Item = &mut Peer> {
        self.peers.values_mut()
    }

    /// The peer; a new one if it is not known yet.
    pub(super) fn meet(&mut self, instance: InstanceId, name: &Text) -> &mut Peer {
        self.peers.entry(instance).or_insert_with(|| {
            self.names.entry(name.clone()).or_default().insert(instance);
            Peer::new(name.clone())
        })
    }

    /// The peer, under the name that it gives itself.
    pub(super) fn meet_as(&mut self, instance: InstanceId, name: &Text) -> &mut Peer {
        let known = self.peers.get(&instance).map(|peer| peer.name.clone());
        if let Some(known) = known.filter(|known| known != name) {
            self.unname(instance, &known);
            self.names.entry(name.clone()).or_default().insert(instance);
        }
        let peer = self.meet(instance, name);
        peer.name = name.clone();
        peer
    }

    pub(super) fn remove(&mut self, instance: InstanceId) -> Option<Peer> {
        let peer = self.peers.remove(&instance)?;
        self.unname(instance, &peer.name);
        Some(peer)
    }

    /// Those that bear this name.
    pub(super) fn named(&self, name: &Text) -> impl Iterator<Item = (InstanceId, &Peer)> {
        let instances = self.names.get(name).into_iter().flatten();
        instances.filter_map(|instance| Some((*instance, self.peers.get(instance)?)))
    }

    fn unname(&mut self, instance: InstanceId, name: &Text) {
        if let Some(instances) = self.names.get_mut(name) {
            instances.remove(&instance);
            if instances.is_empty() {
                self.names.remove(name);
            }
        }
    }
}

/// Another message transport service.
#[derive(Debug)]
pub(super) struct Peer {
    pub(super) name: Text,
    /// The robot whose certificate it has shown.
    pub(super) identity: Option<Text>,
    /// Where mDNS says it is; `None` when mDNS does not know it.
    pub(super) discovered: Option<Vec<Address>>,
    /// Where others say it is.
    pub(super) told: Vec<Address>,
    /// Until when it is dialled though mDNS does not know it.
    pub(super) sought_until: Duration,
    /// Platforms of which it need not be told.
    pub(super) knows: BTreeSet<InstanceId>,
    /// Where it was reached, or says it is.
    pub(super) known: Vec<Address>,
    /// Seeds at which it was met.
    pub(super) seeds: BTreeSet<u64>,
    pub(super) links: Vec<ConnId>,
    pub(super) dialling: Dialling,
    pub(super) state: State,
    pub(super) down_since: Option<Duration>,
    pub(super) last_error: String,
    /// Deliveries that wait for a link.
    pub(super) waiting: Waiting,
    /// The version of its entries that we hold.
    pub(super) version: Option<u64>,
}
impl Peer {
    fn new(name: Text) -> Peer {
        Peer {
            name,
            identity: None,
            discovered: None,
            told: Vec::new(),
            sought_until: Duration::ZERO,
            knows: BTreeSet::new(),
            known: Vec::new(),
            seeds: BTreeSet::new(),
            links: Vec::new(),
            dialling: Dialling::default(),
            state: State::Alive,
            down_since: None,
            last_error: "it has not been reached yet".to_owned(),
            waiting: Waiting::default(),
            version: None,
        }
    }

    /// How its agents came to be known.
    pub(super) fn source(&self) -> Source {
        match self.discovered {
            Some(_) => Source::Mdns,
            None => Source::Peer,
        }
    }

    /// Where to dial, best first.
    pub(super) fn addresses(&self) -> Vec<Address> {
        let mut addresses = self.known.clone();
        for address in self.discovered.iter().flatten().chain(&self.told) {
            if !addresses.contains(address) {
                addresses.push(address.clone());
            }
        }
        addresses
    }

    /// Whether nothing is known of it but what others have told.
    pub(super) fn is_only_told(&self) -> bool {
        self.discovered.is_none() && self.known.is_empty() && self.links.is_empty()
    }

    /// Whether it was linked, and is gone.
    pub(super) fn is_lost(&self) -> bool {
        self.state == State::Gone && self.discovered.is_none()
    }

    /// Whether it is to be dialled though it is not there.
    pub(super) fn is_sought(&self, now: Now) -> bool {
        self.discovered.is_some() || now.mono < self.sought_until
    }
}
