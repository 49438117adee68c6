//! A station: its connections, and what goes through it.
//!
//! ```text
//!   octets ─ received ─▶ ┌─────────┐ ─ poll_event ─────▶ messages, signals, confirmations …
//!   octets ◀ poll_transmit  Station │ ◀─ send, question, take … ─ the program
//!                        └─────────┘ ─ poll_timeout ──▶ handle_timeout
//! ```
//!
//! It employs those at the other ends of some links, and is employed over one other at most. What
//! is for others of its workgroups or below goes through it without a word to the program.
//!
//! **Knows** the hierarchy, the numbers, confirmations and fragments, and keeps semaphores, memory
//! and barriers. **Never knows** a socket or a clock: time is a duration since any fixed moment.
//!
//! What a station decides for itself: a queue that is full, a message longer than it takes, and a
//! 65th waiting station at a semaphore or the 257th barrier are refused with result 1; a confirmed
//! packet of a colleague is taken also before its INCON, since nothing but its numbers hangs on it.

mod colleague;
mod connect;
mod link;
mod queue;
mod receive;
mod rights;
mod route;
mod send;
mod services;
mod transfer;
mod types;

use alloc::collections::{BTreeMap, VecDeque};
use alloc::string::String;
use alloc::vec::Vec;
use core::time::Duration;

use self::link::{Link, Partner};
use self::queue::Done;
use self::receive::Heard;
pub use self::rights::Direction;
use self::services::{Barriers, Semaphores};
use self::transfer::Transfers;
pub use self::types::{
    Drops, Ended, Event, Failure, LinkConfig, LinkId, Options, Region, Rights, Role, SendError,
    Sender, StationConfig, Ticket, Workgroup,
};
use crate::content::SemaphoreOperation;
use crate::edcp::{self, Counters};
use crate::{Address, Growing, Mask};

/// What is to happen when something was written, confirmed or has failed.
#[derive(Clone, Debug)]
enum Purpose {
    /// Nothing.
    Reply,
    /// The program is told.
    Program(Ticket),
    /// A semaphore was granted; who does not confirm that has given it back.
    Grant { number: u16, to: Party },
    /// The sender, whose partner cannot confirm, is told.
    Forwarded {
        key: PacketKey,
        psn: u8,
        confirm: Option<(LinkId, u8, Vec<u8>)>,
    },
    /// The next step of a transfer.
    Transfer,
    /// The connection is over once this is written.
    PassOver {
        employer: Address,
        place: Option<String>,
    },
}

/// Somebody at a semaphore or a barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Party {
    link: LinkId,
    address: Address,
    options: Options,
}

impl Party {
    fn is(&self, other: &Party) -> bool {
        (self.link, self.address) == (other.link, other.address)
    }
}

/// From where a numbered packet came, and how urgent it was.
type PacketKey = (LinkId, Address, Address, u8);

/// A question that waits for its answer.
#[derive(Debug)]
struct Question {
    ticket: Ticket,
    target: Address,
    reference: u8,
    link: LinkId,
    expires: Duration,
}

/// A memory request that waits for its answer.
#[derive(Debug)]
struct Reading {
    ticket: Ticket,
    target: Address,
    address: u32,
    link: LinkId,
    expires: Duration,
}

/// What is known of a colleague.
#[derive(Debug)]
enum Colleague {
    /// An INCON has been sent.
    Calling {
        next: Duration,
        left: u32,
    },
    Connected(Partner),
}

/// Own address, colleague.
type Pair = (Address, Address);

/// A station.
#[derive(Debug)]
pub struct Station {
    config: StationConfig,
    address: Option<Address>,
    links: BTreeMap<LinkId, Link>,
    /// The link to the employer, while it is connected.
    up: Option<LinkId>,
    heard: Heard,
    colleagues: BTreeMap<(LinkId, Pair), Colleague>,
    questions: Vec<Question>,
    readings: Vec<Reading>,
    semaphores: Semaphores,
    barriers: Barriers,
    transfers: Transfers,
    events: VecDeque<Event>,
    drops: Drops,
    last_ticket: u64,
    last_reference: u8,
}

impl Station {
    /// A station without links.
    pub fn new(mut config: StationConfig) -> Station {
        config.largest = config.largest.clamp(64, 0x0020_0000);
        let period = config.period;
        config.period = period.clamp(Duration::from_millis(20), Duration::from_millis(65_535));
        Station {
            address: config.address,
            config,
            links: BTreeMap::new(),
            up: None,
            heard: Heard::default(),
            colleagues: BTreeMap::new(),
            questions: Vec::new(),
            readings: Vec::new(),
            semaphores: Semaphores::default(),
            barriers: Barriers::default(),
            transfers: Transfers::default(),
            events: VecDeque::new(),
            drops: Drops::default(),
            last_ticket: 0,
            last_reference: 0,
        }
    }

    /// Its address; one that nobody has given it and that was not configured is not known.
    pub fn address(&self) -> Option<Address> {
        self.address
    }

    /// The subnetworks that it employs.
    pub fn workgroups(&self) -> &[Workgroup] {
        &self.config.workgroups
    }

    /// The shared memory.
    pub fn memory(&mut self) -> &mut [Region] {
        &mut self.config.memory
    }

    /// What was dropped so far.
    pub fn drops(&self) -> Drops {
        self.drops
    }

    /// What the link layer of a link ignored or dropped.
    pub fn link_counters(&self, link: LinkId) -> Option<Counters> {
        self.links.get(&link).map(|link| link.decoder.counters())
    }

    /// The address of the partner on a link, while it is connected.
    pub fn partner(&self, link: LinkId) -> Option<Address> {
        let link = self.links.get(&link).filter(|link| link.is_connected())?;
        Some(link.peer)
    }

    /// The mask of the subnetwork of a link, once it has one.
    pub fn mask(&self, link: LinkId) -> Option<Mask> {
        self.links.get(&link)?.mask
    }

    /// Whether a station has its employer.
    pub fn employer(&self) -> Option<Address> {
        self.up.and_then(|up| self.partner(up))
    }

    /// A stream is there.
    pub fn add_link(&mut self, now: Duration, id: LinkId, config: LinkConfig) {
        let role = config.role;
        self.links.insert(id, Link::new(config, &self.config));
        if role == Role::Employer {
            self.start_calling(now, id);
        }
    }

    /// A stream has ended.
    pub fn remove_link(&mut self, now: Duration, id: LinkId) {
        self.disconnect(now, id, Ended::Lost, false);
        self.links.remove(&id);
    }

    /// Octets came, in any portions.
    pub fn received(&mut self, now: Duration, id: LinkId, octets: &[u8]) {
        for octet in octets {
            let Some(link) = self.links.get_mut(&id) else {
                return;
            };
            let packet = match link.decoder.push(*octet) {
                Some(edcp::Event::Packet(packet)) => Some(packet.to_vec()),
                _ => None,
            };
            link.listen(now);
            if let Some(packet) = packet {
                self.packet(now, id, &packet);
            }
        }
    }

    /// The octets to write next to a link; then [`transmitted`](Self::transmitted) says that they
    /// are written, and until then there are no others.
    pub fn poll_transmit(&mut self, id: LinkId) -> Option<Vec<u8>> {
        let link = self.links.get_mut(&id)?;
        if let Some(octets) = link.queue.poll() {
            return Some(octets);
        }
        let alive = !link.queue.in_flight() && link.take_alive();
        alive.then(|| edcp::ALIVE.to_vec())
    }

    /// The octets of the last [`poll_transmit`](Self::poll_transmit) are written.
    pub fn transmitted(&mut self, now: Duration, id: LinkId) {
        let Some(link) = self.links.get_mut(&id) else {
            return;
        };
        link.written(now);
        // A repetition is due after a quarter of the period.
        if let Some(done) = link.queue.transmitted(now, link.partner.period / 4) {
            self.done(now, id, done);
        }
    }

    /// Whether anything is still to be written to a link.
    pub fn is_idle(&self, id: LinkId) -> bool {
        let link = self.links.get(&id);
        link.is_none_or(|link| link.queue.is_empty())
    }

    /// What there is to tell.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called.
    pub fn poll_timeout(&self) -> Option<Duration> {
        let links = self.links.values().filter_map(Link::next_timeout);
        let questions = self.questions.iter().map(|question| question.expires);
        let readings = self.readings.iter().map(|reading| reading.expires);
        let colleagues = self.colleagues.values().filter_map(|known| match known {
            Colleague::Calling { next, .. } => Some(*next),
            Colleague::Connected(_) => None,
        });
        let rest = [self.heard.next_timeout(), self.transfers.next_timeout()];
        links
            .chain(questions)
            .chain(readings)
            .chain(colleagues)
            .chain(rest.into_iter().flatten())
            .min()
    }

    /// The time has come.
    pub fn handle_timeout(&mut self, now: Duration) {
        let ids: Vec<LinkId> = self.links.keys().copied().collect();
        for id in ids {
            self.link_timeout(now, id);
        }
        self.call_colleagues(now);
        let incomplete = self.heard.expire(now);
        self.drops.incomplete += incomplete;
        for question in expired(&mut self.questions, |question| question.expires <= now) {
            self.fail(question.ticket, Failure::Unanswered);
        }
        for reading in expired(&mut self.readings, |reading| reading.expires <= now) {
            self.fail(reading.ticket, Failure::Unanswered);
        }
        self.transfer_timeout(now);
    }

    fn link_timeout(&mut self, now: Duration, id: LinkId) {
        let sendings = self.config.sendings;
        let Some(link) = self.links.get_mut(&id) else {
            return;
        };
        if link.is_lost(now) {
            self.disconnect(now, id, Ended::Lost, true);
            return;
        }
        link.handle_timeout(now);
        for done in link.queue.handle_timeout(now, sendings) {
            self.done(now, id, done);
        }
        self.call(now, id);
    }

    /// Something was written, confirmed, or has failed.
    fn done(&mut self, now: Duration, id: LinkId, done: Done) {
        match done {
            Done::Awaited(Purpose::Program(ticket)) => {
                self.events.push_back(Event::Written(ticket));
            }
            Done::Awaited(_) => {}
            Done::Written(purpose) => {
                if let Purpose::Program(ticket) = purpose {
                    self.events.push_back(Event::Written(ticket));
                }
                self.succeeded(now, id, purpose);
            }
            Done::Confirmed(purpose) => self.succeeded(now, id, purpose),
            Done::Failed(purpose, failure) => self.failed(now, purpose, failure),
        }
    }

    fn succeeded(&mut self, now: Duration, id: LinkId, purpose: Purpose) {
        match purpose {
            Purpose::Program(ticket) => self.events.push_back(Event::Confirmed(ticket)),
            Purpose::Forwarded { key, psn, confirm } => {
                self.heard.finished(key, psn);
                if let Some((link, priority, packet)) = confirm {
                    self.push_packet(link, priority, packet);
                }
            }
            Purpose::Transfer => self.transfer_step(now, Ok(())),
            Purpose::PassOver { employer, place } => self.pass_over(now, id, employer, place),
            Purpose::Reply | Purpose::Grant { .. } => {}
        }
    }

    fn failed(&mut self, now: Duration, purpose: Purpose, failure: Failure) {
        match purpose {
            Purpose::Program(ticket) => {
                self.questions.retain(|question| question.ticket != ticket);
                self.readings.retain(|reading| reading.ticket != ticket);
                self.fail(ticket, failure);
            }
            Purpose::Grant { number, to } => self.give_up(now, number, &to),
            Purpose::Transfer => self.transfer_step(now, Err(failure)),
            Purpose::Forwarded { key, psn, .. } => self.heard.unfinished(key, psn),
            Purpose::Reply | Purpose::PassOver { .. } => {}
        }
    }

    fn fail(&mut self, ticket: Ticket, failure: Failure) {
        self.events.push_back(Event::Failed(ticket, failure));
    }

    fn push_packet(&mut self, id: LinkId, priority: u8, octets: Vec<u8>) {
        if let Some(link) = self.links.get_mut(&id) {
            link.queue.push_packet(priority, octets, Purpose::Reply);
        }
    }

    fn next_ticket(&mut self) -> Ticket {
        self.last_ticket += 1;
        Ticket(self.last_ticket)
    }

    /// Octets of a content; `None` if a parameter cannot be written.
    fn data_of(content: &crate::Content<'_>) -> Option<Vec<u8>> {
        let mut data = Growing::new(usize::MAX);
        content.encode(&mut data).then(|| data.into_octets())
    }

    fn tell_semaphore(&mut self, keeper: Address, number: u16, state: SemaphoreOperation) {
        self.events.push_back(Event::Semaphore {
            keeper,
            number,
            state,
        });
    }
}

fn expired<T>(items: &mut Vec<T>, which: impl Fn(&T) -> bool) -> Vec<T> {
    items.extract_if(.., |item| which(item)).collect()
}
