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

use super::connections::{DUPLICATE, ONLY, Partner};
use super::deliveries::{Delivery, Target};
use super::{Mts, Timer};
use crate::machine::{ConnId, DialId, Notice, Output};

/// Letters that wait for one peer at most.
const MAX_WAITING: usize = 10_000;

/// The pause before the second dial; each further one is twice as long, up to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(2);

/// How long the service with the greater id leaves the dialling to the other when both have just
/// discovered each other.
const COURTESY: Duration = Duration::from_millis(250);

/// Another message transport service.
#[derive(Debug)]
pub(super) struct Peer {
    name: Text,
    /// Where mDNS says it is; `None` when mDNS does not know it.
    discovered: Option<Vec<Address>>,
    /// Where it was reached, or says it is.
    known: Vec<Address>,
    links: Vec<ConnId>,
    dialling: Dialling,
    state: State,
    down_since: Option<Duration>,
    last_error: String,
    /// Deliveries that wait for a link.
    waiting: VecDeque<u64>,
    waiting_octets: usize,
    /// The version of its entries that we hold.
    pub(super) version: Option<u64>,
}

/// An address to dial until we know who is there.
#[derive(Debug)]
pub(super) struct Seed {
    addresses: Vec<Address>,
    /// Given by the operator: dialled for ever. Otherwise only while letters wait.
    kept: bool,
    /// Who was found there.
    instance: Option<InstanceId>,
    /// It is our own address.
    myself: bool,
    dialling: Dialling,
    last_error: String,
    waiting: Vec<u64>,
}

/// What a dial is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Peer(InstanceId),
    Seed(u64),
}

#[derive(Debug, Default)]
struct Dialling {
    under_way: bool,
    /// When to dial again.
    again: Option<Duration>,
    attempts: u32,
}

impl Dialling {
    fn is_idle(&self) -> bool {
        !self.under_way && self.again.is_none()
    }
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
    fn addresses(&self) -> Vec<Address> {
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
    /// Adds the address of a peer that is dialled for ever, whoever answers there.
    pub fn add_peer(&mut self, now: Now, address: Address) {
        let seed = self.new_seed(vec![address], true);
        self.dial_seed(now, seed);
    }

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

    /// Of several links the service with the smaller id keeps the one that it has had longest. Each
    /// side tells the other when it has just one: a stream can end on one side only.
    fn keep_one_link(&mut self, now: Now, instance: InstanceId) {
        if self.config.instance > instance {
            return;
        }
        let links = match self.peers.get(&instance) {
            Some(peer) => peer.links.clone(),
            None => return,
        };
        for conn in links.into_iter().skip(1) {
            self.send(now, conn, Frame::Goodbye(Text::from_static(DUPLICATE)));
            if let Some(open) = self.conns.get_mut(&conn) {
                open.retired = true;
            }
        }
    }

    /// The partner keeps another link: this one closes once its receipts are in.
    pub(super) fn retire(&mut self, now: Now, conn: ConnId) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        open.retired = true;
        let decider = match open.partner {
            Partner::Daemon { instance, .. } => self.config.instance < instance,
            _ => false,
        };
        if open.outstanding.is_empty() && !decider {
            self.outputs.push_back(Output::Close(conn));
            self.drop_conn(now, conn, DUPLICATE);
        }
    }

    /// Whether there is no other link to the same peer that is in use.
    pub(super) fn is_only_link(&self, conn: ConnId) -> bool {
        let Some(Partner::Daemon { instance, .. }) = self.conns.get(&conn).map(|c| &c.partner)
        else {
            return false;
        };
        let in_use = |link: &ConnId| self.conns.get(link).is_some_and(|open| !open.retired);
        self.peers
            .get(instance)
            .is_some_and(|peer| !peer.links.iter().any(|link| *link != conn && in_use(link)))
    }

    /// The partner has no link but this one: the others are dead, and nobody told us.
    pub(super) fn keep_this_link(&mut self, now: Now, conn: ConnId) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        open.retired = false;
        let Partner::Daemon { instance, .. } = open.partner else {
            return;
        };
        let links = match self.peers.get(&instance) {
            Some(peer) => peer.links.clone(),
            None => return,
        };
        for other in links.into_iter().filter(|link| *link != conn) {
            self.outputs.push_back(Output::Close(other));
            self.drop_conn(
                now,
                other,
                "the other side does not have this link any more",
            );
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
            self.outputs.push_back(Output::Verify(instance));
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

    fn flush_waiting(&mut self, now: Now, instance: InstanceId) {
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

    fn dial_peer(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get_mut(&instance) else {
            return;
        };
        let addresses = peer.addresses();
        if peer.dialling.under_way || self.closing {
            return;
        }
        if addresses.is_empty() {
            return;
        }
        peer.dialling.under_way = true;
        peer.dialling.again = None;
        self.dial(now, Purpose::Peer(instance), addresses);
    }

    fn dial_peer_later(&mut self, now: Now, instance: InstanceId, pause: Duration) {
        let at = now.mono + pause;
        if let Some(peer) = self.peers.get_mut(&instance)
            && peer.dialling.is_idle()
        {
            peer.dialling.again = Some(at);
            self.timer(at, Timer::Peer(instance));
        }
    }

    fn dial(&mut self, _now: Now, purpose: Purpose, addresses: Vec<Address>) {
        let dial = DialId(self.id());
        self.dials.insert(dial, purpose);
        self.outputs.push_back(Output::Dial { dial, addresses });
    }

    /// A dial led to nobody.
    pub(super) fn dial_ended(&mut self, now: Now, purpose: Purpose, reason: &str) {
        let random = self.random.f64();
        let dialling = match purpose {
            Purpose::Peer(instance) => {
                let Some(peer) = self.peers.get_mut(&instance) else {
                    return;
                };
                peer.last_error = reason.to_owned();
                peer.dialling.under_way = false;
                if !peer.links.is_empty() {
                    return;
                }
                &mut peer.dialling
            }
            Purpose::Seed(seed) => {
                let Some(seed) = self.seeds.get_mut(&seed) else {
                    return;
                };
                seed.last_error = reason.to_owned();
                seed.dialling.under_way = false;
                if seed.myself || seed.instance.is_some() {
                    return;
                }
                &mut seed.dialling
            }
        };
        let at = now.mono + pause(dialling.attempts, random);
        dialling.attempts += 1;
        dialling.again = Some(at);
        match purpose {
            Purpose::Peer(instance) => self.timer(at, Timer::Peer(instance)),
            Purpose::Seed(seed) => self.timer(at, Timer::Seed(seed)),
        }
    }

    fn new_seed(&mut self, addresses: Vec<Address>, kept: bool) -> u64 {
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
            },
        );
        id
    }

    /// The seed for a receiver that brings its addresses along.
    pub(super) fn seed_for(&mut self, now: Now, addresses: Vec<Address>) -> u64 {
        let known = self.seeds.iter().find(|(_, s)| s.addresses == addresses);
        match known {
            Some((id, _)) => *id,
            None => {
                let id = self.new_seed(addresses, false);
                self.dial_seed(now, id);
                id
            }
        }
    }

    pub(super) fn queue_for_seed(&mut self, now: Now, id: u64, delivery: u64) {
        let Some(seed) = self.seeds.get_mut(&id) else {
            return;
        };
        match seed.instance {
            Some(instance) => self.retarget(now, delivery, instance),
            None if seed.myself => self.nobody_here(now, delivery),
            None => {
                seed.waiting.push(delivery);
                if seed.dialling.is_idle() {
                    self.dial_seed(now, id);
                }
            }
        }
    }

    fn retarget(&mut self, now: Now, id: u64, instance: InstanceId) {
        if let Some(delivery) = self.deliveries.get_mut(&id) {
            delivery.target = Target::Peer(instance);
            let octets = delivery.octets();
            self.queue_for_peer(now, instance, id, octets);
        }
    }

    fn dial_seed(&mut self, now: Now, id: u64) {
        let Some(seed) = self.seeds.get_mut(&id) else {
            return;
        };
        if seed.dialling.under_way || seed.myself || seed.instance.is_some() || self.closing {
            return;
        }
        seed.dialling.under_way = true;
        seed.dialling.again = None;
        let addresses = seed.addresses.clone();
        self.dial(now, Purpose::Seed(id), addresses);
    }

    pub(super) fn seed_timeout(&mut self, now: Now, id: u64) {
        let Some(seed) = self.seeds.get_mut(&id) else {
            return;
        };
        seed.waiting
            .retain(|delivery| self.deliveries.contains_key(delivery));
        if !seed.kept && seed.waiting.is_empty() && seed.instance.is_none() {
            self.seeds.remove(&id);
            return;
        }
        if seed.dialling.again.is_some_and(|at| now.mono >= at) {
            self.dial_seed(now, id);
        }
    }

    fn seed_met(&mut self, now: Now, id: u64, instance: InstanceId) {
        let Some(seed) = self.seeds.get_mut(&id) else {
            return;
        };
        seed.instance = Some(instance);
        seed.dialling = Dialling::default();
        for delivery in std::mem::take(&mut seed.waiting) {
            self.retarget(now, delivery, instance);
        }
    }

    pub(super) fn seed_is_myself(&mut self, now: Now, purpose: Option<Purpose>) {
        if let Some(Purpose::Seed(id)) = purpose
            && let Some(seed) = self.seeds.get_mut(&id)
        {
            seed.myself = true;
            for delivery in std::mem::take(&mut seed.waiting) {
                self.nobody_here(now, delivery);
            }
        }
    }

    /// A letter whose address turned out to be our own, where nobody has the receiver's name.
    fn nobody_here(&mut self, now: Now, delivery: u64) {
        let here = &self.config.name;
        let reason = Text::from(format!("no agent of this name is known at {here}"));
        self.finish(now, delivery, Outcome::Unknown, reason);
    }

    /// Who was found at the seed is gone: it is dialled again, or forgotten.
    fn seed_lost(&mut self, now: Now, id: u64) {
        let Some(seed) = self.seeds.get_mut(&id) else {
            return;
        };
        seed.instance = None;
        if seed.kept {
            self.dial_seed(now, id);
        } else {
            self.seeds.remove(&id);
        }
    }

    pub(super) fn seed_error(&self, id: u64) -> String {
        match self.seeds.get(&id) {
            Some(seed) => format!("it could not be reached in time: {}", seed.last_error),
            None => "it could not be reached in time".to_owned(),
        }
    }
}

/// 100 ms, 200 ms, … 2 s; each half to all of that, at random, so that a fleet does not dial in
/// step.
fn pause(attempts: u32, random: f64) -> Duration {
    let whole = FIRST_PAUSE * 2_u32.pow(attempts.min(8));
    whole.min(LONGEST_PAUSE).mul_f64(0.5 + random / 2.0)
}
