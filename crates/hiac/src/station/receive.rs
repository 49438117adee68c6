//! What comes for this station: repetitions, fragments, and who may say what.

use alloc::collections::BTreeMap;
use alloc::vec::Vec;
use core::time::Duration;

use super::rights::{self, Direction};
use super::types::{Event, LinkId, Options, Role, Sender};
use super::{PacketKey, Purpose, Station, connect};
use crate::content::{
    BarrierOperation, ContentError, MessageKind, STATION_LOST, SemaphoreOperation,
};
use crate::sys::{NUMBERS, Outcome, Parameters, Subtype};
use crate::{Address, Addressing, Check, Content, Numbered, Packet, PacketType, ReadError};

/// How long the next fragment is waited for.
const FRAGMENT_PATIENCE: Duration = Duration::from_secs(10);

/// Messages that are put together at a time, and senders whose last number is kept.
const MAX_ASSEMBLIES: usize = 256;
const MAX_SENDERS: usize = 4096;

/// A packet that came, with whole addresses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival<'a> {
    pub(super) link: LinkId,
    pub(super) source: Address,
    pub(super) target: Address,
    pub(super) kind: PacketType,
    pub(super) priority: u8,
    pub(super) confirm: bool,
    pub(super) check: Check,
    pub(super) full: bool,
    pub(super) numbered: Option<Numbered>,
    pub(super) data: &'a [u8],
}

impl Arrival<'_> {
    pub(super) fn key(&self) -> PacketKey {
        (self.link, self.source, self.target, self.priority)
    }

    pub(super) fn is_fragment(&self) -> bool {
        let fragment = self.numbered.map(|numbered| numbered.fragment);
        fragment.is_some_and(|fragment| fragment.more || fragment.index > 0)
    }
}

/// The last number of each sender, and messages of which fragments are there.
#[derive(Debug, Default)]
pub(super) struct Heard {
    last: BTreeMap<PacketKey, (u8, Option<Outcome>)>,
    parts: BTreeMap<PacketKey, Assembly>,
}

#[derive(Debug)]
struct Assembly {
    kind: PacketType,
    confirm: bool,
    data: Vec<u8>,
    index: u8,
    psn: u8,
    expires: Duration,
}

/// What a numbered packet makes of its message.
enum Assembled {
    Whole(Vec<u8>),
    More,
    Broken(Outcome),
}

impl Heard {
    /// Whether this packet came before, and its result as far as there is one.
    pub(super) fn known(&self, key: PacketKey, psn: u8) -> Option<Option<Outcome>> {
        let (last, outcome) = self.last.get(&key)?;
        (*last == psn).then_some(*outcome)
    }

    pub(super) fn note(&mut self, key: PacketKey, psn: u8, outcome: Option<Outcome>) {
        if self.last.len() >= MAX_SENDERS && !self.last.contains_key(&key) {
            self.last.pop_first();
        }
        self.last.insert(key, (psn, outcome));
    }

    /// A packet that was passed on is written.
    pub(super) fn finished(&mut self, key: PacketKey, psn: u8) {
        if let Some(last) = self.last.get_mut(&key)
            && last.0 == psn
        {
            last.1 = Some(Outcome::ACCEPTED);
        }
    }

    /// A packet that was to be passed on will not be written.
    pub(super) fn unfinished(&mut self, key: PacketKey, psn: u8) {
        self.last
            .retain(|known, last| *known != key || last.0 != psn);
    }

    fn assemble(&mut self, now: Duration, arrival: &Arrival<'_>, longest: usize) -> Assembled {
        let Some(numbered) = arrival.numbered else {
            return Assembled::Whole(arrival.data.to_vec());
        };
        let (key, fragment) = (arrival.key(), numbered.fragment);
        let mut message = match (fragment.index, self.parts.remove(&key)) {
            (0, _) => Assembly {
                kind: arrival.kind,
                confirm: arrival.confirm,
                data: Vec::new(),
                index: 0,
                psn: numbered.psn,
                expires: now,
            },
            (index, Some(message))
                if message.index == index
                    && message.psn == numbered.psn
                    && (message.kind, message.confirm) == (arrival.kind, arrival.confirm) =>
            {
                message
            }
            (_, kept) => {
                if let Some(kept) = kept {
                    self.parts.insert(key, kept);
                }
                return Assembled::Broken(Outcome::INCOMPLETE);
            }
        };
        if message.data.len() + arrival.data.len() > longest {
            return Assembled::Broken(Outcome::REFUSED);
        }
        message.data.extend_from_slice(arrival.data);
        if !fragment.more {
            return Assembled::Whole(message.data);
        }
        if fragment.index == 127 {
            return Assembled::Broken(Outcome::MALFORMED);
        }
        if self.parts.len() >= MAX_ASSEMBLIES {
            return Assembled::Broken(Outcome::REFUSED);
        }
        message.index += 1;
        message.psn = message.psn.wrapping_add(1);
        message.expires = now + FRAGMENT_PATIENCE;
        self.parts.insert(key, message);
        Assembled::More
    }

    pub(super) fn next_timeout(&self) -> Option<Duration> {
        self.parts.values().map(|message| message.expires).min()
    }

    /// How many messages were given up.
    pub(super) fn expire(&mut self, now: Duration) -> u64 {
        let before = self.parts.len();
        self.parts.retain(|_, message| message.expires > now);
        (before - self.parts.len()) as u64
    }

    pub(super) fn forget_link(&mut self, link: LinkId) {
        self.forget(|key| key.0 == link);
    }

    pub(super) fn forget_source(&mut self, link: LinkId, source: Address) {
        self.forget(|key| (key.0, key.1) == (link, source));
    }

    pub(super) fn forget_pair(&mut self, link: LinkId, source: Address, target: Address) {
        self.forget(|key| (key.0, key.1, key.2) == (link, source, target));
    }

    fn forget(&mut self, which: impl Fn(&PacketKey) -> bool) {
        self.last.retain(|key, _| !which(key));
        self.parts.retain(|key, _| !which(key));
    }
}

impl Station {
    /// A packet came, from PV to CHK.
    pub(super) fn packet(&mut self, now: Duration, id: LinkId, octets: &[u8]) {
        let Some(link) = self.links.get(&id) else {
            return;
        };
        let packet = match Packet::decode(octets, link.mask) {
            Ok(packet) => packet,
            Err(ReadError::Mask) => {
                self.drops.unconnected += 1;
                return;
            }
            Err(_) => {
                self.drops.unreadable += 1;
                return;
            }
        };
        let whole = |level| link.mask?.address(link.local, level);
        let ends = match packet.addressing {
            Addressing::Full { target, source } => Some((target, source)),
            Addressing::Level { target, source } => whole(target).zip(whole(source)),
        };
        let Some((target, source)) = ends else {
            self.drops.unreadable += 1;
            return;
        };
        let arrival = Arrival {
            link: id,
            source,
            target,
            kind: packet.kind,
            priority: packet.priority,
            // Nobody confirms what goes to all.
            confirm: packet.confirm && !link.is_broadcast(target),
            check: packet.check,
            full: matches!(packet.addressing, Addressing::Full { .. }),
            numbered: packet.numbered,
            data: packet.data,
        };
        let (connected, role) = (link.is_connected(), link.role);
        if arrival.kind == PacketType::SYS && self.connection(now, &arrival) {
            return;
        }
        match (connected, role) {
            (false, _) => self.drops.unconnected += 1,
            (true, Role::Employer) => self.take_from_employee(now, &arrival),
            (true, Role::Employee) => self.take_from_employer(now, &arrival),
        }
    }

    /// A packet for this station, to which the sender stands in this direction.
    pub(super) fn deliver(&mut self, now: Duration, arrival: &Arrival<'_>, direction: Direction) {
        if arrival.numbered.is_some() && self.config.abilities & NUMBERS == 0 {
            self.drops.refused += 1;
            return;
        }
        let key = arrival.key();
        if let Some(numbered) = arrival.numbered
            && let Some(outcome) = self.heard.known(key, numbered.psn)
        {
            self.drops.repeated += 1;
            if let Some(outcome) = outcome.filter(|_| arrival.confirm) {
                self.confirm(arrival, outcome, None);
            }
            return;
        }
        let longest = self.config.longest_message;
        let outcome = match self.heard.assemble(now, arrival, longest) {
            Assembled::More => Outcome::ACCEPTED,
            Assembled::Broken(outcome) => outcome,
            Assembled::Whole(data) => self.content(now, arrival, direction, &data),
        };
        if let Some(numbered) = arrival.numbered {
            self.heard.note(key, numbered.psn, Some(outcome));
        }
        match (outcome, arrival.confirm) {
            (outcome, true) => self.confirm(arrival, outcome, None),
            (Outcome::ACCEPTED, false) => {}
            (outcome, false) => self.count_refusal(outcome),
        }
        if let Some((link, employer, place)) = self.transfers.leaving.take() {
            self.pass_over(now, link, employer, place);
        }
        // What it is answered with goes behind the confirmation.
        self.send_replies(now);
    }

    /// Refuses a packet, or drops it if nobody waits for a confirmation.
    pub(super) fn turn_down(
        &mut self,
        arrival: &Arrival<'_>,
        outcome: Outcome,
        limit: Option<u32>,
    ) {
        match arrival.confirm {
            true => self.confirm(arrival, outcome, limit),
            false => self.count_refusal(outcome),
        }
    }

    fn count_refusal(&mut self, outcome: Outcome) {
        match outcome {
            Outcome::NOT_PERMITTED => self.drops.not_permitted += 1,
            _ => self.drops.refused += 1,
        }
    }

    fn confirm(&mut self, arrival: &Arrival<'_>, outcome: Outcome, limit: Option<u32>) {
        if let Some(packet) = self.confirmation(arrival, outcome, limit) {
            let leaving = self.transfers.leaving.take();
            let purpose = match leaving {
                Some((_, employer, place)) => Purpose::PassOver { employer, place },
                None => Purpose::Reply,
            };
            self.push_purpose(arrival.link, arrival.priority, packet, purpose);
        }
    }

    /// The PKGCNF of a packet.
    pub(super) fn confirmation(
        &self,
        arrival: &Arrival<'_>,
        outcome: Outcome,
        limit: Option<u32>,
    ) -> Option<Vec<u8>> {
        let link = self.links.get(&arrival.link)?;
        let alias = link.role == Role::Employer && self.config.aliases.contains(&arrival.target);
        let own = arrival.target == link.local || alias;
        let parameters = Parameters {
            address: (!own).then_some(arrival.target),
            largest: limit,
            psn: arrival.numbered.map(|numbered| numbered.psn),
            result: Some(outcome),
            ..Parameters::default()
        };
        let source = if own { arrival.target } else { link.local };
        Some(connect::sys_packet(
            arrival.check,
            arrival.priority,
            Subtype::Confirmation,
            (arrival.source, source),
            &parameters,
        ))
    }

    /// Judges a whole message and does what it says.
    fn content(
        &mut self,
        now: Duration,
        arrival: &Arrival<'_>,
        direction: Direction,
        data: &[u8],
    ) -> Outcome {
        let requested = self.transfers.was_asked(arrival.link);
        if !rights::permitted(direction, arrival.kind, data, arrival.confirm, requested) {
            return Outcome::NOT_PERMITTED;
        }
        // Without SYS there would be no connection.
        if !self.config.types.has(arrival.kind) && arrival.kind != PacketType::SYS {
            return Outcome::UNSUPPORTED;
        }
        let content = match Content::decode(arrival.kind, data) {
            Ok(content) => content,
            Err(ContentError::Type) => return Outcome::UNSUPPORTED,
            Err(ContentError::Malformed) => return Outcome::MALFORMED,
        };
        let link = self.links.get(&arrival.link);
        let sender = Sender {
            address: arrival.source,
            to: arrival.target,
            direction,
            link: arrival.link,
            options: Options {
                priority: Some(arrival.priority),
                confirm: arrival.confirm,
                full: arrival.full,
                sum: false,
            },
            broadcast: link.is_some_and(|link| link.is_broadcast(arrival.target)),
        };
        self.act(now, arrival, sender, content)
    }

    fn act(
        &mut self,
        now: Duration,
        arrival: &Arrival<'_>,
        from: Sender,
        content: Content<'_>,
    ) -> Outcome {
        match content {
            Content::Signal { number, arguments } => {
                if let (STATION_LOST, Ok(lost)) = (number, arguments.try_into())
                    && from.direction == Direction::Employee
                {
                    self.colleague_lost(now, from.link, Address::from_octets(lost));
                }
                let arguments = arguments.to_vec();
                self.events.push_back(Event::Signal {
                    from,
                    number,
                    arguments,
                });
                Outcome::ACCEPTED
            }
            Content::Message {
                kind,
                reference,
                octets,
            } => self.message(from, kind, reference, octets),
            Content::Semaphore { operation, number } => match operation {
                SemaphoreOperation::Take | SemaphoreOperation::Give | SemaphoreOperation::Test => {
                    self.semaphore(from, operation, number)
                }
                state => {
                    self.tell_semaphore(from.address, number, state);
                    Outcome::ACCEPTED
                }
            },
            Content::Write { address, octets } => {
                let is_answer = |reading: &super::Reading| {
                    (reading.link, reading.target, reading.address)
                        == (from.link, from.address, address)
                };
                match self.readings.iter().position(is_answer) {
                    Some(at) => {
                        let ticket = self.readings.remove(at).ticket;
                        let octets = octets.to_vec();
                        self.events.push_back(Event::Memory { ticket, octets });
                        Outcome::ACCEPTED
                    }
                    None => self.write_memory(from, address, octets),
                }
            }
            Content::Read { address, length } => self.read_memory(from, address, length),
            Content::Barrier {
                operation: BarrierOperation::Release,
                number,
                ..
            } => {
                let keeper = from.address;
                self.events.push_back(Event::Released { keeper, number });
                Outcome::ACCEPTED
            }
            Content::Barrier {
                operation,
                number,
                parties,
            } => self.barrier(from, operation, number, parties),
            Content::System {
                subtype,
                parameters,
            } => match subtype {
                Subtype::Confirmation => {
                    self.confirmed(now, arrival, &parameters);
                    Outcome::ACCEPTED
                }
                Subtype::Initialize | Subtype::Accept | Subtype::Refuse => {
                    if from.direction == Direction::Colleague {
                        self.colleague_connection(now, arrival, subtype, &parameters);
                    } else {
                        self.drops.unconnected += 1;
                    }
                    Outcome::ACCEPTED
                }
                Subtype::Reinitialize => Outcome::NOT_PERMITTED,
                _ => self.transfer(now, from, subtype, &parameters),
            },
        }
    }

    fn message(
        &mut self,
        from: Sender,
        kind: MessageKind,
        reference: u8,
        octets: &[u8],
    ) -> Outcome {
        let answers = matches!(kind, MessageKind::Answer | MessageKind::Warning) && reference != 0;
        let octets = octets.to_vec();
        let open = self.questions.iter().position(|question| {
            let asked = (question.link, question.target, question.reference);
            asked == (from.link, from.address, reference)
        });
        match open.filter(|_| answers) {
            Some(at) => {
                let ticket = self.questions.remove(at).ticket;
                self.events.push_back(Event::Answered {
                    ticket,
                    kind,
                    octets,
                });
                Outcome::ACCEPTED
            }
            None if kind == MessageKind::Answer => {
                self.drops.unasked += 1;
                Outcome::NO_SUCH_TARGET
            }
            None => {
                self.events.push_back(Event::Message {
                    from,
                    kind,
                    reference,
                    octets,
                });
                Outcome::ACCEPTED
            }
        }
    }

    /// PKGCNF came.
    fn confirmed(&mut self, now: Duration, arrival: &Arrival<'_>, read: &Parameters<'_>) {
        let target = read.address.unwrap_or(arrival.source);
        let ends = (arrival.target, target, arrival.priority);
        let link = self.links.get_mut(&arrival.link);
        let (Some(psn), Some(outcome), Some(link)) = (read.psn, read.result, link) else {
            self.drops.unasked += 1;
            return;
        };
        let done = link
            .queue
            .confirmed(ends, psn, outcome, read.largest, read.reason);
        match done {
            Ok(Some(done)) => self.done(now, arrival.link, done),
            Ok(None) => {}
            Err(()) => self.drops.unasked += 1,
        }
    }
}
