//! Gossip: services tell each other whom they have links with, so that one address of one of them
//! is enough to find all.
//!
//! Only what the speaker knows first-hand is told, once, and again every half an hour. So a
//! platform that is dead is told of by nobody, and one that is told of is dialled, not believed:
//! its agents are known when it has said itself who they are.
//!
//! Where all have links with all, each could tell each of each: a billion times among a thousand.
//! So who knows that a third one, whose id is smaller, has links with two platforms leaves it to that
//! one to tell them of each other. The one with the smallest id leaves nothing to anybody. When all is
//! told again, some are told by everybody, so that nobody who keeps what it knows to itself keeps
//! others apart.

use std::collections::VecDeque;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now, State};
use fipa_link::{Frame, KnownPlatform};

use super::numbers::Numbers;
use super::peers::SOUGHT;
use super::{Mts, Timer};
use crate::machine::ConnId;

/// The pause from a new link to the telling of it, and what each link of the speaker adds to it: a
/// newcomer, who has few, tells first, and what it tells the others need not tell.
const PAUSE: Duration = Duration::from_millis(100);
const PAUSE_A_LINK: Duration = Duration::from_millis(10);

/// The pause after which everything is told again to everybody.
const AGAIN: Duration = Duration::from_secs(1800);

/// Platforms in one frame.
const IN_A_FRAME: usize = 256;

/// How many of the others are told everything then, about, whoever else may tell them.
const TOLD_BY_ALL: usize = 30;

/// Platforms that are dialled because others told of them, at most; and how many at once. Those
/// beyond wait for some seconds, and are dialled less often.
const MAX_TOLD: usize = 1024;
pub(super) const TOLD_AT_ONCE: usize = 256;
const TURN: Duration = Duration::from_secs(1);

/// Addresses of one platform that are heeded.
const MAX_ADDRESSES: usize = 16;

/// Platforms that are remembered to have said goodbye.
const MAX_DEPARTED: usize = 256;

/// When to tell, and of whom not to listen.
#[derive(Debug, Default)]
pub(super) struct Gossip {
    due: Option<Duration>,
    again: Option<Duration>,
    /// Runs that are over: what is still said of them is late.
    departed: VecDeque<InstanceId>,
}

impl Gossip {
    pub(super) fn departed(&mut self, instance: InstanceId) {
        self.departed.push_back(instance);
        if self.departed.len() > MAX_DEPARTED {
            self.departed.pop_front();
        }
    }

    pub(super) fn has_departed(&self, instance: InstanceId) -> bool {
        self.departed.contains(&instance)
    }
}

impl Mts {
    /// There is a link to a peer that had none: it and the others are told of each other.
    pub(super) fn tell_platforms_soon(&mut self, now: Now) {
        let random = self.random.f64();
        if self.gossip.due.is_none() {
            let linked = self.peers.iter().filter(|(_, peer)| !peer.links.is_empty());
            let links = u32::try_from(linked.count()).unwrap_or(u32::MAX);
            let pause = PAUSE + PAUSE_A_LINK.saturating_mul(links);
            let due = now.mono + pause.mul_f64(1.0 + random / 2.0);
            self.gossip.due = Some(due);
            self.timer(due, Timer::Gossip);
        }
        if self.gossip.again.is_none() {
            self.tell_again_later(now, random);
        }
    }

    /// The last link to a peer broke. What was said of it, or left to it to say, counts no more.
    pub(super) fn unsay_platform(&mut self, now: Now, instance: InstanceId) {
        if self.peers.unsay(instance) {
            self.tell_platforms_soon(now);
        }
    }

    fn tell_again_later(&mut self, now: Now, random: f64) {
        let again = now.mono + AGAIN.mul_f64(1.0 + random / 2.0);
        self.gossip.again = Some(again);
        self.timer(again, Timer::Gossip);
    }

    pub(super) fn gossip_timeout(&mut self, now: Now) {
        let is_due = |due: Option<Duration>| due.is_some_and(|due| due <= now.mono);
        let again = is_due(self.gossip.again);
        if again {
            for peer in self.peers.values_mut() {
                peer.knows.clear();
            }
            let random = self.random.f64();
            self.tell_again_later(now, random);
        }
        if again || is_due(self.gossip.due) {
            self.gossip.due = None;
            self.tell_platforms(now, again);
        }
    }

    /// Tells every peer of those others that it does not know yet.
    fn tell_platforms(&mut self, now: Now, again: bool) {
        let linked: Vec<Linked> = self
            .peers
            .iter()
            .filter(|(_, peer)| peer.state == State::Alive)
            .filter_map(|(instance, peer)| {
                let (number, conn) = (peer.number, *peer.links.first()?);
                Some(Linked {
                    instance,
                    number,
                    conn,
                })
            })
            .collect();
        let mut all = Numbers::default();
        linked.iter().for_each(|peer| all.insert(peer.number));
        for listener in &linked {
            let by_all = again && self.random.usize(..linked.len()) < TOLD_BY_ALL;
            let mut missing = self.unknown_to(&all, listener);
            if !by_all {
                self.leave_to_others(&linked, listener, &mut missing);
            }
            if missing.is_empty() {
                continue;
            }
            let others = linked.iter().filter(|peer| missing.contains(peer.number));
            let (numbers, news): (Vec<u32>, Vec<KnownPlatform>) = others
                .filter_map(|peer| Some((peer.number, self.news(now, listener.conn, peer)?)))
                .unzip();
            if let Some(peer) = self.peers.get_mut(listener.instance) {
                numbers.iter().for_each(|number| peer.knows.insert(*number));
            }
            for part in news.chunks(IN_A_FRAME) {
                self.send(now, listener.conn, Frame::Platforms(part.to_vec()));
            }
        }
    }

    /// Those of all peers of which a listener does not know.
    fn unknown_to(&self, all: &Numbers, listener: &Linked) -> Numbers {
        let mut missing = all.clone();
        missing.remove(listener.number);
        if let Some(peer) = self.peers.get(listener.instance) {
            missing.subtract(&peer.knows);
        }
        missing
    }

    /// Takes out those of whom somebody else is to tell a listener.
    fn leave_to_others(&self, linked: &[Linked], listener: &Linked, missing: &mut Numbers) {
        let smaller = |peer: &&Linked| peer.instance < self.config.instance;
        for peer in linked.iter().take_while(smaller) {
            if missing.is_empty() {
                return;
            }
            if let Some(peer) = self.peers.get(peer.instance)
                && peer.tells.contains(listener.number)
            {
                missing.subtract(&peer.tells);
            }
        }
    }

    /// What the partner on a connection is to be told of another peer.
    fn news(&self, now: Now, conn: ConnId, of: &Linked) -> Option<KnownPlatform> {
        let peer = self.peers.get(of.instance)?;
        let addresses = self.addresses_for(conn, &peer.known);
        let heard = self.conns.get(&of.conn)?.link.last_heard();
        let age = now.mono.saturating_sub(heard).as_millis();
        (!addresses.is_empty()).then(|| KnownPlatform {
            instance: of.instance,
            name: peer.name.clone(),
            scope: self.config.scope.clone(),
            addresses,
            age_millis: u64::try_from(age).unwrap_or(u64::MAX),
        })
    }

    /// Those of some addresses that the partner on a connection may be told.
    fn addresses_for(&self, conn: ConnId, addresses: &[Address]) -> Vec<Text> {
        let same_host = self.conns.get(&conn).is_some_and(|open| open.same_host);
        let links = addresses.iter().filter(|address| address.is_link());
        let told = links.filter(|a| same_host || a.is_for_others());
        told.map(Address::to_text).collect()
    }

    /// Tells every peer where we are reached now.
    pub(super) fn tell_own_place(&mut self, now: Now) {
        let links: Vec<ConnId> = self
            .peers
            .iter()
            .filter_map(|(_, peer)| peer.links.first().copied())
            .collect();
        for conn in links {
            let own = KnownPlatform {
                instance: self.config.instance,
                name: self.config.name.clone(),
                scope: self.config.scope.clone(),
                addresses: self.addresses_for(conn, &self.config.endpoints),
                age_millis: 0,
            };
            self.send(now, conn, Frame::Platforms(vec![own]));
        }
    }

    /// A peer tells of others, or of its own new place.
    pub(super) fn hear_platforms(
        &mut self,
        now: Now,
        conn: ConnId,
        teller: InstanceId,
        platforms: Vec<KnownPlatform>,
    ) {
        let same_host = self.conns.get(&conn).is_some_and(|open| open.same_host);
        let mut told = None;
        for platform in platforms {
            let readable = |address: &Text| address.parse().ok();
            let addresses = || platform.addresses.iter().filter_map(readable);
            let for_all = || addresses().any(|address: Address| address.is_for_others());
            let instance = platform.instance;
            if platform.scope != self.config.scope || instance == self.config.instance {
                continue;
            }
            let known = self.peers.get(instance);
            if instance != teller && known.is_some_and(|peer| !peer.links.is_empty()) {
                self.both_know(teller, instance, for_all());
                continue;
            }
            let is_new = known.is_none();
            let usable = |address: &Address| same_host || address.is_for_others();
            let usable: Vec<Address> = addresses().filter(usable).take(MAX_ADDRESSES).collect();
            if instance == teller {
                if let Some(peer) = self.peers.get_mut(teller)
                    && !usable.is_empty()
                {
                    peer.known = usable;
                }
                continue;
            }
            let told = told.get_or_insert_with(|| self.peers.only_told());
            let left = SOUGHT.saturating_sub(Duration::from_millis(platform.age_millis));
            let gone = left.is_zero() || self.gossip.has_departed(instance);
            let has_room = !is_new || *told < MAX_TOLD;
            if !gone && !usable.is_empty() && has_room {
                *told += usize::from(is_new);
                self.peers.meet(instance, &platform.name).told = usable;
                self.seek_until(now.mono + left, instance);
                let turn = TURN * (*told / (TOLD_AT_ONCE + 1)) as u32;
                self.dial_found_peer(now, instance, turn);
            }
            self.both_know(teller, instance, for_all());
        }
    }

    /// Who has a link with another knows it, and is known; and tells of it where its address is of use
    /// to all.
    fn both_know(&mut self, teller: InstanceId, told: InstanceId, for_all: bool) {
        let number_of = |instance| self.peers.get(instance).map(|peer| peer.number);
        let (Some(one), Some(two)) = (number_of(teller), number_of(told)) else {
            return;
        };
        let mut teller_is_for_all = false;
        if let Some(teller) = self.peers.get_mut(teller) {
            teller.knows.insert(two);
            teller_is_for_all = teller.known.iter().any(Address::is_for_others);
            if for_all {
                teller.tells.insert(two);
            }
        }
        if let Some(told) = self.peers.get_mut(told) {
            told.knows.insert(one);
            if teller_is_for_all {
                told.tells.insert(one);
            }
        }
    }
}

/// A peer with which there is a link.
struct Linked {
    instance: InstanceId,
    number: u32,
    conn: ConnId,
}
