//! Peers: found by mDNS, given as addresses, or calling us; dialled until they are there or gone.
//!
//! ```text
//!   discovered, seed, caller ──▶ dialling ──▶ linked ──(last link breaks)──▶ suspect, dialled at once
//!                                  ▲ backoff    │ silent: suspect               │ back: alive
//!                                  └────────────┴──── grace is over: gone ◀─────┘
//! ```

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now, Source, State};
use fipa_link::{Frame, Hello, Outcome};

use super::connections::{ONLY, Partner};
use super::deliveries::{Delivery, Target};
use super::dialling::{Dialling, Purpose};
use super::{Mts, Timer};
use crate::machine::{Announced, ConnId, Notice, Output};

/// Letters that wait for one peer at most.
const MAX_WAITING: usize = 10_000;

/// How long the service with the greater id leaves the dialling to the other when both have just
/// discovered each other.
const COURTESY: Duration = Duration::from_millis(250);

/// Another message transport service.
#[derive(Debug)]
pub(super) struct Peer {
    pub(super) name: Text,
    /// Where mDNS says it is; `None` when mDNS does not know it.
    pub(super) discovered: Option<Vec<Address>>,
    /// Where it was reached, or says it is.
    pub(super) known: Vec<Address>,
    pub(super) links: Vec<ConnId>,
    pub(super) dialling: Dialling,
    pub(super) state: State,
    down_since: Option<Duration>,
    pub(super) last_error: String,
    /// Deliveries that wait for a link.
    waiting: VecDeque<u64>,
    waiting_octets: usize,
    /// The version of its entries that we hold.
    pub(super) version: Option<u64>,
}
impl Peer {
    fn new(name: Text) -> Peer {
        Peer {
            name,
            discovered: None,
            known: Vec::new(),
            links: Vec::new(),
            dialling: Dialling::default(),
            state: State::Alive,
            down_since: None,
            last_error: "it has not been reached yet".to_owned(),
            waiting: VecDeque::new(),
            waiting_octets: 0,
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
        for address in self.discovered.iter().flatten() {
            if !addresses.contains(address) {
                addresses.push(address.clone());
            }
        }
        addresses
    }
}

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
        let courtesy = self.config.instance > instance;
        let peer = self
            .peers
            .entry(instance)
            .or_insert_with(|| Peer::new(name));
        peer.discovered = Some(addresses);
        let idle = peer.links.is_empty() && !peer.dialling.under_way;
        self.directory.set_source(instance, Source::Mdns);
        if idle && courtesy {
            self.dial_peer_later(now, instance, COURTESY);
        } else if idle {
            self.dial_peer(now, instance);
        }
        self.publish_changes(now);
    }

    /// mDNS does not know the platform any more. A link that is open stays so.
    pub fn undiscovered(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get_mut(&instance) else {
            return;
        };
        peer.discovered = None;
        if !peer.links.is_empty() {
            self.directory.set_source(instance, Source::Peer);
        } else if peer.state == State::Gone || peer.down_since.is_none() {
            self.forget_peer(now, instance);
        }
        self.publish_changes(now);
    }

    /// Whether a link to this peer is open.
    pub fn is_linked(&self, instance: InstanceId) -> bool {
        self.peers
            .get(&instance)
            .is_some_and(|peer| !peer.links.is_empty())
    }

    pub(super) fn peer_name(&self, instance: InstanceId) -> Text {
        match self.peers.get(&instance) {
            Some(peer) => peer.name.clone(),
            None => Text::from(instance.to_string()),
        }
    }

    pub(super) fn peer_error(&self, instance: InstanceId) -> String {
        match self.peers.get(&instance) {
            Some(peer) => peer.last_error.clone(),
            None => "it is gone".to_owned(),
        }
    }

    /// The address that a receipt names for what goes out on a connection.
    pub(super) fn conn_via(&self, conn: ConnId) -> Text {
        let Some(open) = self.conns.get(&conn) else {
            return Text::default();
        };
        match (&open.address, &open.partner) {
            (Some(address), _) => address.to_text(),
            (None, Partner::Daemon { instance, .. }) => {
                let known = self.peers.get(instance).and_then(|p| p.known.first());
                known.map_or(Text::from_static("tcp://"), Address::to_text)
            }
            (None, _) => Text::from_static("local"),
        }
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
        self.forget_earlier_run(now, &hello);
        let reached = self.conns.get(&conn).and_then(|open| open.address.clone());
        let peer = self
            .peers
            .entry(instance)
            .or_insert_with(|| Peer::new(hello.name.clone()));
        peer.name = hello.name.clone();
        peer.state = State::Alive;
        peer.down_since = None;
        peer.dialling = Dialling::default();
        peer.known = reached.into_iter().collect();
        for endpoint in hello.endpoints.iter().filter_map(|e| e.parse().ok()) {
            if !peer.known.contains(&endpoint) {
                peer.known.push(endpoint);
            }
        }
        peer.links.push(conn);
        let first = peer.links.len() == 1;
        self.directory.set_state(instance, State::Alive);
        let same_host = self.conns.get(&conn).is_some_and(|open| open.same_host);
        self.send_own_entries(now, conn, same_host);
        match purpose {
            Some(Purpose::Seed(seed)) => self.seed_met(now, seed, instance),
            Some(Purpose::Peer(other)) if other != instance => {
                self.dial_ended(now, Purpose::Peer(other), "another service answers there");
            }
            _ => {}
        }
        if first {
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
    }

    /// A link to a peer ended, with letters on it that have no receipt yet.
    pub(super) fn peer_conn_ended(
        &mut self,
        now: Now,
        instance: InstanceId,
        conn: ConnId,
        outstanding: BTreeSet<u64>,
        reason: &str,
    ) {
        // They keep their numbers: whoever has them already will say so.
        outstanding.iter().for_each(|id| self.unsend(*id));
        let again = outstanding.iter().filter_map(|id| self.deliveries.get(id));
        let octets: usize = again.map(Delivery::octets).sum();
        if let Some(peer) = self.peers.get_mut(&instance) {
            peer.links.retain(|link| *link != conn);
            peer.waiting_octets += octets;
            outstanding
                .into_iter()
                .rev()
                .for_each(|id| peer.waiting.push_front(id));
        }
        let Some(peer) = self.peers.get_mut(&instance) else {
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
        self.directory.set_state(instance, State::Suspect);
        self.notice(Notice::PeerSuspect {
            name,
            reason: Text::from(reason),
        });
        self.timer(now.mono + self.config.grace, Timer::Peer(instance));
        self.dial_peer(now, instance);
    }

    /// A peer ends, and says so: nobody waits for it.
    pub(super) fn peer_said_goodbye(&mut self, now: Now, instance: InstanceId) {
        if let Some(peer) = self.peers.get_mut(&instance) {
            peer.last_error = super::connections::SHUTDOWN.to_owned();
            peer.discovered = None;
            // Its links close by themselves; none of that is a fault.
            peer.down_since = Some(now.mono);
        }
        self.peer_gone(now, instance);
    }

    /// Three heartbeats were missed, or one came after that.
    pub(super) fn peer_silent(&mut self, conn: ConnId, silent: bool) {
        let Some(Partner::Daemon { instance, .. }) = self.conns.get(&conn).map(|c| &c.partner)
        else {
            return;
        };
        let instance = *instance;
        let state = if silent { State::Suspect } else { State::Alive };
        let Some(peer) = self.peers.get_mut(&instance) else {
            return;
        };
        peer.state = state;
        let name = peer.name.clone();
        self.directory.set_state(instance, state);
        if silent {
            let reason = Text::from_static("it has fallen silent");
            self.notice(Notice::PeerSuspect { name, reason });
        } else {
            let via = self.conn_via(conn);
            self.notice(Notice::PeerUp { name, via });
        }
    }

    pub(super) fn peer_timeout(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get(&instance) else {
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
        let due = self
            .peers
            .get(&instance)
            .and_then(|peer| peer.dialling.again)
            .is_some_and(|at| now.mono >= at);
        if due {
            self.dial_peer(now, instance);
        }
    }

    /// A peer did not come back: its agents go, and so do the letters for them.
    fn peer_gone(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get_mut(&instance) else {
            return;
        };
        peer.state = State::Gone;
        peer.version = None;
        let (name, reason) = (peer.name.clone(), Text::from(peer.last_error.as_str()));
        let discovered = peer.discovered.is_some();
        self.directory.remove_owner(instance);
        self.fail_deliveries(now, instance, &format!("{name} is gone: {reason}"));
        self.notice(Notice::PeerGone { name, reason });
        if discovered {
            let platform = Announced::Platform(instance);
            self.outputs.push_back(Output::Verify(platform));
        } else {
            self.forget_peer(now, instance);
        }
    }

    fn forget_peer(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.remove(&instance) else {
            return;
        };
        self.directory.remove_owner(instance);
        self.fail_deliveries(now, instance, &format!("{} is gone", peer.name));
        self.forget_seen_later(now, instance);
        let seeds: Vec<u64> = self
            .seeds
            .iter()
            .filter(|(_, seed)| seed.instance == Some(instance))
            .map(|(id, _)| *id)
            .collect();
        for seed in seeds {
            self.seed_lost(now, seed);
        }
    }

    /// A daemon that was started anew is there with another id: the run before it is over.
    fn forget_earlier_run(&mut self, now: Now, hello: &Hello) {
        let endpoints: Vec<Address> = hello.endpoints.iter().flat_map(|e| e.parse()).collect();
        let there = |addresses: &[Address]| addresses.iter().any(|a| endpoints.contains(a));
        let earlier: Vec<(InstanceId, Vec<ConnId>)> = self
            .peers
            .iter()
            .filter(|(instance, peer)| {
                **instance != hello.instance
                    && peer.name == hello.name
                    && (peer.links.is_empty() || there(&peer.known))
            })
            .map(|(instance, peer)| (*instance, peer.links.clone()))
            .collect();
        for (instance, links) in earlier {
            for seed in self.seeds.values_mut() {
                if seed.instance == Some(instance) && there(&seed.addresses) {
                    seed.instance = Some(hello.instance);
                }
            }
            self.forget_peer(now, instance);
            // A host that lost its power did not end them.
            for conn in links {
                self.outputs.push_back(Output::Close(conn));
                self.drop_conn(now, conn, "it was started anew");
            }
        }
    }

    fn fail_deliveries(&mut self, now: Now, instance: InstanceId, reason: &str) {
        let mut lost: Vec<u64> = self
            .deliveries
            .iter()
            .filter(|(_, delivery)| delivery.target == Target::Peer(instance))
            .map(|(id, _)| *id)
            .collect();
        lost.sort_unstable();
        for id in lost {
            self.finish(now, id, Outcome::Timeout, Text::from(reason));
        }
    }

    /// Sends a copy over the peer's link, or keeps it until there is one.
    pub(super) fn queue_for_peer(
        &mut self,
        now: Now,
        instance: InstanceId,
        id: u64,
        octets: usize,
    ) {
        let max = self.config.queue_octets;
        let Some(peer) = self.peers.get_mut(&instance) else {
            let reason = Text::from_static("its platform is not known any more");
            self.finish(now, id, Outcome::Unknown, reason);
            return;
        };
        let full = peer.waiting.len() >= MAX_WAITING || peer.waiting_octets + octets > max;
        if peer.links.is_empty() && full {
            let reason = Text::from(format!("too many letters wait for {}", peer.name));
            self.finish(now, id, Outcome::Refused, reason);
            return;
        }
        peer.waiting.push_back(id);
        peer.waiting_octets += octets;
        self.flush_waiting(now, instance);
    }

    pub(super) fn flush_waiting(&mut self, now: Now, instance: InstanceId) {
        while let Some(peer) = self.peers.get_mut(&instance) {
            let usable = |conn: &&ConnId| self.conns.get(conn).is_some_and(|open| !open.retired);
            let Some(conn) = peer.links.iter().find(usable).copied() else {
                return;
            };
            let Some(id) = peer.waiting.pop_front() else {
                peer.waiting_octets = 0;
                return;
            };
            self.transmit_delivery(now, conn, id);
        }
    }
}
