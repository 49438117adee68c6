//! What is known of another message transport service, and the table of all of them.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now, Source, State};

use super::dialling::Dialling;
use super::numbers::Numbers;
use super::waiting::Waiting;
use crate::machine::ConnId;

/// Platforms that are known, by instance and by name.
#[derive(Debug, Default)]
pub(super) struct Peers {
    peers: BTreeMap<InstanceId, Box<Peer>>,
    names: HashMap<Text, BTreeSet<InstanceId>>,
    /// Numbers of peers that are forgotten, to be given again.
    free: Vec<u32>,
}

impl Peers {
    pub(super) fn get(&self, instance: InstanceId) -> Option<&Peer> {
        self.peers.get(&instance).map(Box::as_ref)
    }

    pub(super) fn get_mut(&mut self, instance: InstanceId) -> Option<&mut Peer> {
        self.peers.get_mut(&instance).map(Box::as_mut)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (InstanceId, &Peer)> {
        let peers = self.peers.iter();
        peers.map(|(instance, peer)| (*instance, peer.as_ref()))
    }

    pub(super) fn values_mut(&mut self) -> impl Iterator<Item = &mut Peer> {
        self.peers.values_mut().map(Box::as_mut)
    }

    /// The peer; a new one if it is not known yet.
    pub(super) fn meet(&mut self, instance: InstanceId, name: &Text) -> &mut Peer {
        let peers = self.peers.len();
        self.peers.entry(instance).or_insert_with(|| {
            self.names.entry(name.clone()).or_default().insert(instance);
            // All numbers below that of the known ones are theirs, or free.
            let number = self.free.pop();
            let number = number.unwrap_or_else(|| u32::try_from(peers).unwrap_or(u32::MAX));
            Box::new(Peer::new(name.clone(), number))
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
        for other in self.peers.values_mut() {
            other.forget_number(peer.number);
        }
        self.free.push(peer.number);
        Some(*peer)
    }

    /// Forgets who has told whom of this peer, and what it has told itself. Whether that was
    /// anything.
    pub(super) fn unsay(&mut self, instance: InstanceId) -> bool {
        let Some(peer) = self.peers.get_mut(&instance) else {
            return false;
        };
        peer.knows.clear();
        let (number, told) = (peer.number, std::mem::take(&mut peer.tells));
        for other in self.peers.values_mut() {
            other.forget_number(number);
        }
        !told.is_empty()
    }

    /// How many are known from others only.
    pub(super) fn only_told(&self) -> usize {
        let told = self.peers.values().filter(|peer| peer.is_only_told());
        told.count()
    }

    /// Those that bear this name.
    pub(super) fn named(&self, name: &Text) -> impl Iterator<Item = (InstanceId, &Peer)> {
        let instances = self.names.get(name).into_iter().flatten();
        instances.filter_map(|instance| Some((*instance, self.peers.get(instance)?.as_ref())))
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
    /// Its number in sets of peers, while it is known.
    pub(super) number: u32,
    /// Peers of which it need not be told.
    pub(super) knows: Numbers,
    /// Peers with which it has links, and of which it can tell everybody.
    pub(super) tells: Numbers,
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
    fn new(name: Text, number: u32) -> Peer {
        Peer {
            name,
            identity: None,
            discovered: None,
            told: Vec::new(),
            sought_until: Duration::ZERO,
            number,
            knows: Numbers::default(),
            tells: Numbers::default(),
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

    fn forget_number(&mut self, number: u32) {
        self.knows.remove(number);
        self.tells.remove(number);
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
