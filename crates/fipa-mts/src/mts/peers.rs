//! Peers: found by mDNS, given as addresses, told by others, or calling us; dialled until they are
//! there or forgotten.
//!
//! ```text
//!   discovered, told, seed, caller ──▶ dialling ──▶ linked ──(last link breaks)──▶ suspect, dialled at once
//!                                        ▲ backoff    │ silent: suspect               │ back: alive
//!                                        └────────────┴──── grace is over: gone ◀─────┘
//! ```
//!
//! A link that has missed six heartbeats is given up, which is the end of a connection like any
//! other: a way through a firewall may have been forgotten on it, and the peer be well.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now, Source, State};
use fipa_link::{Frame, Hello, Outcome};

use super::connections::{Conn, ONLY, Outstanding, Partner};
use super::dialling::{Dialling, Purpose};
use super::{Mts, Timer};
use crate::Urgency;
use crate::machine::{Announced, ConnId, Notice, Output};

/// Letters that wait for one peer at most.
pub(super) const MAX_WAITING: usize = 10_000;

/// Octets that are handed to a link at once: enough to keep it busy, and few for an urgent letter to
/// wait for.
pub(super) const WINDOW: usize = 1 << 20;

/// Letters on a link that wait for their receipts, at most: the other side remembers twice as many.
pub(super) const MAX_OUTSTANDING: usize = 8192;

/// How long the service with the greater id leaves the dialling to the other when both have just
/// discovered each other.
const COURTESY: Duration = Duration::from_millis(250);

/// How long a platform is sought that nobody has heard lately: it was linked, and vanished without
/// a goodbye, or others have told of it.
pub(super) const SOUGHT: Duration = Duration::from_secs(3600);

/// Platforms that vanished and are sought, at most.
const MAX_LOST: usize = 256;

impl Mts {
    /// mDNS has found a platform, or heard something new of it.
    pub fn discovered(
        &mut self,
        now: Now,
        instance: InstanceId,
        name: Text,
        addresses: Vec<Address>,
    ) {
        if instance == self.config.instance || self.closing {
            return;
        }
        let peer = self.peers.meet(instance, &name);
        peer.discovered = Some(addresses);
        self.directory.set_source(instance, Source::Mdns);
        self.dial_found_peer(now, instance, Duration::ZERO);
        self.publish_changes(now);
    }

    /// Dials a peer of which something new was heard, if it needs that, when its turn comes.
    pub(super) fn dial_found_peer(&mut self, now: Now, instance: InstanceId, turn: Duration) {
        let Some(peer) = self.peers.get(instance) else {
            return;
        };
        if !peer.links.is_empty() || peer.dialling.under_way {
            return;
        }
        if self.config.instance > instance {
            self.dial_peer_later(now, instance, turn + COURTESY);
        } else if turn.is_zero() {
            self.dial_peer(now, instance);
        } else {
            self.dial_peer_later(now, instance, turn);
        }
    }

    /// mDNS does not know the platform any more. A link that is open stays so.
    pub fn undiscovered(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get_mut(instance) else {
            return;
        };
        peer.discovered = None;
        if !peer.links.is_empty() {
            self.directory.set_source(instance, Source::Peer);
        } else if (peer.state == State::Gone || peer.down_since.is_none()) && !peer.is_sought(now) {
            self.forget_peer(now, instance);
        }
        self.publish_changes(now);
    }

    /// Whether a link to this peer is open.
    pub fn is_linked(&self, instance: InstanceId) -> bool {
        self.peers
            .get(instance)
            .is_some_and(|peer| !peer.links.is_empty())
    }

    pub(super) fn peer_name(&self, instance: InstanceId) -> Text {
        match self.peers.get(instance) {
            Some(peer) => peer.name.clone(),
            None => Text::from(instance.to_string()),
        }
    }

    pub(super) fn peer_error(&self, instance: InstanceId) -> String {
        match self.peers.get(instance) {
            Some(peer) => peer.last_error.clone(),
            None => "it is gone".to_owned(),
        }
    }

    /// The address that a receipt names for what goes out on a connection.
    pub(super) fn conn_via(&self, conn: ConnId) -> Text {
        let open = self.conns.get(&conn);
        open.map(|open| open.via.clone()).unwrap_or_default()
    }

    /// A peer has said hello.
    pub(super) fn peer_conn_opened(
        &mut self,
        now: Now,
        conn: ConnId,
        hello: Hello,
        purpose: Option<Purpose>,
    ) {
        let instance = hello.instance;
        let seeds = self.forget_earlier_run(now, &hello);
        let reached = self.conns.get(&conn).and_then(|open| open.address.clone());
        let identity = self.conns.get(&conn).and_then(|open| open.identity.clone());
        if let Some(robot) = &identity {
            self.robot_met(now, robot);
        }
        let peer = self.peers.meet_as(instance, &hello.name);
        peer.identity = identity;
        peer.seeds.extend(seeds);
        peer.state = State::Alive;
        peer.down_since = None;
        peer.dialling = Dialling::default();
        peer.known = reached.into_iter().collect();
        for endpoint in hello.endpoints.iter().filter_map(|e| e.parse().ok()) {
            if !peer.known.contains(&endpoint) {
                peer.known.push(endpoint);
            }
        }
        if let Some(open) = self.conns.get_mut(&conn) {
            let first = peer.known.first();
            let scheme = match open.remote.starts_with("quic://") {
                true => Text::from_static("quic://"),
                false => Text::from_static("tcp://"),
            };
            open.via = first.map_or(scheme, Address::to_text);
        }
        peer.links.push(conn);
        let first = peer.links.len() == 1;
        self.directory.set_state(now, instance, State::Alive);
        let same_host = self.conns.get(&conn).is_some_and(|open| open.same_host);
        self.tell_newcomer_revoked(now, conn);
        self.send_own_entries(now, conn, same_host);
        match purpose {
            Some(Purpose::Seed(seed)) => self.seed_met(now, seed, instance),
            Some(Purpose::Peer(other)) if other != instance => {
                self.dial_ended(now, Purpose::Peer(other), "another service answers there");
            }
            _ => {}
        }
        if first {
            self.tell_platforms_soon(now);
            let via = self.conn_via(conn);
            if hello.name == self.config.name {
                let (name, other) = (hello.name.clone(), via.clone());
                self.notice(Notice::Conflict { name, other });
            }
            self.notice(Notice::PeerUp {
                name: hello.name,
                via,
            });
            if self.config.instance < instance {
                self.send(now, conn, Frame::Goodbye(Text::from_static(ONLY)));
            }
        } else {
            self.keep_one_link(now, instance);
        }
        self.flush_waiting(now, instance);
        self.run_whole_outbox(now);
    }

    /// A link to a peer ended, with letters on it that have no receipt yet.
    pub(super) fn peer_conn_ended(
        &mut self,
        now: Now,
        instance: InstanceId,
        conn: ConnId,
        outstanding: Outstanding,
        reason: &str,
    ) {
        // They keep their numbers: whoever has them already will say so.
        outstanding.iter().for_each(|id| self.unsend(*id));
        if let Some(peer) = self.peers.get_mut(instance) {
            peer.links.retain(|link| *link != conn);
            for id in outstanding {
                if let Some(again) = self.deliveries.get(&id) {
                    peer.waiting.push_again(&again.sender, id, again.octets());
                }
            }
        }
        let Some(peer) = self.peers.get_mut(instance) else {
            return;
        };
        if !peer.links.is_empty() {
            self.flush_waiting(now, instance);
            return;
        }
        if peer.down_since.is_some() || self.closing {
            return;
        }
        peer.state = State::Suspect;
        peer.down_since = Some(now.mono);
        peer.last_error = reason.to_owned();
        let name = peer.name.clone();
        self.unsay_platform(now, instance);
        self.directory.set_state(now, instance, State::Suspect);
        self.notice(Notice::PeerSuspect {
            name,
            reason: Text::from(reason),
        });
        self.timer(now.mono + self.config.grace, Timer::Peer(instance));
        self.dial_peer(now, instance);
    }

    /// A peer ends, and says so: nobody waits for it.
    pub(super) fn peer_said_goodbye(&mut self, now: Now, instance: InstanceId) {
        self.gossip.departed(instance);
        if let Some(peer) = self.peers.get_mut(instance) {
            peer.last_error = super::connections::SHUTDOWN.to_owned();
            peer.discovered = None;
            peer.sought_until = Duration::ZERO;
            // Its links close by themselves; none of that is a fault.
            peer.down_since = Some(now.mono);
        }
        self.unsay_platform(now, instance);
        self.peer_gone(now, instance);
    }

    /// Three heartbeats were missed, or one came after that.
    pub(super) fn peer_silent(&mut self, now: Now, conn: ConnId, silent: bool) {
        let Some(Partner::Daemon { instance, .. }) = self.conns.get(&conn).map(|c| &c.partner)
        else {
            return;
        };
        let instance = *instance;
        let state = if silent { State::Suspect } else { State::Alive };
        let Some(peer) = self.peers.get_mut(instance) else {
            return;
        };
        peer.state = state;
        let name = peer.name.clone();
        self.directory.set_state(now, instance, state);
        if silent {
            let reason = Text::from_static("it has fallen silent");
            self.notice(Notice::PeerSuspect { name, reason });
        } else {
            let via = self.conn_via(conn);
            self.notice(Notice::PeerUp { name, via });
            self.run_whole_outbox(now);
        }
    }

    pub(super) fn peer_timeout(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get(instance) else {
            return;
        };
        if peer.links.is_empty() && peer.state != State::Gone {
            let over = peer
                .down_since
                .is_some_and(|at| now.mono >= at + self.config.grace);
            if over {
                self.peer_gone(now, instance);
            }
        }
        let Some(peer) = self.peers.get(instance) else {
            return;
        };
        let in_grace = peer.state == State::Suspect;
        if peer.links.is_empty() && !in_grace && !peer.is_sought(now) {
            self.forget_peer(now, instance);
        } else if peer.dialling.again.is_some_and(|at| now.mono >= at) {
            self.dial_peer(now, instance);
        }
    }

    /// A peer did not come back: its agents go, and so do the letters for them.
    fn peer_gone(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get_mut(instance) else {
            return;
        };
        peer.state = State::Gone;
        peer.version = None;
        let (name, reason) = (peer.name.clone(), Text::from(peer.last_error.as_str()));
        let discovered = peer.discovered.is_some();
        self.seek_lost_peer(now, instance);
        self.forget_seen_later(now, instance);
        self.drop_claims(instance);
        self.directory.remove_owner(now, instance);
        self.release_deliveries(now, instance, &format!("{name} is gone: {reason}"));
        self.notice(Notice::PeerGone { name, reason });
        if discovered {
            let platform = Announced::Platform(instance);
            self.outputs.push_back(Output::Verify(platform));
        } else if !self.peers.get(instance).is_some_and(|p| p.is_sought(now)) {
            self.forget_peer(now, instance);
        }
    }

    /// Goes on to dial a peer that vanished without a goodbye, for a while, unless that is somebody
    /// else's business: mDNS will tell when it is back, and a seed is dialled for ever.
    fn seek_lost_peer(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get_mut(instance) else {
            return;
        };
        let kept = |seed: &u64| self.seeds.get(*seed).is_some_and(|seed| seed.kept);
        let (kept, given_along): (Vec<u64>, Vec<u64>) = peer.seeds.iter().partition(|s| kept(s));
        peer.seeds = kept.into_iter().collect();
        given_along
            .into_iter()
            .for_each(|seed| self.seeds.remove(seed));
        if !peer.seeds.is_empty() {
            peer.sought_until = Duration::ZERO;
        } else if peer.discovered.is_none() && !self.gossip.has_departed(instance) {
            let lost = self.peers.iter().filter(|(_, peer)| peer.is_lost());
            if lost.count() <= MAX_LOST {
                self.seek_until(now.mono + SOUGHT, instance);
            }
        }
    }

    /// Dials a peer until then at least. A little more is not worth a timer of its own.
    pub(super) fn seek_until(&mut self, until: Duration, instance: InstanceId) {
        if let Some(peer) = self.peers.get_mut(instance)
            && until > peer.sought_until + SOUGHT / 60
        {
            peer.sought_until = until;
            self.timer(until, Timer::Peer(instance));
        }
    }

    fn forget_peer(&mut self, now: Now, instance: InstanceId) {
        self.drop_claims(instance);
        self.directory.remove_owner(now, instance);
        let name = self.peer_name(instance);
        self.release_deliveries(now, instance, &format!("{name} is gone"));
        let Some(peer) = self.peers.remove(instance) else {
            return;
        };
        self.forget_seen_later(now, instance);
        for seed in peer.seeds {
            self.seed_lost(now, seed);
        }
    }

    /// A daemon that was started anew is there with another id: the run before it is over. Its
    /// seeds are those of the new one.
    fn forget_earlier_run(&mut self, now: Now, hello: &Hello) -> BTreeSet<u64> {
        let mut moved = BTreeSet::new();
        let endpoints: Vec<Address> = hello.endpoints.iter().flat_map(|e| e.parse()).collect();
        let there = |addresses: &[Address]| addresses.iter().any(|a| endpoints.contains(a));
        let earlier: Vec<(InstanceId, Vec<ConnId>)> = self
            .peers
            .named(&hello.name)
            .filter(|(instance, peer)| {
                *instance != hello.instance && (peer.links.is_empty() || there(&peer.known))
            })
            .map(|(instance, peer)| (instance, peer.links.clone()))
            .collect();
        for (instance, links) in earlier {
            let met = self
                .peers
                .get_mut(instance)
                .map(|p| std::mem::take(&mut p.seeds));
            for id in met.into_iter().flatten() {
                match self.seeds.get_mut(id) {
                    Some(seed) if there(&seed.addresses) => {
                        seed.instance = Some(hello.instance);
                        moved.insert(id);
                    }
                    _ => self.seed_lost(now, id),
                }
            }
            self.forget_peer(now, instance);
            // A host that lost its power did not end them.
            for conn in links {
                self.outputs.push_back(Output::Close(conn));
                self.drop_conn(now, conn, "it was started anew");
            }
        }
        moved
    }

    /// Sends a copy over the peer's link, or keeps it until there is one that has room for it.
    pub(super) fn queue_for_peer(&mut self, now: Now, instance: InstanceId, id: u64) {
        let max_octets = self.config.queue_octets;
        let Some(delivery) = self.deliveries.get(&id) else {
            return;
        };
        let Some(peer) = self.peers.get_mut(instance) else {
            let reason = Text::from_static("its platform is not known any more");
            self.finish(now, id, Outcome::Unknown, reason);
            return;
        };
        if peer.waiting.is_empty()
            && let Some(conn) = free_link(&mut self.conns, &peer.links, delivery.urgency)
        {
            self.transmit_delivery(now, conn, id);
            return;
        }
        let (sender, octets) = (&delivery.sender, delivery.octets());
        if !peer
            .waiting
            .has_room(sender, octets, MAX_WAITING, max_octets)
        {
            let reason = Text::from(format!("the queue of {} is full", peer.name));
            self.not_taken(now, id, Outcome::Refused, reason);
            return;
        }
        peer.waiting.push(delivery.urgency, sender, id, octets);
        // On a link with lanes it passes those that wait for room on another.
        self.flush_waiting(now, instance);
    }

    /// Sends what waits for a peer, as far as its link has room.
    pub(super) fn flush_waiting(&mut self, now: Now, instance: InstanceId) {
        while let Some(peer) = self.peers.get_mut(instance) {
            let Some(first) = peer.waiting.first() else {
                return;
            };
            let delivery = self.deliveries.get(&first).map(|delivery| delivery.urgency);
            let passing = self.passing.get(first).map(|passing| passing.urgency());
            let urgency = delivery.or(passing).unwrap_or_default();
            let Some(conn) = free_link(&mut self.conns, &peer.links, urgency) else {
                return;
            };
            let Some(id) = peer.waiting.pop() else {
                return;
            };
            match self.transmit_passing(now, conn, id) {
                true => self.was_queued(conn),
                false => self.transmit_delivery(now, conn, id),
            }
        }
    }

    /// A link whose octets are being written may have room again.
    pub(super) fn refill(&mut self, now: Now, conn: ConnId) {
        if let Some(open) = self.conns.get_mut(&conn)
            && std::mem::take(&mut open.starved)
            && let Partner::Daemon { instance, .. } = open.partner
        {
            self.flush_waiting(now, instance);
        }
    }
}

/// The link to write the next letter to. Those that wait are not written before there is room: so
/// an urgent one passes them, and each sender has its turn.
fn free_link(
    conns: &mut BTreeMap<ConnId, Box<Conn>>,
    links: &[ConnId],
    urgency: Urgency,
) -> Option<ConnId> {
    let usable = |conn: &&ConnId| conns.get(conn).is_some_and(|open| !open.retired);
    let conn = links.iter().find(usable).copied()?;
    let open = conns.get_mut(&conn)?;
    let busy = open.is_busy(urgency);
    open.starved |= busy;
    (!busy).then_some(conn)
}
