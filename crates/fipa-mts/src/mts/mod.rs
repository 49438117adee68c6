//! The message transport service. This module holds its state; its parts each hold one concern.

mod ahead;
mod backlog;
mod call_backs;
mod callers;
mod connections;
mod deadlines;
mod deliveries;
mod dialects;
mod dialling;
mod doors;
mod dropped;
mod duplicates;
mod facts;
mod fleet;
mod gossip;
mod http;
mod jade;
mod late;
mod moves;
mod neighbours;
mod notices;
mod numbers;
mod outbox;
mod passing;
mod patterns;
mod peer;
mod peers;
mod platforms;
mod posting;
mod programs;
mod routing;
mod seeds;
mod seen;
mod sequence;
mod stamps;
mod sync;
mod tap;
mod waiting;

pub use fleet::FLEET as ONLY_FLEET;
pub(crate) use sync::record_of;

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Envelope, Letter, Text};
use fipa_codec::{Output as Encoded, bit_efficient};
use fipa_directory::{Directory, InstanceId, Now};
use fipa_link::{CallBack, Outcome};
use smallvec::smallvec;

use self::backlog::Backlog;
use self::call_backs::CallBacks;
use self::callers::Caller;
use self::connections::Conn;
use self::deadlines::Deadlines;
use self::deliveries::{Delivery, Origin, Pending};
use self::dialling::Purpose;
use self::doors::Doors;
use self::dropped::AllDropped;
use self::fleet::Fleet;
use self::gossip::Gossip;
use self::http::Recent;
use self::late::Late;
use self::moves::Held;
use self::neighbours::Neighbour;
use self::outbox::Outbox;
use self::passing::Passing;
use self::patterns::{Names, Patterns};
use self::peer::Peers;
use self::posting::Post;
use self::programs::Local;
use self::routing::{Inbound, Terms};
use self::seeds::Seeds;
use self::seen::Seen;
use self::sequence::Sequence;
use self::stamps::Stamps;
use self::tap::Tap;
use crate::Urgency;
use crate::machine::{
    ConnId, Connected, DialId, Ended, Machine, Notice, Output, PostFailure, PostId, REPLY_BY,
    RegisterError, Registration, Submission, TakenOver,
};
use crate::mailbox::Lately;
use crate::{Config, Mailbox};

/// Octets of name, type and description of an agent together, at most.
const MAX_ENTRY: usize = 64 << 10;

/// Outputs for which room is kept where none waits.
const IDLE_OUTPUTS: usize = 256;

/// A message transport service: routes letters between its agents, attached programs and peers.
#[derive(Debug)]
pub struct Mts {
    config: Config,
    directory: Directory,
    /// The fleet, where there is one.
    fleet: Option<Fleet>,
    /// Counts the changes of our own entries.
    version: u64,
    conns: BTreeMap<ConnId, Box<Conn>>,
    /// Those of programs that want the directory.
    watchers: BTreeSet<ConnId>,
    /// Connections of which nobody knows yet what they are, and those that bring a letter.
    callers: BTreeMap<ConnId, Caller>,
    /// Connections that others have opened.
    doors: Doors,
    /// Octets of unfinished letters of all callers.
    caller_octets: usize,
    peers: Peers,
    gossip: Gossip,
    /// What each peer has sent; kept while one that is gone may still come back and send it again.
    seen: HashMap<InstanceId, Seen, foldhash::quality::RandomState>,
    seeds: Seeds,
    /// Agents of other makes, by name.
    neighbours: HashMap<Text, Neighbour>,
    /// Agents of ours that C++ robots are not told of, and why.
    left_out: BTreeMap<Text, Text>,
    call_backs: CallBacks,
    post: Post,
    /// Letters that were posted to us, to recognise those that come again.
    recent: Recent,
    dials: HashMap<DialId, Purpose>,
    locals: HashMap<Text, Local, foldhash::quality::RandomState>,
    /// Letters taken in whose outcomes are not all known.
    pending: Numbered<Pending>,
    /// Copies of letters on their way to one receiver each.
    deliveries: Numbered<Delivery>,
    /// Those of which nothing more needs to be known.
    passing: Sequence<Passing>,
    /// When each of them is looked at.
    deadlines: Deadlines,
    held: Held,
    backlog: Backlog,
    /// Agents in whose mailboxes letters came lately.
    lately: Lately,
    outbox: Outbox,
    dropped: AllDropped,
    late: Late,
    /// Who watches, if anybody does.
    tap: Option<Box<Tap>>,
    timers: BTreeSet<(Duration, Timer)>,
    outputs: VecDeque<Output>,
    random: fastrand::Rng,
    next_id: u64,
    stamps: Stamps,
    /// Memory for the envelope of the next letter.
    spare: Envelope,
    patterns: Patterns,
    /// Memory for the next stamp.
    front: BytesMut,
    /// Counts what may change the ways of letters.
    turn: u64,
    /// Connections on which something was written, or receipts came, of which that is to be told.
    touched: Vec<ConnId>,
    closing: bool,
}

/// What has a number that this service, or a peer, has given it.
type Numbered<T> = HashMap<u64, T, foldhash::fast::RandomState>;

/// Whether this is when a copy is looked at.
fn has_timer(deliveries: &Numbered<Delivery>, at: Duration, id: u64) -> bool {
    deliveries
        .get(&id)
        .is_some_and(|delivery| delivery.timer == at)
}

/// What a timer is for. A timer that fires too early does no harm: its owner looks again.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Timer {
    Caller(ConnId),
    Conn(ConnId),
    Peer(InstanceId),
    Seed(u64),
    Seen(InstanceId),
    Held,
    Gossip,
    /// There may be room for letters to this receiver.
    Room(Text),
    Mailboxes,
    Outbox,
}

impl Mts {
    /// A service without agents, links and peers.
    pub fn new(config: Config) -> Mts {
        Mts {
            directory: Directory::new(),
            fleet: (config.fleet.as_ref()).map(|robots| Fleet::new(&config.name, robots)),
            version: 0,
            conns: BTreeMap::new(),
            watchers: BTreeSet::new(),
            callers: BTreeMap::new(),
            doors: Doors::default(),
            caller_octets: 0,
            peers: Peers::default(),
            gossip: Gossip::default(),
            seen: HashMap::default(),
            seeds: Seeds::default(),
            neighbours: HashMap::new(),
            left_out: BTreeMap::new(),
            call_backs: CallBacks::default(),
            post: Post::new(&config.http),
            recent: Recent::default(),
            dials: HashMap::new(),
            locals: HashMap::default(),
            pending: Numbered::default(),
            deliveries: Numbered::default(),
            passing: Sequence::default(),
            deadlines: Deadlines::default(),
            held: Held::default(),
            backlog: Backlog::default(),
            lately: Lately::default(),
            outbox: Outbox::default(),
            dropped: AllDropped::new(),
            late: Late::default(),
            tap: None,
            timers: BTreeSet::new(),
            outputs: VecDeque::new(),
            random: fastrand::Rng::with_seed(config.seed),
            next_id: 0,
            stamps: Stamps::new(config.instance),
            spare: Envelope::default(),
            patterns: Patterns::default(),
            front: BytesMut::new(),
            turn: 0,
            touched: Vec::new(),
            closing: false,
            config,
        }
    }

    /// What it was made with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// How many letters are on their way.
    pub fn letters_under_way(&self) -> usize {
        self.deliveries.len() + self.passing.len()
    }

    fn id(&mut self) -> u64 {
        self.next_id += 1;
        self.next_id
    }

    fn notice(&mut self, notice: Notice) {
        self.outputs.push_back(Output::Notice(notice));
    }

    fn timer(&mut self, at: Duration, timer: Timer) {
        self.timers.insert((at, timer));
    }

    fn fire_timers(&mut self, now: Now) {
        while let Some((at, timer)) = self.timers.pop_first() {
            if at > now.mono {
                self.timers.insert((at, timer));
                break;
            }
            match timer {
                Timer::Caller(conn) => self.caller_timeout(now, conn),
                Timer::Conn(conn) => self.conn_timeout(now, conn),
                Timer::Peer(instance) => self.peer_timeout(now, instance),
                Timer::Seed(seed) => self.seed_timeout(now, seed),
                Timer::Seen(instance) => self.seen_timeout(now, instance),
                Timer::Held => self.held_timeout(now),
                Timer::Gossip => self.gossip_timeout(now),
                Timer::Room(receiver) => self.room_timeout(now, &receiver),
                Timer::Mailboxes => self.tidy_mailboxes(),
                Timer::Outbox => self.outbox_timeout(now),
            }
        }
    }

    /// A copy is to be looked at then, and not at the time that was set before.
    fn set_timer_of(&mut self, id: u64, at: Duration) {
        if let Some(delivery) = self.deliveries.get_mut(&id) {
            delivery.timer = at;
            self.note_timer(id, at);
        }
    }

    fn note_timer(&mut self, id: u64, at: Duration) {
        let (deliveries, passing) = (&self.deliveries, &self.passing);
        let is_open = |at, id| passing.contains(id) || has_timer(deliveries, at, id);
        let open = deliveries.len() + passing.len();
        self.deadlines.note(at, id, open, is_open);
    }
}

impl Machine for Mts {
    fn connected(&mut self, now: Now, connected: Connected) {
        self.open_conn(now, connected);
    }

    fn dial_failed(&mut self, now: Now, dial: DialId, reason: &str) {
        if let Some(purpose) = self.dials.remove(&dial) {
            self.dial_ended(now, purpose, reason);
        } else {
            self.post_dial_failed(now, dial, reason);
        }
    }

    fn called_back(&mut self, now: Now, call: u64, calls: Vec<CallBack>) {
        self.answer_call_back(now, call, calls);
    }

    fn received(&mut self, now: Now, conn: ConnId, octets: &mut BytesMut) {
        self.read_conn(now, conn, octets);
        self.publish_changes(now);
    }

    fn received_on(
        &mut self,
        now: Now,
        conn: ConnId,
        lane: Urgency,
        octets: &mut BytesMut,
    ) -> bool {
        let wanted = self.read_lane(now, conn, lane, octets);
        self.publish_changes(now);
        wanted
    }

    fn closed(&mut self, now: Now, conn: ConnId, ended: Ended<'_>) {
        self.doors.leave(conn);
        if self.post.has_conn(conn) {
            self.post_closed(now, conn, ended);
        } else {
            self.caller_ended(now, conn, ended);
            self.drop_conn(now, conn, ended.reason);
        }
        self.publish_changes(now);
    }

    fn poll_transmit(&mut self, now: Now, conn: ConnId) -> Option<Bytes> {
        self.refill(now, conn);
        match self.conns.get_mut(&conn) {
            Some(open) => open.poll_transmit(),
            None => self.post.poll_transmit(conn),
        }
    }

    fn poll_transmit_on(&mut self, now: Now, conn: ConnId, lane: Urgency) -> Option<Bytes> {
        self.refill(now, conn);
        self.conns.get_mut(&conn)?.poll_transmit_on(lane)
    }

    fn posted(&mut self, now: Now, post: PostId, result: Result<TakenOver, PostFailure>) {
        self.post_answered(now, post, result);
    }

    fn poll_timeout(&self) -> Option<Duration> {
        let first = self.timers.first().map(|(at, _)| *at);
        let others = [self.deadlines.next(), self.directory.poll_timeout()];
        others.into_iter().flatten().chain(first).min()
    }

    fn handle_timeout(&mut self, now: Now) {
        let due = |mts: &mut Mts| {
            let (deliveries, passing) = (&mts.deliveries, &mts.passing);
            let is_open = |at, id| passing.contains(id) || has_timer(deliveries, at, id);
            mts.deadlines.take_due(now.mono, is_open)
        };
        self.fire_timers(now);
        while let Some(id) = due(self) {
            self.delivery_timeout(now, id);
            self.fire_timers(now);
        }
        self.directory.handle_timeout(now);
        self.publish_changes(now);
    }

    fn poll_output(&mut self) -> Option<Output> {
        let output = self.outputs.pop_front();
        if output.is_none() && self.outputs.capacity() > IDLE_OUTPUTS {
            self.outputs = VecDeque::new();
        }
        output
    }

    fn register(&mut self, now: Now, ticket: u64, registration: Registration) {
        let mailbox = Mailbox::new(self.config.mailbox_letters, self.config.queue_octets);
        let result = self.add_local(now, registration, Local::Mailbox(mailbox));
        self.outputs
            .push_back(Output::Registered { ticket, result });
        self.publish_changes(now);
    }

    fn deregister(&mut self, now: Now, name: &str) {
        self.remove_local(now, name);
        self.publish_changes(now);
    }

    fn leave(&mut self, now: Now, ticket: u64, name: &str) {
        self.leave_local(now, ticket, name);
        self.publish_changes(now);
    }

    fn submit(&mut self, now: Now, submission: Submission) {
        let until = submission.until_reply_by(now);
        let Submission {
            ticket,
            letter,
            timeout,
            transports,
            patient,
            ..
        } = submission;
        let origin = Origin::Ticket(ticket);
        if until == Some(Duration::ZERO) {
            if self.tap.is_some() {
                self.tap_refused(now, &letter);
            }
            let reason = Text::from_static(REPLY_BY);
            self.answer_whole(now, origin, Outcome::Expired, reason);
            return;
        }
        let Letter { envelope, payload } = letter;
        let mut head = Encoded::new();
        if let Err(error) = bit_efficient::encode_envelope(&envelope, &mut head) {
            let reason = Text::from(error.to_string());
            self.answer_whole(now, origin, Outcome::Refused, reason);
            return;
        }
        let head = head.take_bytes();
        let inbound = Inbound {
            payload: head.len(),
            parts: smallvec![head, payload],
            envelope,
            from: None,
            via: None,
            names: Names::Patterns,
        };
        let terms = Terms {
            timeout: until.unwrap_or(timeout).min(timeout),
            expires: until.is_some_and(|left| left <= timeout),
            transports,
            patient,
            ..Terms::within(timeout)
        };
        self.take_in(now, origin, inbound, terms);
        self.publish_changes(now);
    }

    fn take_mail(&mut self, name: &str) -> Option<Letter> {
        match self.locals.get_mut(name)? {
            Local::Mailbox(mailbox) => mailbox.pop(),
            Local::Program(_) => None,
        }
    }

    fn directory(&self) -> &Directory {
        &self.directory
    }

    fn service_name(&self) -> Text {
        self.config.name.clone()
    }

    fn sniff(&mut self, now: Now, on: bool) {
        self.own_watches(now, on);
    }

    fn revoked(&mut self, now: Now, list: Bytes) {
        self.tell_revoked(now, list);
    }

    fn shutdown(&mut self, now: Now) {
        self.closing = true;
        self.end_tap(now);
        let conns: Vec<ConnId> = self.conns.keys().copied().collect();
        for conn in conns {
            self.part(now, conn, connections::SHUTDOWN);
        }
        let callers = std::mem::take(&mut self.callers);
        self.outputs.extend(callers.into_keys().map(Output::Close));
        self.caller_octets = 0;
        self.end_post();
    }
}

impl Mts {
    fn add_local(
        &mut self,
        now: Now,
        registration: Registration,
        local: Local,
    ) -> Result<(), RegisterError> {
        let Registration {
            name,
            kind,
            description,
        } = registration;
        if !name.is_word() {
            return Err(RegisterError::Name(name));
        }
        if self.locals.contains_key(&name) {
            return Err(RegisterError::Held(name));
        }
        if let Some(refusal) = self.local_refusal(&name) {
            return Err(refusal);
        }
        let octets = name.len() + kind.len() + description.len();
        if octets > MAX_ENTRY {
            let reason = format!(
                "name, type and description have {octets} octets together, {MAX_ENTRY} are allowed"
            );
            return Err(RegisterError::Refused(Text::from(reason)));
        }
        let description = match description.is_empty() {
            true => Text::from(format!("Message client of {}", self.config.name)),
            false => description,
        };
        let entry = fipa_directory::Entry {
            name: name.clone(),
            kind,
            locations: self.own_locations(),
            description,
            timestamp: now.unix_millis,
        };
        self.locals.insert(name, local);
        let owner = self.config.instance;
        self.directory
            .put(now, owner, fipa_directory::Source::Local, entry);
        Ok(())
    }

    fn remove_local(&mut self, now: Now, name: &str) -> Option<Local> {
        let local = self.locals.remove(name)?;
        self.left_out.remove(name);
        self.directory.remove(now, self.config.instance, name);
        Some(local)
    }
}
