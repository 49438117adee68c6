//! Connections: from the first octet to the hello, from the last frame to the end.

use std::collections::HashSet;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{Address, InstanceId, Now};
use fipa_link::{Event, Frame, Hello, LetterFrame, Link, LinkConfig, ReceiverOutcome, Role};

use super::call_backs::Asker;
use super::dialling::Purpose;
use super::fleet::{FLEET, NAME};
use super::passing::Ways;
use super::peers::{MAX_OUTSTANDING, WINDOW};
use super::sync::Unfinished;
use super::{Mts, Timer};
use crate::Urgency;
use crate::machine::{ConnId, Connected, Notice, Output};

/// The goodbye of a service that ends: its agents are gone with it.
pub(super) const SHUTDOWN: &str = "the service ends";

/// The goodbye on the younger of two links between the same two services.
pub(super) const DUPLICATE: &str = "there is another link between us";

/// The answer to [`DUPLICATE`] of a service that does not have the other link, or not any more.
pub(super) const ONLY: &str = "this is the only link between us";

/// The goodbye to a service of another fleet.
pub(super) const SCOPE: &str = "another scope";

/// The goodbye of a service that was called by itself.
const MYSELF: &str = "this is the service itself";

/// Octets beside letters that may wait to be written: whoever does not read them is given up.
const UNREAD: usize = 16 << 20;

/// Why who does not read is given up.
const DEAF: &str = "it does not read what it is sent";

/// How long a service of ours may take for its hello at an address that came with a letter. A
/// service of another make reads until the end of the stream, and does nothing else meanwhile.
const PROBE: Duration = Duration::from_secs(2);

/// Numbers of letters that wait for their receipts, in no order.
pub(super) type Outstanding = HashSet<u64, foldhash::fast::RandomState>;

/// A connection.
#[derive(Debug)]
pub(super) struct Conn {
    pub(super) link: Link,
    /// Where it was dialled to.
    pub(super) address: Option<Address>,
    /// What the receipts of letters name that go out on it.
    pub(super) via: Text,
    purpose: Option<Purpose>,
    /// Nothing has come over it yet.
    mute: bool,
    control: bool,
    pub(super) same_host: bool,
    pub(super) remote: Text,
    /// The robot whose certificate the partner has shown.
    pub(super) identity: Option<Text>,
    pub(super) partner: Partner,
    /// Letters that went out on it and wait for their receipts.
    pub(super) outstanding: Outstanding,
    /// How many more of them pass.
    pub(super) passing: usize,
    /// The ways of those that come over it.
    pub(super) ways: Ways,
    touched: Touched,
    /// No new letters go out on it; it closes once it has nothing outstanding.
    pub(super) retired: bool,
    /// We have said that it is the only link while another one was being greeted, which the partner
    /// may have already.
    pub(super) claimed: bool,
    /// A part of the partner's directory that is not whole yet.
    pub(super) unfinished: Option<Unfinished>,
    /// Letters wait for the peer because too much waits to be written here, or for receipts.
    pub(super) starved: bool,
    /// An [`Output::Transmit`] is under way.
    announced: bool,
    /// Why we have closed it, while the rest is written.
    parted: Option<&'static str>,
    /// Its timer; one that fires earlier is of no use any more.
    timer: Duration,
}

/// What is known of the other end before it says anything.
#[derive(Clone, Debug)]
pub(super) struct FarEnd {
    pub(super) same_host: bool,
    /// Where it is, for people.
    pub(super) remote: Text,
    /// The robot whose certificate it has shown.
    pub(super) identity: Option<Text>,
    /// Whether there are streams for letters beside the main one.
    pub(super) lanes: bool,
}

/// Who is at the other end.
#[derive(Debug)]
pub(super) enum Partner {
    /// Nobody has said hello yet.
    Unknown,
    /// Another message transport service.
    Daemon {
        instance: InstanceId,
        max_letter: u64,
    },
    /// A program.
    Program {
        instance: InstanceId,
        name: Text,
        max_letter: u64,
    },
}

/// Whether something was done on a connection that is to be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Touched {
    No,
    Written,
    /// Receipts came: there may be room.
    Freed,
}

impl Conn {
    /// Whether we have not closed it.
    pub(super) fn is_whole(&self) -> bool {
        self.parted.is_none()
    }

    /// Whether enough is under way to a peer for a letter of this urgency to wait.
    pub(super) fn is_busy(&self, urgency: Urgency) -> bool {
        let outstanding = self.outstanding.len() + self.passing;
        self.link.queued_on(urgency.number()) >= WINDOW || outstanding >= MAX_OUTSTANDING
    }

    /// Whether a letter of so many octets may be written where so many may wait to be written.
    pub(super) fn takes(&self, octets: usize, max_octets: usize) -> bool {
        match self.partner {
            Partner::Unknown => false,
            Partner::Program { max_letter, .. } | Partner::Daemon { max_letter, .. } => {
                octets as u64 <= max_letter && self.link.queued() <= max_octets
            }
        }
    }

    /// Whether it is to be written now; to a program it always is.
    pub(super) fn has_room(&mut self) -> bool {
        if let Partner::Program { .. } = self.partner {
            return true;
        }
        // Letters pass between links without lanes only: none waits on one of its own.
        self.starved = self.is_busy(Urgency::default());
        !self.starved
    }

    /// Notes that something was written, or that a receipt came.
    pub(super) fn touch(&mut self, all: &mut Vec<ConnId>, conn: ConnId, freed: bool) {
        let touched = if freed {
            Touched::Freed
        } else {
            Touched::Written
        };
        if self.touched == Touched::No {
            all.push(conn);
        }
        self.touched = self.touched.max(touched);
    }

    /// Whether receipts came since this was asked last.
    pub(super) fn take_touch(&mut self) -> bool {
        std::mem::replace(&mut self.touched, Touched::No) == Touched::Freed
    }

    pub(super) fn poll_transmit(&mut self) -> Option<Bytes> {
        let part = self.link.poll_transmit();
        if part.is_none() {
            self.announced = false;
        }
        part
    }

    pub(super) fn poll_transmit_on(&mut self, lane: Urgency) -> Option<Bytes> {
        let part = self.link.poll_transmit_on(lane.number());
        if part.is_none() {
            self.announced = false;
        }
        part
    }
}

impl Mts {
    pub(super) fn open_conn(&mut self, now: Now, connected: Connected) {
        let (conn, control) = (connected.conn, connected.control);
        let far = FarEnd {
            same_host: connected.same_host,
            remote: connected.remote.clone(),
            identity: connected.identity.clone(),
            lanes: connected.lanes,
        };
        match connected.dialled.clone() {
            Some((dial, _)) if self.post.has_dial(dial) => self.post_connected(now, conn, dial),
            _ if self.closing => self.outputs.push_back(Output::Close(conn)),
            Some((dial, address)) => {
                let purpose = self.dials.remove(&dial);
                self.open_link(now, conn, Some((purpose, address)), control, far);
            }
            None if control => self.open_link(now, conn, None, control, far),
            None if self.let_in(&connected) => self.called(now, conn, far),
            None => {}
        }
    }

    /// Greets whoever is at the other end of a connection that is to be a link.
    pub(super) fn open_link(
        &mut self,
        now: Now,
        conn: ConnId,
        dialled: Option<(Option<Purpose>, Address)>,
        control: bool,
        far: FarEnd,
    ) {
        let mut hello = self.hello(now, far.same_host, control);
        // What has lanes is QUIC, which lets nothing through that was changed on its way.
        hello.checks &= !far.lanes;
        let mut config = LinkConfig::new(hello);
        config.lanes = far.lanes;
        if let Some((Some(Purpose::Seed(seed)), _)) = dialled
            && self.is_given_with_letter(seed)
        {
            config.hello_timeout = PROBE;
        }
        let link = Link::new(config, now);
        self.add_conn(conn, link, dialled, control, far);
        self.announce_transmit(conn);
    }

    /// Adds a connection whose partner is still to say who it is.
    pub(super) fn add_conn(
        &mut self,
        conn: ConnId,
        link: Link,
        dialled: Option<(Option<Purpose>, Address)>,
        control: bool,
        far: FarEnd,
    ) {
        let FarEnd {
            same_host,
            remote,
            identity,
            lanes: _,
        } = far;
        let (purpose, address) = match dialled {
            Some((purpose, address)) => (purpose, Some(address)),
            None => (None, None),
        };
        let timer = link.poll_timeout();
        self.timer(timer, Timer::Conn(conn));
        self.conns.insert(
            conn,
            Box::new(Conn {
                link,
                via: address
                    .as_ref()
                    .map_or(Text::from_static("local"), Address::to_text),
                address,
                purpose,
                mute: true,
                control,
                same_host,
                remote,
                identity,
                partner: Partner::Unknown,
                outstanding: Outstanding::default(),
                passing: 0,
                ways: Ways::default(),
                touched: Touched::No,
                retired: false,
                claimed: false,
                unfinished: None,
                starved: false,
                announced: false,
                parted: None,
                timer,
            }),
        );
    }

    /// Reads whatever frames are whole.
    pub(super) fn read_conn(&mut self, now: Now, conn: ConnId, octets: &mut BytesMut) {
        if self.callers.contains_key(&conn) && !self.read_caller(now, conn, octets) {
            return;
        }
        loop {
            let Some(open) = self.conns.get_mut(&conn) else {
                octets.clear();
                return;
            };
            open.mute &= octets.is_empty();
            if let Some(run) = open.link.receive_run(now, octets) {
                match self.read_run(now, conn, run) {
                    Ok(()) => continue,
                    Err(error) => return self.give_up(now, conn, &error.to_string()),
                }
            }
            match open.link.receive(now, octets) {
                Ok(None) => break,
                Ok(Some(event)) => self.on_event(now, conn, event),
                Err(error) => {
                    self.give_up(now, conn, &error.to_string());
                    return;
                }
            }
        }
        self.announce_transmit(conn);
    }

    /// Reads whatever letters are whole on a lane. Whether more is wanted there.
    pub(super) fn read_lane(
        &mut self,
        now: Now,
        conn: ConnId,
        lane: Urgency,
        octets: &mut BytesMut,
    ) -> bool {
        // It is no link yet.
        if self.callers.contains_key(&conn) {
            return false;
        }
        loop {
            let Some(open) = self.conns.get_mut(&conn) else {
                octets.clear();
                return true;
            };
            match open.link.receive_on(now, lane.number(), octets) {
                Ok(None) => break,
                Ok(Some(event)) => self.on_event(now, conn, event),
                Err(error) => {
                    self.give_up(now, conn, &error.to_string());
                    return true;
                }
            }
        }
        self.announce_transmit(conn);
        let open = self.conns.get(&conn);
        open.is_none_or(|open| !open.link.is_held(lane.number()))
    }

    pub(super) fn conn_timeout(&mut self, now: Now, conn: ConnId) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        if open.timer > now.mono {
            return;
        }
        match open.link.handle_timeout(now) {
            Ok(event) => {
                open.timer = open.link.poll_timeout();
                let at = open.timer;
                self.timer(at, Timer::Conn(conn));
                self.announce_transmit(conn);
                if let Some(event) = event {
                    self.on_event(now, conn, event);
                }
            }
            Err(error) => {
                let probed = match open.purpose {
                    Some(Purpose::Seed(seed)) if open.mute => Some(seed),
                    _ => None,
                };
                let probed = probed.filter(|seed| self.is_given_with_letter(*seed));
                if let Some(seed) = probed {
                    self.seed_is_mute(now, seed);
                }
                self.give_up(now, conn, &error.to_string());
            }
        }
    }

    /// Queues a frame.
    pub(super) fn send(&mut self, now: Now, conn: ConnId, frame: Frame) {
        if let Some(open) = self.conns.get_mut(&conn) {
            open.link.send(now, frame);
            self.was_queued(conn);
        }
    }

    /// Queues a letter.
    pub(super) fn send_letter(
        &mut self,
        now: Now,
        conn: ConnId,
        urgency: Urgency,
        letter: LetterFrame,
    ) {
        if let Some(open) = self.conns.get_mut(&conn) {
            open.link.send_letter(now, urgency.number(), letter);
            self.was_queued(conn);
        }
    }

    /// Queues what became of a letter that came over a connection.
    pub(super) fn send_receipt(
        &mut self,
        now: Now,
        conn: ConnId,
        id: u64,
        outcomes: &[ReceiverOutcome],
    ) {
        if let Some(open) = self.conns.get_mut(&conn) {
            open.link.send_receipt(now, id, outcomes);
            self.was_queued(conn);
        }
    }

    pub(super) fn was_queued(&mut self, conn: ConnId) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        let most = self.config.queue_octets.max(self.config.max_letter) + UNREAD;
        match open.link.queued() > most && open.parted.is_none() {
            true => {
                open.parted = Some(DEAF);
                self.outputs.push_back(Output::Abort(conn));
            }
            false => self.announce_transmit(conn),
        }
    }

    /// Says goodbye and closes.
    pub(super) fn part(&mut self, now: Now, conn: ConnId, reason: &'static str) {
        self.send(now, conn, Frame::Goodbye(Text::from_static(reason)));
        self.part_silently(conn, reason);
    }

    /// Closes once what waits is written.
    pub(super) fn part_silently(&mut self, conn: ConnId, reason: &'static str) {
        self.announce_transmit(conn);
        if let Some(open) = self.conns.get_mut(&conn) {
            open.parted = Some(reason);
        }
        self.outputs.push_back(Output::Close(conn));
    }

    /// Closes a connection because of what came, or did not come, over it.
    fn give_up(&mut self, now: Now, conn: ConnId, reason: &str) {
        self.outputs.push_back(Output::Close(conn));
        self.drop_conn(now, conn, reason);
    }

    /// Forgets a connection that has ended, and does what follows from that.
    pub(super) fn drop_conn(&mut self, now: Now, conn: ConnId, reason: &str) {
        let Some(mut closed) = self.conns.remove(&conn) else {
            return;
        };
        if closed.passing > 0 {
            let unfolded = self.unfold_all(|_, sent| sent == Some(conn));
            closed.outstanding.extend(unfolded);
        }
        // Which link stays is settled once one of them has ended.
        self.conns
            .values_mut()
            .for_each(|open| open.claimed = false);
        let reason = closed.parted.unwrap_or(reason);
        match closed.partner {
            Partner::Unknown => {
                let with = match &closed.address {
                    Some(address) => address.to_text(),
                    None => Text::from_static("a caller"),
                };
                // An address is dialled again and again: what is known of it is not told anew.
                let told = closed
                    .parted
                    .is_some_and(|reason| [FLEET, NAME].contains(&reason));
                if !told
                    && closed
                        .purpose
                        .is_none_or(|p| self.dial_error(p) != Some(reason))
                {
                    let reason = Text::from(reason);
                    self.notice(Notice::LinkFailed { with, reason });
                }
                if let Some(purpose) = closed.purpose {
                    self.dial_ended(now, purpose, reason);
                }
            }
            Partner::Program { .. } => {
                self.watchers.remove(&conn);
                self.program_is_gone(conn);
                self.forget_call_backs(conn);
                self.program_ended(now, conn, closed.outstanding);
            }
            Partner::Daemon { instance, .. } => {
                self.end_call_backs(now, instance);
                self.peer_conn_ended(now, instance, conn, closed.outstanding, reason);
            }
        }
    }

    pub(super) fn announce_transmit(&mut self, conn: ConnId) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        if open.link.queued() > 0 && !std::mem::replace(&mut open.announced, true) {
            self.outputs.push_back(Output::Transmit(conn));
        }
        // The heartbeat quickens with the first letter.
        let at = open.link.poll_timeout();
        if at < open.timer {
            open.timer = at;
            self.timer(at, Timer::Conn(conn));
        }
    }

    /// Where a partner on this host or on another is told that we are.
    pub(super) fn endpoints_for(&self, same_host: bool) -> Vec<Text> {
        let told = |address: &&Address| same_host || address.is_for_others();
        let endpoints = self.config.endpoints.iter().filter(|own| own.is_link());
        let endpoints = endpoints.filter(told);
        endpoints.map(Address::to_text).collect()
    }

    pub(super) fn hello(&self, now: Now, same_host: bool, control: bool) -> Hello {
        Hello {
            version: Hello::VERSION,
            role: Role::Daemon,
            instance: self.config.instance,
            name: self.config.name.clone(),
            scope: self.config.scope.clone(),
            endpoints: self.endpoints_for(same_host),
            max_letter: self.config.max_letter as u64,
            unix_millis: now.unix_millis,
            checks: !control,
        }
    }

    fn on_event(&mut self, now: Now, conn: ConnId, event: Event) {
        match event {
            Event::Opened(hello) => self.on_hello(now, conn, hello),
            Event::Frame(frame) => self.on_frame(now, conn, frame),
            Event::Silent => self.peer_silent(now, conn, true),
            Event::Heard => self.peer_silent(now, conn, false),
        }
    }

    fn on_hello(&mut self, now: Now, conn: ConnId, hello: Hello) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        if open.parted.is_some() {
            return;
        }
        let purpose = open.purpose;
        match hello.role {
            Role::Program if open.control => {
                open.partner = Partner::Program {
                    instance: hello.instance,
                    name: hello.name,
                    max_letter: hello.max_letter,
                };
                self.end_earlier_conn(now, conn, hello.instance);
            }
            Role::Program => self.part(now, conn, "programs attach on the control socket"),
            Role::Daemon if hello.instance == self.config.instance => {
                self.seed_is_myself(now, purpose);
                self.part(now, conn, MYSELF);
            }
            Role::Daemon if hello.scope != self.config.scope => {
                self.part(now, conn, SCOPE);
            }
            Role::Daemon => {
                if let Some(reason) = self.link_refusal(conn, hello.instance, &hello.name) {
                    return self.part(now, conn, reason);
                }
                let Some(open) = self.conns.get_mut(&conn) else {
                    return;
                };
                open.partner = Partner::Daemon {
                    instance: hello.instance,
                    max_letter: hello.max_letter,
                };
                open.purpose = None;
                self.peer_conn_opened(now, conn, hello, purpose);
            }
        }
    }

    /// A program that calls again has given up its earlier connection, whose end may come late: it
    /// is not to be refused what it holds there.
    fn end_earlier_conn(&mut self, now: Now, conn: ConnId, program: InstanceId) {
        let same = |partner: &Partner| match partner {
            Partner::Program { instance, .. } => *instance == program,
            _ => false,
        };
        let earlier: Vec<ConnId> = self
            .conns
            .iter()
            .filter(|(other, open)| **other != conn && same(&open.partner))
            .map(|(other, _)| *other)
            .collect();
        for other in earlier {
            self.give_up(now, other, "the program has called again");
        }
    }

    pub(super) fn on_frame(&mut self, now: Now, conn: ConnId, frame: Frame) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        match (frame, &mut open.partner) {
            (Frame::Goodbye(reason), _) => self.on_goodbye(now, conn, &reason),
            (Frame::Letter(letter), _) => self.letter_received(now, conn, letter),
            (Frame::Receipt { id, outcomes }, _) => self.receipt(now, conn, id, outcomes),
            (Frame::Directory(directory), Partner::Daemon { instance, .. }) => {
                let instance = *instance;
                self.peer_directory(now, conn, instance, directory);
            }
            (Frame::Platforms(platforms), Partner::Daemon { instance, .. }) => {
                let instance = *instance;
                self.hear_platforms(now, conn, instance, platforms);
            }
            (Frame::Revoked(list), Partner::Daemon { .. }) if open.identity.is_some() => {
                self.outputs.push_back(Output::Revoked(list));
            }
            (Frame::Watch, Partner::Program { .. }) => {
                self.watchers.insert(conn);
                self.send_everything(now, conn);
            }
            (Frame::AskFacts, Partner::Program { .. }) => {
                let facts = self.facts(now);
                self.send(now, conn, Frame::Facts(facts));
            }
            (Frame::Sniff(on), Partner::Program { .. }) => self.program_watches(now, conn, on),
            (Frame::AskCallBack(ask), Partner::Program { .. }) => {
                let asker = Asker::Program(conn, ask.request);
                self.pass_call_back_on(now, asker, ask.whom);
            }
            (Frame::AskCallBack(ask), Partner::Daemon { instance, .. }) => {
                let instance = *instance;
                self.call_back(now, conn, instance, ask);
            }
            (Frame::CalledBack(called), Partner::Daemon { instance, .. }) => {
                let instance = *instance;
                self.was_called_back(now, instance, called);
            }
            (
                Frame::Attach {
                    request,
                    name,
                    kind,
                    description,
                },
                Partner::Program { .. },
            ) => self.attach(now, conn, request, name, kind, description),
            (Frame::Detach { request, name }, Partner::Program { .. }) => {
                self.detach(now, conn, request, &name);
            }
            // A frame that makes no sense from this partner is passed over, as an unknown one is.
            _ => {}
        }
    }

    fn on_goodbye(&mut self, now: Now, conn: ConnId, reason: &str) {
        match reason {
            DUPLICATE if self.is_only_link(conn) => {
                self.send(now, conn, Frame::Goodbye(Text::from_static(ONLY)));
                let mut conns = self.conns.values();
                let greeting = conns.any(|open| matches!(open.partner, Partner::Unknown));
                if let Some(open) = self.conns.get_mut(&conn) {
                    open.claimed = greeting;
                }
            }
            DUPLICATE => self.retire(now, conn),
            ONLY => self.keep_this_link(now, conn),
            SHUTDOWN => {
                if let Some(open) = self.conns.get(&conn)
                    && let Partner::Daemon { instance, .. } = open.partner
                {
                    self.peer_said_goodbye(now, instance);
                }
                self.outputs.push_back(Output::Close(conn));
                self.drop_conn(now, conn, reason);
            }
            _ => self.give_up(now, conn, &format!("it refused: {reason}")),
        }
    }
}
