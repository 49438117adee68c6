//! The program's end of a control link.

use std::collections::{BTreeSet, HashMap, VecDeque};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Envelope, Letter, Text};
use fipa_codec::{Output as Encoded, bit_efficient};
use fipa_directory::{Directory, InstanceId, Now, Record};
use fipa_link::{
    AskCallBack, DirectoryFrame, Event, Frame, Hello, LetterFrame, Link, LinkConfig, Outcome,
    Outcomes, ReceiverOutcome, Role,
};

use crate::machine::{
    ConnId, Connected, DialId, Ended, Machine, Notice, Output, REPLY_BY, RegisterError,
    Registration, Submission,
};
use crate::mailbox::{Lately, TIDY};
use crate::mts::record_of;
use crate::outbox::{Copies, LetterId};
use crate::pieces::{joined, read_envelope};
use crate::{Mailbox, ProgramConfig};

/// The pause between two dials of a daemon that is not there.
const PAUSE: Duration = Duration::from_millis(100);

/// How much longer than a letter's sender we wait: the daemon's own answer, with its reason, comes
/// before we give up.
const MARGIN: Duration = Duration::from_millis(500);

/// A program that attaches agents to a daemon.
///
/// When the daemon ends it is looked for, and the agents are attached again; letters of which
/// nothing is known then are reported as such, and never sent twice.
#[derive(Debug)]
pub struct Program {
    config: ProgramConfig,
    directory: Directory,
    /// Owners and names that a snapshot under way has brought.
    snapshot: Option<Vec<Record>>,
    /// A whole snapshot has come.
    directory_known: bool,
    sniffing: bool,
    service: Text,
    /// Octets of the largest letter that the daemon takes.
    daemon_max: u64,
    conn: Option<(ConnId, Link)>,
    open: bool,
    ever_open: bool,
    announced: bool,
    agents: HashMap<Text, Attached>,
    /// Letters of other platforms that our agents have got: a daemon that was started anew does not
    /// know what the one before it has delivered.
    copies: Copies,
    /// Attach requests that wait for their answers: the name, and the ticket of the first time.
    requests: HashMap<u64, (Text, Option<u64>)>,
    /// Detach requests of agents whose mail is wanted: the ticket, and the name.
    leaving: HashMap<u64, (u64, Text)>,
    letters: HashMap<u64, Sent>,
    deadlines: BTreeSet<(Duration, u64)>,
    /// Letters handed in while the daemon was not there.
    waiting: VecDeque<u64>,
    redial: Option<Duration>,
    lost_since: Option<Duration>,
    given_up: bool,
    link_timer: Option<Duration>,
    /// Agents in whose mailboxes letters came lately, and when these are tidied.
    lately: Lately,
    tidy_at: Option<Duration>,
    outputs: VecDeque<Output>,
    next_id: u64,
}

#[derive(Debug)]
struct Attached {
    registration: Registration,
    mailbox: Mailbox,
}

#[derive(Debug)]
struct Sent {
    ticket: u64,
    parts: Vec<Bytes>,
    deadline: Duration,
    /// Its reply-by is what ends it.
    expires: bool,
    transmitted: bool,
}

impl Program {
    /// A program that dials its daemon at once.
    pub fn new(config: ProgramConfig, now: Now) -> Program {
        let mut program = Program {
            directory: Directory::new(),
            snapshot: None,
            directory_known: false,
            sniffing: false,
            service: Text::default(),
            daemon_max: u64::MAX,
            conn: None,
            open: false,
            ever_open: false,
            announced: false,
            agents: HashMap::new(),
            copies: Copies::default(),
            requests: HashMap::new(),
            leaving: HashMap::new(),
            letters: HashMap::new(),
            deadlines: BTreeSet::new(),
            waiting: VecDeque::new(),
            redial: None,
            lost_since: Some(now.mono),
            given_up: false,
            link_timer: None,
            lately: Lately::default(),
            tidy_at: None,
            outputs: VecDeque::new(),
            next_id: 0,
            config,
        };
        program.dial();
        program
    }

    /// Whether the daemon has sent its directory since the program met it first.
    pub fn has_directory(&self) -> bool {
        self.directory_known
    }

    /// Asks the daemon what there is to know for somebody who looks for a fault; answered by
    /// [`Output::Facts`]. A daemon that is not there, or is too old, does not answer.
    pub fn ask_facts(&mut self, now: Now) {
        self.send(now, Frame::AskFacts);
    }

    /// Asks the daemon to have itself called back by the service `whom`; answered by
    /// [`Output::CalledBack`]. A daemon or a service that is not there, or is too old, does not
    /// answer.
    pub fn ask_call_back(&mut self, now: Now, ticket: u64, whom: InstanceId) {
        let ask = AskCallBack {
            request: ticket,
            whom,
            addresses: Vec::new(),
        };
        self.send(now, Frame::AskCallBack(ask));
    }

    fn id(&mut self) -> u64 {
        self.next_id += 1;
        self.next_id
    }

    fn dial(&mut self) {
        let dial = DialId(self.id());
        let addresses = vec![self.config.control.clone()];
        self.outputs.push_back(Output::Dial {
            dial,
            addresses,
            link: false,
        });
    }

    fn send(&mut self, now: Now, frame: Frame) {
        if let Some((_, link)) = &mut self.conn {
            link.send(now, frame);
        }
        self.announce_transmit();
    }

    fn announce_transmit(&mut self) {
        let Some((conn, link)) = &self.conn else {
            return;
        };
        self.link_timer = Some(link.poll_timeout());
        if link.queued() > 0 && !std::mem::replace(&mut self.announced, true) {
            self.outputs.push_back(Output::Transmit(*conn));
        }
    }

    fn on_event(&mut self, now: Now, event: Event) {
        match event {
            Event::Opened(hello) => self.on_open(now, hello),
            Event::Frame(frame) => self.on_frame(now, frame),
            // A daemon on this machine that is silent for a while may be stopped: wait for it.
            Event::Silent | Event::Heard => {}
        }
    }

    fn on_open(&mut self, now: Now, hello: Hello) {
        self.service = hello.name;
        self.daemon_max = hello.max_letter;
        self.open = true;
        self.ever_open = true;
        self.lost_since = None;
        self.outputs.push_back(Output::Notice(Notice::DaemonUp));
        if self.config.watch {
            self.send(now, Frame::Watch);
        }
        if self.sniffing {
            self.send(now, Frame::Sniff(true));
        }
        let mut names: Vec<Text> = self.agents.keys().cloned().collect();
        names.sort();
        for name in names {
            self.attach(now, name, None);
        }
        for id in std::mem::take(&mut self.waiting) {
            self.transmit(now, id);
        }
    }

    fn attach(&mut self, now: Now, name: Text, ticket: Option<u64>) {
        let Some(agent) = self.agents.get(&name) else {
            return;
        };
        let Registration {
            kind, description, ..
        } = agent.registration.clone();
        let request = self.id();
        // A request of an earlier link has no answer any more; its ticket goes on with this one.
        let earlier = self.requests.iter().find(|(_, (n, _))| *n == name);
        let earlier = earlier.map(|(request, _)| *request);
        let carried = earlier.and_then(|r| self.requests.remove(&r)?.1);
        self.requests
            .insert(request, (name.clone(), ticket.or(carried)));
        if self.open {
            self.send(
                now,
                Frame::Attach {
                    request,
                    name,
                    kind,
                    description,
                },
            );
        }
    }

    fn on_frame(&mut self, now: Now, frame: Frame) {
        match frame {
            Frame::Letter(letter) => self.on_letter(now, letter),
            Frame::Receipt { id, outcomes } => self.on_receipt(id, outcomes),
            Frame::Answer { request, refusal } => self.on_answer(request, refusal),
            Frame::Directory(directory) => self.on_directory(now, directory),
            Frame::CalledBack(called) => {
                let ticket = called.request;
                self.outputs
                    .push_back(Output::CalledBack { ticket, called });
            }
            Frame::Facts(facts) => self.outputs.push_back(Output::Facts(Box::new(facts))),
            Frame::Sniffed(sniffed) => self.outputs.push_back(Output::Sniffed(sniffed)),
            // The end of the stream follows.
            _ => {}
        }
    }

    /// A letter for one of our agents: its daemon has resolved the receivers to names.
    fn on_letter(&mut self, now: Now, frame: LetterFrame) {
        let id = frame.id;
        let mut parts = frame.parts.into_iter().collect();
        let mut envelope = Envelope::default();
        let outcomes = match read_envelope(&mut parts, &self.config.limits, &mut envelope) {
            Ok(payload) => {
                let letter = Letter {
                    envelope,
                    payload: joined(&parts, payload),
                };
                self.put_into_mailboxes(now, letter)
            }
            Err(error) => {
                let reason = format!("the envelope cannot be read: {error}");
                outcome("", Outcome::Refused, &reason).into()
            }
        };
        self.send(now, Frame::Receipt { id, outcomes });
    }

    fn put_into_mailboxes(&mut self, now: Now, letter: Letter) -> Outcomes {
        let mut outcomes = Outcomes::default();
        let copy = LetterId::of_copy(&letter.envelope);
        for receiver in letter.envelope.intended_receiver() {
            let name = &receiver.name;
            let told = match self.agents.get_mut(name) {
                None => outcome(name, Outcome::Unknown, "the program has no such agent"),
                Some(agent) if self.copies.has(&agent.registration.name, copy) => {
                    outcome(name, Outcome::Delivered, "")
                }
                Some(agent) => match agent.mailbox.push(letter.clone()) {
                    Ok(()) => {
                        self.copies.put(&agent.registration.name, copy);
                        self.outputs.push_back(Output::Mail(name.clone()));
                        if self.lately.note(name) {
                            self.tidy_at = Some(now.mono + TIDY);
                        }
                        outcome(name, Outcome::Delivered, "")
                    }
                    Err(full) => outcome(name, Outcome::Refused, &full.to_string()),
                },
            };
            outcomes.push(told);
        }
        outcomes
    }

    fn on_receipt(&mut self, id: u64, outcomes: Outcomes) {
        if let Some(sent) = self.letters.remove(&id) {
            self.deadlines.remove(&(sent.deadline, id));
            let (ticket, outcomes) = (sent.ticket, outcomes.into());
            self.outputs.push_back(Output::Outcome { ticket, outcomes });
        }
    }

    fn on_answer(&mut self, request: u64, refusal: Text) {
        if let Some((ticket, name)) = self.leaving.remove(&request) {
            self.has_left(ticket, name);
            return;
        }
        let Some((name, ticket)) = self.requests.remove(&request) else {
            return;
        };
        let result = if refusal.is_empty() {
            Ok(())
        } else {
            self.agents.remove(&name);
            Err(RegisterError::Refused(refusal.clone()))
        };
        match (ticket, &result) {
            (Some(ticket), _) => self
                .outputs
                .push_back(Output::Registered { ticket, result }),
            // After a restart of the daemon somebody else was faster.
            (None, Err(_)) => self.outputs.push_back(Output::Notice(Notice::LinkFailed {
                with: name,
                reason: refusal,
            })),
            (None, Ok(())) => {}
        }
    }

    /// The daemon sends nothing more to an agent.
    fn has_left(&mut self, ticket: u64, name: Text) {
        let letters = match self.agents.remove(&name) {
            Some(agent) => agent.mailbox.into_letters(),
            None => Vec::new(),
        };
        self.outputs.push_back(Output::Left {
            ticket,
            name,
            letters,
        });
    }

    fn on_directory(&mut self, now: Now, frame: DirectoryFrame) {
        if frame.snapshot {
            self.snapshot = Some(Vec::new());
        }
        match &mut self.snapshot {
            Some(snapshot) => {
                let records = frame
                    .items
                    .into_iter()
                    .filter_map(|i| record_of(now, i).ok());
                snapshot.extend(records);
                if !frame.more {
                    let records = self.snapshot.take().unwrap_or_default();
                    self.replace_directory(now, records);
                    self.directory_known = true;
                }
            }
            None => {
                for item in frame.items {
                    match record_of(now, item) {
                        Ok(record) => self.directory.put_record(now, record),
                        Err((owner, name)) => {
                            self.directory.remove(now, owner, &name);
                        }
                    }
                }
            }
        }
        self.publish_changes();
    }

    fn replace_directory(&mut self, now: Now, records: Vec<Record>) {
        let kept: BTreeSet<(InstanceId, Text)> = records
            .iter()
            .map(|record| (record.owner, record.entry.name.clone()))
            .collect();
        let gone: Vec<(InstanceId, Text)> = self
            .directory
            .iter()
            .map(|record| (record.owner, record.entry.name.clone()))
            .filter(|key| !kept.contains(key))
            .collect();
        for (owner, name) in gone {
            self.directory.remove(now, owner, &name);
        }
        for record in records {
            self.directory.put_record(now, record);
        }
    }

    fn publish_changes(&mut self) {
        while let Some(change) = self.directory.poll_change() {
            self.outputs.push_back(Output::Directory(change));
        }
    }

    fn transmit(&mut self, now: Now, id: u64) {
        let Some(sent) = self.letters.get_mut(&id) else {
            return;
        };
        let octets: usize = sent.parts.iter().map(Bytes::len).sum();
        if octets as u64 > self.daemon_max {
            let max = self.daemon_max;
            let why = format!("a letter of {octets} octets is larger than the {max} it takes");
            self.on_receipt(id, outcome("", Outcome::Refused, &why).into());
            return;
        }
        if sent.expires && now.mono + MARGIN >= sent.deadline {
            self.on_receipt(id, outcome("", Outcome::Expired, REPLY_BY).into());
            return;
        }
        sent.transmitted = true;
        let left = sent.deadline.saturating_sub(now.mono + MARGIN);
        let frame = LetterFrame {
            id,
            ttl_millis: u32::try_from(left.as_millis()).unwrap_or(u32::MAX),
            parts: std::mem::take(&mut sent.parts).into_iter().collect(),
        };
        self.send(now, Frame::Letter(frame));
    }

    /// The daemon is lost, or was not there: letters that went out have an unknown fate.
    fn lost(&mut self, now: Now, reason: &str) {
        self.conn = None;
        self.open = false;
        self.announced = false;
        self.link_timer = None;
        let mut leaving: Vec<(u64, Text)> = self.leaving.drain().map(|(_, left)| left).collect();
        leaving.sort_unstable();
        for (ticket, name) in leaving {
            self.has_left(ticket, name);
        }
        let since = *self.lost_since.get_or_insert(now.mono);
        let mut fate: Vec<u64> = self
            .letters
            .iter()
            .filter(|(_, sent)| sent.transmitted)
            .map(|(id, _)| *id)
            .collect();
        fate.sort_unstable();
        for id in fate {
            let why = format!("the daemon went away before it said what became of it: {reason}");
            self.on_receipt(id, outcome("", Outcome::Timeout, &why).into());
        }
        if self.given_up {
            return;
        }
        let patience = match self.ever_open {
            true => self.config.patience,
            false => Duration::ZERO,
        };
        if now.mono >= since + patience {
            self.give_up(reason);
            return;
        }
        if since == now.mono {
            let reason = Text::from(reason);
            self.outputs
                .push_back(Output::Notice(Notice::DaemonLost { reason }));
        }
        self.redial = Some(now.mono + PAUSE);
    }

    fn give_up(&mut self, reason: &str) {
        self.given_up = true;
        for id in std::mem::take(&mut self.waiting) {
            let why = "there is no daemon at the control socket";
            self.on_receipt(id, outcome("", Outcome::Timeout, why).into());
        }
        let requests = std::mem::take(&mut self.requests);
        for ticket in requests.into_values().filter_map(|(_, ticket)| ticket) {
            let result = Err(RegisterError::NoDaemon);
            self.outputs
                .push_back(Output::Registered { ticket, result });
        }
        let reason = Text::from(reason);
        self.outputs
            .push_back(Output::Notice(Notice::DaemonGivenUp { reason }));
    }
}

fn outcome(to: &str, outcome: Outcome, reason: &str) -> ReceiverOutcome {
    ReceiverOutcome {
        to: Text::from(to),
        outcome,
        via: None,
        reason: Text::from(reason),
    }
}

impl Machine for Program {
    fn connected(&mut self, now: Now, connected: Connected) {
        let hello = Hello {
            version: Hello::VERSION,
            role: Role::Program,
            instance: self.config.instance,
            name: self.config.name.clone(),
            scope: Text::default(),
            endpoints: Vec::new(),
            max_letter: self.config.max_letter as u64,
            unix_millis: now.unix_millis,
            checks: false,
        };
        let link = Link::new(LinkConfig::new(hello), now);
        self.conn = Some((connected.conn, link));
        self.announced = false;
        self.announce_transmit();
    }

    fn dial_failed(&mut self, now: Now, _dial: DialId, reason: &str) {
        self.lost(now, reason);
    }

    fn received(&mut self, now: Now, conn: ConnId, octets: &mut BytesMut) {
        loop {
            let event = match &mut self.conn {
                Some((open, link)) if *open == conn => link.receive(now, octets),
                _ => return octets.clear(),
            };
            match event {
                Ok(None) => break,
                Ok(Some(event)) => self.on_event(now, event),
                Err(error) => {
                    self.outputs.push_back(Output::Close(conn));
                    self.lost(now, &error.to_string());
                    return;
                }
            }
        }
        self.announce_transmit();
    }

    fn closed(&mut self, now: Now, conn: ConnId, ended: Ended<'_>) {
        if self.conn.as_ref().is_some_and(|(open, _)| *open == conn) {
            self.lost(now, ended.reason);
        }
    }

    fn poll_transmit(&mut self, _now: Now, conn: ConnId) -> Option<Bytes> {
        let (open, link) = self.conn.as_mut()?;
        let part = (*open == conn).then(|| link.poll_transmit())?;
        if part.is_none() {
            self.announced = false;
        }
        part
    }

    fn poll_timeout(&self) -> Option<Duration> {
        let deadline = self.deadlines.first().map(|(at, _)| *at);
        let directory = self.directory.poll_timeout();
        [
            deadline,
            self.redial,
            self.link_timer,
            self.tidy_at,
            directory,
        ]
        .into_iter()
        .flatten()
        .min()
    }

    fn handle_timeout(&mut self, now: Now) {
        self.directory.handle_timeout(now);
        self.publish_changes();
        while let Some((at, id)) = self.deadlines.first().copied() {
            if at > now.mono {
                break;
            }
            let expired = |sent: &Sent| sent.expires && !sent.transmitted;
            let (told, reason) = match self.open {
                _ if self.letters.get(&id).is_some_and(expired) => (Outcome::Expired, REPLY_BY),
                true => (Outcome::Timeout, "the daemon gave no receipt in time"),
                false => (Outcome::Timeout, "there is no daemon at the control socket"),
            };
            self.waiting.retain(|waiting| *waiting != id);
            self.deadlines.remove(&(at, id));
            self.on_receipt(id, outcome("", told, reason).into());
        }
        if self.tidy_at.is_some_and(|at| at <= now.mono) {
            self.tidy_at = None;
            for name in self.lately.take() {
                if let Some(agent) = self.agents.get_mut(&name) {
                    agent.mailbox.detach();
                }
            }
        }
        if self.redial.is_some_and(|at| at <= now.mono) {
            self.redial = None;
            self.dial();
        }
        if self.link_timer.is_some_and(|at| at <= now.mono)
            && let Some((conn, link)) = &mut self.conn
        {
            let conn = *conn;
            match link.handle_timeout(now) {
                Ok(_) => self.announce_transmit(),
                Err(error) => {
                    self.outputs.push_back(Output::Close(conn));
                    self.lost(now, &error.to_string());
                }
            }
        }
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn register(&mut self, now: Now, ticket: u64, registration: Registration) {
        let name = registration.name.clone();
        let refusal = if !name.is_word() {
            Some(RegisterError::Name(name.clone()))
        } else if self.agents.contains_key(&name) {
            Some(RegisterError::Held(name.clone()))
        } else if self.given_up {
            Some(RegisterError::NoDaemon)
        } else {
            None
        };
        if let Some(error) = refusal {
            let result = Err(error);
            self.outputs
                .push_back(Output::Registered { ticket, result });
            return;
        }
        let mailbox = Mailbox::new(self.config.mailbox_letters, self.config.queue_octets);
        self.agents.insert(
            name.clone(),
            Attached {
                registration,
                mailbox,
            },
        );
        self.attach(now, name, Some(ticket));
    }

    fn deregister(&mut self, now: Now, name: &str) {
        let Some((name, _)) = self.agents.remove_entry(name) else {
            return;
        };
        if self.open {
            let request = self.id();
            self.send(now, Frame::Detach { request, name });
        }
    }

    fn leave(&mut self, now: Now, ticket: u64, name: &str) {
        match self.agents.get_key_value(name) {
            Some((name, _)) if self.open => {
                let name = name.clone();
                let request = self.id();
                self.leaving.insert(request, (ticket, name.clone()));
                self.send(now, Frame::Detach { request, name });
            }
            _ => self.has_left(ticket, Text::from(name)),
        }
    }

    fn submit(&mut self, now: Now, submission: Submission) {
        let until = submission.until_reply_by(now);
        let Submission {
            ticket,
            letter,
            timeout,
            ..
        } = submission;
        if until == Some(Duration::ZERO) {
            let outcomes = vec![outcome("", Outcome::Expired, REPLY_BY)];
            self.outputs.push_back(Output::Outcome { ticket, outcomes });
            return;
        }
        let mut head = Encoded::new();
        let refusal = match bit_efficient::encode_envelope(&letter.envelope, &mut head) {
            Ok(()) if letter.payload.len() > self.config.max_letter => Some(format!(
                "a letter of {} octets is larger than the {} that are allowed",
                letter.payload.len(),
                self.config.max_letter
            )),
            Ok(()) => None,
            Err(error) => Some(error.to_string()),
        };
        if let Some(reason) = refusal {
            let outcomes = vec![outcome("", Outcome::Refused, &reason)];
            self.outputs.push_back(Output::Outcome { ticket, outcomes });
            return;
        }
        if self.given_up {
            let reason = "there is no daemon at the control socket";
            let outcomes = vec![outcome("", Outcome::Timeout, reason)];
            self.outputs.push_back(Output::Outcome { ticket, outcomes });
            return;
        }
        let id = self.id();
        let expires = until.is_some_and(|left| left <= timeout);
        let deadline = now.mono + until.unwrap_or(timeout).min(timeout) + MARGIN;
        let parts = vec![head.take_bytes(), letter.payload];
        let sent = Sent {
            ticket,
            parts,
            deadline,
            expires,
            transmitted: false,
        };
        self.letters.insert(id, sent);
        self.deadlines.insert((deadline, id));
        if self.open {
            self.transmit(now, id);
        } else {
            self.waiting.push_back(id);
        }
    }

    fn take_mail(&mut self, name: &str) -> Option<Letter> {
        self.agents.get_mut(name)?.mailbox.pop()
    }

    fn directory(&self) -> &Directory {
        &self.directory
    }

    fn sniff(&mut self, now: Now, on: bool) {
        self.sniffing = on;
        if self.open {
            self.send(now, Frame::Sniff(on));
        }
    }

    fn service_name(&self) -> Text {
        self.service.clone()
    }

    fn shutdown(&mut self, now: Now) {
        self.given_up = true;
        self.redial = None;
        self.send(now, Frame::Goodbye(Text::from_static("the program ends")));
        if let Some((conn, _)) = self.conn {
            self.outputs.push_back(Output::Close(conn));
        }
    }
}
