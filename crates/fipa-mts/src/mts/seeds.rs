//! Addresses that are dialled until somebody is met there: those of the operator, for ever, and
//! those that a letter's receiver brings along, while letters wait.

use std::collections::{BTreeMap, HashMap};
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now};
use fipa_link::Outcome;

use super::deliveries::Target;
use super::dialling::{Dialling, Purpose};
use super::{Mts, Timer};

/// Seeds, by number and by address.
#[derive(Debug, Default)]
pub(super) struct Seeds {
    seeds: BTreeMap<u64, Seed>,
    addresses: HashMap<Vec<Address>, u64>,
}

impl Seeds {
    pub(super) fn get(&self, id: u64) -> Option<&Seed> {
        self.seeds.get(&id)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Seed> {
        self.seeds.values()
    }

    pub(super) fn get_mut(&mut self, id: u64) -> Option<&mut Seed> {
        self.seeds.get_mut(&id)
    }

    fn at(&self, addresses: &[Address]) -> Option<u64> {
        self.addresses.get(addresses).copied()
    }

    fn insert(&mut self, id: u64, seed: Seed) {
        self.addresses.insert(seed.addresses.clone(), id);
        self.seeds.insert(id, seed);
    }

    pub(super) fn remove(&mut self, id: u64) {
        if let Some(seed) = self.seeds.remove(&id)
            && self.at(&seed.addresses) == Some(id)
        {
            self.addresses.remove(&seed.addresses);
        }
    }
}

/// An address to dial until we know who is there.
#[derive(Debug)]
pub(super) struct Seed {
    pub(super) addresses: Vec<Address>,
    /// Given by the operator: dialled for ever. Otherwise only while letters wait.
    pub(super) kept: bool,
    /// Who was found there.
    pub(super) instance: Option<InstanceId>,
    /// It is our own address.
    pub(super) myself: bool,
    pub(super) dialling: Dialling,
    pub(super) last_error: String,
    waiting: Vec<u64>,
    /// Until when letters go there as a service of another make takes them: it was reached, and
    /// did not greet.
    mute_until: Option<Duration>,
}

/// How long an address is remembered where nobody greeted; then it is tried again as a link.
const MUTE: Duration = Duration::from_secs(600);

/// Letters that wait for one address at most.
const MAX_WAITING: usize = 1000;

impl Mts {
    /// Adds the address of a peer that is dialled for ever, whoever answers there.
    pub fn add_peer(&mut self, now: Now, address: Address) {
        let seed = self.new_seed(vec![address], true);
        self.dial_seed(now, seed);
    }

    pub(super) fn new_seed(&mut self, addresses: Vec<Address>, kept: bool) -> u64 {
        let id = self.id();
        self.seeds.insert(
            id,
            Seed {
                addresses,
                kept,
                instance: None,
                myself: false,
                dialling: Dialling::default(),
                last_error: "it has not been reached yet".to_owned(),
                waiting: Vec::new(),
                mute_until: None,
            },
        );
        id
    }

    /// The seed for a receiver that brings its addresses along.
    pub(super) fn seed_for(&mut self, now: Now, addresses: Vec<Address>) -> u64 {
        match self.seeds.at(&addresses) {
            Some(id) => id,
            None => {
                let id = self.new_seed(addresses, false);
                self.dial_seed(now, id);
                id
            }
        }
    }

    pub(super) fn queue_for_seed(&mut self, now: Now, id: u64, delivery: u64) {
        let Some(seed) = self.seeds.get_mut(id) else {
            return;
        };
        if seed.mute_until.is_some() {
            self.post_instead(now, delivery);
            return;
        }
        match seed.instance {
            Some(instance) => self.retarget(now, delivery, instance),
            None if seed.myself => self.nobody_here(now, delivery),
            None if seed.waiting.len() >= MAX_WAITING => {
                let reason = Text::from_static("the queue of its address is full");
                self.not_taken(now, delivery, Outcome::Refused, reason);
            }
            None => {
                seed.waiting.push(delivery);
                if seed.dialling.is_idle() {
                    self.dial_seed(now, id);
                }
            }
        }
    }

    pub(super) fn retarget(&mut self, now: Now, id: u64, instance: InstanceId) {
        if let Some(delivery) = self.deliveries.get_mut(&id) {
            delivery.target = Target::Peer(instance);
            self.queue_for_peer(now, instance, id);
        }
    }

    pub(super) fn dial_seed(&mut self, now: Now, id: u64) {
        let Some(seed) = self.seeds.get_mut(id) else {
            return;
        };
        if seed.mute_until.is_some()
            || seed.dialling.under_way
            || seed.myself
            || seed.instance.is_some()
            || self.closing
        {
            return;
        }
        seed.dialling.under_way = true;
        seed.dialling.again = None;
        let addresses = seed.addresses.clone();
        self.dial(now, Purpose::Seed(id), addresses);
    }

    pub(super) fn seed_timeout(&mut self, now: Now, id: u64) {
        let Some(seed) = self.seeds.get_mut(id) else {
            return;
        };
        seed.waiting
            .retain(|delivery| self.deliveries.contains_key(delivery));
        if seed.mute_until.is_some_and(|until| now.mono < until) {
            return;
        }
        if !seed.kept && seed.waiting.is_empty() && seed.instance.is_none() {
            self.seeds.remove(id);
            return;
        }
        if seed.dialling.again.is_some_and(|at| now.mono >= at) {
            self.dial_seed(now, id);
        }
    }

    /// Whether the seed is there for letters only, whoever listens there.
    pub(super) fn is_given_with_letter(&self, id: u64) -> bool {
        self.seeds.get(id).is_some_and(|seed| !seed.kept)
    }

    /// Somebody took the connection and did not greet: letters go there as to a service of another
    /// make, the next ones at once.
    pub(super) fn seed_is_mute(&mut self, now: Now, id: u64) {
        let Some(seed) = self.seeds.get_mut(id) else {
            return;
        };
        let until = now.mono + MUTE;
        seed.dialling = Dialling::default();
        seed.mute_until = Some(until);
        let waiting = std::mem::take(&mut seed.waiting);
        self.timer(until, Timer::Seed(id));
        for delivery in waiting {
            self.post_instead(now, delivery);
        }
    }

    fn post_instead(&mut self, now: Now, id: u64) {
        if let Some(delivery) = self.deliveries.get_mut(&id) {
            delivery.target = Target::Post;
            self.post(now, id);
        }
    }

    pub(super) fn seed_met(&mut self, now: Now, id: u64, instance: InstanceId) {
        let Some(seed) = self.seeds.get_mut(id) else {
            return;
        };
        seed.instance = Some(instance);
        seed.dialling = Dialling::default();
        if let Some(peer) = self.peers.get_mut(instance) {
            peer.seeds.insert(id);
        }
        for delivery in std::mem::take(&mut seed.waiting) {
            self.retarget(now, delivery, instance);
        }
    }

    pub(super) fn seed_is_myself(&mut self, now: Now, purpose: Option<Purpose>) {
        if let Some(Purpose::Seed(id)) = purpose
            && let Some(seed) = self.seeds.get_mut(id)
        {
            seed.myself = true;
            for delivery in std::mem::take(&mut seed.waiting) {
                self.nobody_here(now, delivery);
            }
        }
    }

    /// A letter whose address turned out to be our own, where nobody has the receiver's name.
    pub(super) fn nobody_here(&mut self, now: Now, delivery: u64) {
        let here = &self.config.name;
        let reason = Text::from(format!("no agent of this name is known at {here}"));
        self.finish(now, delivery, Outcome::Unknown, reason);
    }

    /// Who was found at the seed is gone: it is dialled again, or forgotten.
    pub(super) fn seed_lost(&mut self, now: Now, id: u64) {
        let Some(seed) = self.seeds.get_mut(id) else {
            return;
        };
        seed.instance = None;
        if seed.kept {
            self.dial_seed(now, id);
        } else {
            self.seeds.remove(id);
        }
    }

    pub(super) fn seed_error(&self, id: u64) -> String {
        match self.seeds.get(id) {
            Some(seed) => format!("it could not be reached in time: {}", seed.last_error),
            None => "it could not be reached in time".to_owned(),
        }
    }
}
