//! Gossip: services tell each other whom they have links with, so that one address of one of them
//! is enough to find all.
//!
//! Only what the speaker knows first-hand is told, once, and again every half an hour. So a
//! platform that is dead is told of by nobody, and one that is told of is dialled, not believed:
//! its agents are known when it has said itself who they are.

use std::collections::VecDeque;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now, State};
use fipa_link::{Frame, KnownPlatform};

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

/// Platforms that are dialled because others told of them, at most.
const MAX_TOLD: usize = 256;

/// Platforms that a peer is known to know, at most.
const MAX_KNOWN: usize = 4096;

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
    pub(super) fn tell_platforms_soon(&mut self, now: Now, instance: InstanceId) {
        if let Some(peer) = self.peers.get_mut(instance) {
            peer.knows.clear();
        }
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

    fn tell_again_later(&mut self, now: Now, random: f64) {
        let again = now.mono + AGAIN.mul_f64(1.0 + random / 2.0);
        self.gossip.again = Some(again);
        self.timer(again, Timer::Gossip);
    }

    pub(super) fn gossip_timeout(&mut self, now: Now) {
        let is_due = |due: Option<Duration>| due.is_some_and(|due| due <= now.mono);
        let again = is_due(self.gossip.again);
        if again {
            self.peers.values_mut().for_each(|peer| peer.knows.clear());
            let random = self.random.f64();
            self.tell_again_later(now, random);
        }
        if again || is_due(self.gossip.due) {
            self.gossip.due = None;
            self.tell_platforms(now);
        }
    }

    /// Tells every peer of those others that it does not know yet.
    fn tell_platforms(&mut self, now: Now) {
        let linked: Vec<(InstanceId, ConnId)> = self
            .peers
            .iter()
            .filter(|(_, peer)| peer.state == State::Alive)
            .filter_map(|(instance, peer)| Some((instance, *peer.links.first()?)))
            .collect();
        for (listener, conn) in &linked {
            let others = linked.iter().filter(|(instance, _)| instance != listener);
            let news: Vec<KnownPlatform> = others
                .filter_map(|(instance, link)| self.news(now, *listener, *conn, *instance, *link))
                .collect();
            if let Some(peer) = self.peers.get_mut(*listener) {
                peer.knows
                    .extend(news.iter().map(|platform| platform.instance));
            }
            for part in news.chunks(IN_A_FRAME) {
                self.send(now, *conn, Frame::Platforms(part.to_vec()));
            }
        }
    }

    /// What a listener is to be told of another peer.
    fn news(
        &self,
        now: Now,
        listener: InstanceId,
        conn: ConnId,
        instance: InstanceId,
        link: ConnId,
    ) -> Option<KnownPlatform> {
        let told = self.peers.get(listener)?;
        if told.knows.contains(&instance) {
            return None;
        }
        let peer = self.peers.get(instance)?;
        let addresses = self.addresses_for(conn, &peer.known);
        let heard = self.conns.get(&link)?.link.last_heard();
        let age = now.mono.saturating_sub(heard).as_millis();
        (!addresses.is_empty()).then(|| KnownPlatform {
            instance,
            name: peer.name.clone(),
            scope: self.config.scope.clone(),
            addresses,
            age_millis: u64::try_from(age).unwrap_or(u64::MAX),
        })
    }

    /// Those of some addresses that the partner on a connection may be told.
    fn addresses_for(&self, conn: ConnId, addresses: &[Address]) -> Vec<Text> {
        let same_host = self.conns.get(&conn).is_some_and(|open| open.same_host);
        let told = addresses.iter().filter(|a| same_host || a.is_for_others());
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
        let told = self.peers.iter().filter(|(_, peer)| peer.is_only_told());
        let mut room = MAX_TOLD.saturating_sub(told.count());
        for platform in platforms {
            let addresses: Vec<Address> = platform
                .addresses
                .iter()
                .filter_map(|address| address.parse().ok())
                .filter(|address: &Address| same_host || address.is_for_others())
                .take(MAX_ADDRESSES)
                .collect();
            let KnownPlatform { instance, name, .. } = platform;
            let left = SOUGHT.saturating_sub(Duration::from_millis(platform.age_millis));
            if platform.scope != self.config.scope || instance == self.config.instance {
                continue;
            }
            if instance == teller {
                if let Some(peer) = self.peers.get_mut(teller)
                    && !addresses.is_empty()
                {
                    peer.known = addresses;
                }
                continue;
            }
            self.both_know(teller, instance);
            let is_new = self.peers.get(instance).is_none();
            let unwanted = left.is_zero() || self.gossip.has_departed(instance);
            if unwanted || addresses.is_empty() || (is_new && room == 0) {
                continue;
            }
            room -= usize::from(is_new);
            self.peers.meet(instance, &name).told = addresses;
            self.seek_until(now.mono + left, instance);
            self.dial_found_peer(now, instance);
        }
    }

    /// Who has a link with another knows it, and is known.
    fn both_know(&mut self, one: InstanceId, two: InstanceId) {
        for (one, two) in [(one, two), (two, one)] {
            if let Some(peer) = self.peers.get_mut(one)
                && peer.knows.len() < MAX_KNOWN
            {
                peer.knows.insert(two);
            }
        }
    }
}
