//! Letters to services of other makes: each on a connection of its own, whose end ends the letter,
//! or handed whole to a transport that is plugged in.
//!
//! ```text
//!   by receiver, in order        a place in the receiver's order, twice         the next place
//!   letter, letter, letter ──▶ wait for a free connection ─▶ dial ─▶ write ──┬─▶ sent
//!                                     ▲                                      │ broke before all
//!                                     └──────────────────────────────────────┘ was written
//! ```
//!
//! The letters for one receiver are written one after the other; in which order the other side
//! reads connections is its own affair. Over HTTP each waits for the answer to the one in front,
//! but where a place says that it takes them [ahead](super::ahead).
//!
//! Nobody over there says what became of a letter: `sent` is all that can be known. A letter goes
//! out whole at most once. It is tried again only while the system has not taken all of it: then
//! the other side has not seen its end. A connection that is given up in the middle of a letter is
//! broken off, so that its end is not taken for that of the letter.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

use bytes::Bytes;
use fipa_acl::Text;
use fipa_codec::Dialect;
use fipa_directory::{Address, Location, MESSAGE_TRANSPORT, Now, ParseAddressError};
use fipa_link::Outcome;

use super::ahead::Ahead;
use super::dialects::{self, Foreign};
use super::http::{Urls, urls_of};
use super::{Mts, Numbered};
use crate::machine::{ConnId, DialId, Ended, Output, PostId, SentLetter};
use crate::pieces::joined;

/// Connections to all services of other makes at once. A stalled one keeps its connections until
/// the deadlines of the letters, so it takes very many of them to keep others waiting.
const MAX_CONNECTIONS: usize = 256;

/// Connections to one address at once.
const MAX_AN_ADDRESS: usize = 4;

/// Letters that wait for one receiver at most.
const MAX_WAITING: usize = 10_000;

/// How often a place is tried: the second time with a new connection.
const TRIES: u32 = 2;

/// What is on its way to services of other makes.
#[derive(Debug)]
pub(super) struct Post {
    /// The letters for each receiver; the first one is being tried.
    pub(super) boxes: ByText<Letterbox>,
    pub(super) attempts: Numbered<Attempt>,
    /// Attempts that wait for a free connection.
    queue: VecDeque<u64>,
    dials: HashMap<DialId, Trip>,
    conns: HashMap<ConnId, Trip>,
    /// Letters that are being posted over HTTP or handed to a plug-in, and where to.
    posted: Numbered<Posted>,
    /// Those of them that have a connection of their own.
    posted_alone: usize,
    /// Dials, posts and connections to each address.
    pub(super) busy: HashMap<Arc<Address>, Busy, foldhash::fast::RandomState>,
    pub(super) ahead: Ahead,
    /// Receivers whose first letter is to be tried.
    due: VecDeque<Text>,
    running: bool,
    /// Where answers can be posted.
    pub(super) urls: Urls,
}

type ByText<T> = HashMap<Text, T, foldhash::fast::RandomState>;

/// What is on its way to an address.
#[derive(Debug, Default)]
pub(super) struct Busy {
    /// Letters that nothing for the same receiver is in front of.
    first: usize,
    /// Letters that are posted behind others.
    pub(super) behind: usize,
}

/// A letter that is being posted.
#[derive(Debug)]
struct Posted {
    delivery: u64,
    address: Arc<Address>,
    in_series: bool,
    is_behind: bool,
}

#[derive(Debug, Default)]
pub(super) struct Letterbox {
    pub(super) waiting: VecDeque<u64>,
    octets: usize,
}

/// How far a letter has got.
#[derive(Debug, Default)]
pub(super) struct Attempt {
    /// Where it has not been tried yet; the first one is being tried.
    pub(super) places: VecDeque<(Arc<Address>, Dialect)>,
    tries: u32,
    /// Whether there is, or was, a place that could be tried.
    possible: bool,
    /// Why it is not somewhere else already.
    failures: Vec<String>,
    /// What it is being written to.
    conn: Option<ConnId>,
    /// It is being posted over HTTP, or handed to a plug-in.
    posted: bool,
    /// It is being posted so that others may follow.
    pub(super) in_series: bool,
    /// It came back, and waits until it is the first.
    rests: bool,
}

/// A letter on its way to an address.
#[derive(Debug)]
struct Trip {
    delivery: u64,
    address: Arc<Address>,
    parts: VecDeque<Bytes>,
}

impl Post {
    /// Nothing is on its way; answers can be posted at these URLs.
    pub(super) fn new(urls: &[Address]) -> Post {
        Post {
            boxes: HashMap::default(),
            attempts: Numbered::default(),
            queue: VecDeque::new(),
            dials: HashMap::new(),
            conns: HashMap::new(),
            posted: Numbered::default(),
            posted_alone: 0,
            ahead: Ahead::default(),
            busy: HashMap::default(),
            due: VecDeque::new(),
            running: false,
            urls: urls_of(urls),
        }
    }

    pub(super) fn has_dial(&self, dial: DialId) -> bool {
        self.dials.contains_key(&dial)
    }

    pub(super) fn has_conn(&self, conn: ConnId) -> bool {
        self.conns.contains_key(&conn)
    }

    pub(super) fn poll_transmit(&mut self, conn: ConnId) -> Option<Bytes> {
        self.conns.get_mut(&conn)?.parts.pop_front()
    }

    /// The first letter that a connection is free for, and where it goes.
    fn next_to_dial(&mut self) -> Option<(u64, Arc<Address>, Dialect)> {
        let place = |id: &u64| self.attempts.get(id)?.places.front();
        let is_free = |(address, _): &(Arc<Address>, Dialect)| {
            let busy = self.busy.get(address).map_or(0, |busy| busy.first);
            let all = self.dials.len() + self.conns.len() + self.posted_alone;
            busy < MAX_AN_ADDRESS.max(self.ahead.at(address)) && all < MAX_CONNECTIONS
        };
        let mut queue = self.queue.iter();
        let at = queue.position(|id| place(id).is_some_and(is_free))?;
        let id = self.queue.remove(at)?;
        let attempt = self.attempts.get_mut(&id)?;
        let (address, dialect) = attempt.places.front().cloned()?;
        Some((id, address, dialect))
    }

    fn set_out(&mut self, dial: DialId, trip: Trip) {
        self.busy_with(&trip.address).first += 1;
        if let Some(attempt) = self.attempts.get_mut(&trip.delivery) {
            attempt.possible = true;
        }
        self.dials.insert(dial, trip);
    }

    fn busy_with(&mut self, address: &Arc<Address>) -> &mut Busy {
        self.busy.entry(Arc::clone(address)).or_default()
    }

    pub(super) fn set_out_posted(
        &mut self,
        post: PostId,
        delivery: u64,
        address: Arc<Address>,
        in_series: bool,
        is_behind: bool,
    ) {
        let busy = self.busy_with(&address);
        match is_behind {
            true => busy.behind += 1,
            false => busy.first += 1,
        }
        self.posted_alone += usize::from(!in_series);
        if let Some(attempt) = self.attempts.get_mut(&delivery) {
            attempt.possible = true;
            attempt.posted = true;
            attempt.in_series = in_series;
        }
        let posted = Posted {
            delivery,
            address,
            in_series,
            is_behind,
        };
        self.posted.insert(post.0, posted);
    }

    /// Where a letter was tried, somebody said "no".
    pub(super) fn is_refused(&mut self, delivery: u64) {
        if let Some(attempt) = self.attempts.get_mut(&delivery) {
            attempt.possible = false;
        }
    }

    /// A letter is not being posted any more.
    pub(super) fn come_back(&mut self, post: PostId) -> Option<(u64, Arc<Address>)> {
        let posted = self.posted.remove(&post.0)?;
        self.posted_alone -= usize::from(!posted.in_series);
        if let Some(attempt) = self.attempts.get_mut(&posted.delivery) {
            attempt.posted = false;
            attempt.in_series = false;
        }
        match posted.is_behind {
            true => self.release(&posted.address, |busy| busy.behind -= 1),
            false => self.release(&posted.address, |busy| busy.first -= 1),
        }
        Some((posted.delivery, posted.address))
    }

    /// Something is not on its way to this address any more.
    fn release(&mut self, address: &Address, what: impl FnOnce(&mut Busy)) {
        if let Some(busy) = self.busy.get_mut(address) {
            what(busy);
            if busy.first + busy.behind == 0 {
                self.busy.remove(address);
            }
        }
    }
}

impl Mts {
    /// Puts a copy behind those that wait for the same receiver.
    pub(super) fn post(&mut self, now: Now, id: u64) {
        let Some(delivery) = self.deliveries.get(&id) else {
            return;
        };
        let Some(foreign) = &delivery.foreign else {
            return;
        };
        let (name, octets) = (foreign.to.name.clone(), delivery.octets());
        let letterbox = self.post.boxes.entry(name.clone()).or_default();
        let too_much = letterbox.octets + octets > self.config.queue_octets;
        let waiting = letterbox.waiting.len();
        if waiting > 0 && (waiting >= MAX_WAITING || too_much) {
            let reason = Text::from(format!("the queue of {name} is full"));
            self.not_taken(now, id, Outcome::Refused, reason);
            return;
        }
        letterbox.waiting.push_back(id);
        letterbox.octets += octets;
        if waiting == 0 || !self.post.ahead.is_told_by_nobody() {
            self.post.due.push_back(name);
            self.run_post(now);
        }
    }

    /// Begins with letters whose turn it is, and dials while connections are free.
    pub(super) fn run_post(&mut self, now: Now) {
        if std::mem::replace(&mut self.post.running, true) {
            return;
        }
        loop {
            if let Some(name) = self.post.due.pop_front() {
                self.begin_next(now, &name);
            } else if !self.dial_next(now) {
                break;
            }
        }
        self.post.running = false;
    }

    fn begin_next(&mut self, now: Now, name: &Text) {
        let Some(letterbox) = self.post.boxes.get(name) else {
            return;
        };
        let Some(id) = letterbox.waiting.front().copied() else {
            self.post.boxes.remove(name);
            return;
        };
        if let Some(attempt) = self.post.attempts.get_mut(&id) {
            return match std::mem::take(&mut attempt.rests) {
                true => self.try_place(now, id),
                false => self.begin_behind(now, name),
            };
        }
        let foreign = self.deliveries.get(&id).and_then(|d| d.foreign.as_deref());
        let attempt = foreign.map(|foreign| self.attempt(foreign));
        self.post.attempts.insert(id, attempt.unwrap_or_default());
        self.try_place(now, id);
    }

    /// Where a letter can go, in the order in which that is tried.
    pub(super) fn attempt(&self, foreign: &Foreign) -> Attempt {
        let name = &foreign.to.name;
        let mut attempt = Attempt::default();
        let note = |place, attempt: &mut Attempt| match place {
            Ok(place) => attempt.places.push_back(place),
            Err(reason) => attempt.failures.push(reason),
        };
        // They are in the order of preference already.
        for address in &foreign.addresses {
            let place = self.place(foreign, Ok(address.clone()), MESSAGE_TRANSPORT);
            note(
                place.map_err(|why| format!("{address}: {why}")),
                &mut attempt,
            );
        }
        if !foreign.addresses.is_empty() {
            return attempt;
        }
        let Some(neighbour) = self.neighbours.get(name) else {
            attempt.possible = true;
            let reason = format!("{name} is not announced any more");
            attempt.failures.push(reason);
            return attempt;
        };
        let mut locations = neighbour.entry.locations.clone();
        locations.sort_by_key(|l| preference(&l.address, &foreign.transports));
        // What fipa_services writes ends with a separator, and so with an empty location.
        for Location { address, signature } in locations.iter().filter(|l| !l.address.is_empty()) {
            let place = self.place(foreign, address.parse(), signature);
            note(
                place.map_err(|why| format!("{address}: {why}")),
                &mut attempt,
            );
        }
        attempt
    }

    /// An address with the dialect that is spoken there, or why letters do not go there.
    fn place(
        &self,
        foreign: &Foreign,
        address: Result<Address, ParseAddressError>,
        signature: &str,
    ) -> Result<(Arc<Address>, Dialect), String> {
        let dialect = match &address {
            Ok(address) if address.is_http() => Dialect::Jade,
            _ => dialects::of_signature(signature)
                .ok_or_else(|| format!("{signature:?} is not spoken here"))?,
        };
        let address = address.map_err(|error| error.to_string())?;
        let ours = match address.is_http() {
            true => &self.config.http,
            false => &self.config.endpoints,
        };
        if ours.contains(&address) {
            return Err("this is the service itself".to_owned());
        }
        match &address {
            Address::Unix(_) => return Err("it is a socket of another host".to_owned()),
            other if !self.is_spoken(other) => {
                return Err("there is no such transport here".to_owned());
            }
            Address::Quic { .. } => {
                return Err("QUIC is spoken to platforms of our own only".to_owned());
            }
            _ => {}
        }
        match self.leave_refusal(&foreign.from, &foreign.to.name, &address) {
            Some(reason) => Err(reason.to_owned()),
            None => Ok((Arc::new(address), dialect)),
        }
    }

    /// Tries the next place as soon as a connection is free; or there is none.
    fn try_place(&mut self, now: Now, id: u64) {
        let is_first = self.is_first(id);
        let Some(attempt) = self.post.attempts.get_mut(&id) else {
            return;
        };
        if !attempt.places.is_empty() {
            match is_first {
                true => self.post.queue.push_back(id),
                false => attempt.rests = true,
            }
            return;
        }
        let outcome = match attempt.possible {
            true => Outcome::Timeout,
            false => Outcome::Refused,
        };
        let reason = match &attempt.failures[..] {
            [] => "no address of it is known".to_owned(),
            failures => failures.join("; "),
        };
        self.finish(now, id, outcome, Text::from(reason));
    }

    /// Whether no letter for the same receiver is in front.
    pub(super) fn is_first(&self, id: u64) -> bool {
        let foreign = self.deliveries.get(&id).and_then(|d| d.foreign.as_deref());
        let letterbox = foreign.and_then(|foreign| self.post.boxes.get(&foreign.to.name));
        letterbox.is_some_and(|letterbox| letterbox.waiting.front() == Some(&id))
    }

    /// Sets out with the first letter that a connection is free for, if there is any.
    fn dial_next(&mut self, now: Now) -> bool {
        let next = match self.closing {
            true => None,
            false => self.post.next_to_dial(),
        };
        let Some((id, address, dialect)) = next else {
            return false;
        };
        let set_out = match &*address {
            Address::Http { .. } => self.post_over_http(now, id, &address),
            Address::Other { .. } => self.send_by_plug_in(now, id, &address, dialect),
            _ => self.dial_with(id, &address, dialect),
        };
        if let Err(reason) = set_out {
            self.place_refused(now, id, format!("{address}: {reason}"));
        }
        true
    }

    fn dial_with(
        &mut self,
        id: u64,
        address: &Arc<Address>,
        dialect: Dialect,
    ) -> Result<(), String> {
        let parts = self.written_for(id, address, dialect)?;
        let trip = Trip {
            delivery: id,
            address: Arc::clone(address),
            parts: parts.into(),
        };
        let dial = DialId(self.id());
        self.post.set_out(dial, trip);
        let addresses = vec![Address::clone(address)];
        self.outputs.push_back(Output::Dial {
            dial,
            addresses,
            link: false,
        });
        Ok(())
    }

    fn send_by_plug_in(
        &mut self,
        now: Now,
        id: u64,
        address: &Arc<Address>,
        dialect: Dialect,
    ) -> Result<(), String> {
        let parts = self.written_for(id, address, dialect)?;
        let deadline = self.deliveries.get(&id).map(|d| d.deadline);
        let post = PostId(self.id());
        self.post
            .set_out_posted(post, id, Arc::clone(address), false, false);
        self.outputs.push_back(Output::Send(Box::new(SentLetter {
            post,
            address: Address::clone(address),
            letter: joined(&parts, 0),
            timeout: deadline.unwrap_or_default().saturating_sub(now.mono),
        })));
        Ok(())
    }

    /// Whether letters for this address can leave: a transport that is not built in must be plugged
    /// in.
    pub(super) fn is_spoken(&self, address: &Address) -> bool {
        match address {
            Address::Other { scheme, .. } => {
                self.config.schemes.iter().any(|s| s.as_str() == scheme)
            }
            _ => true,
        }
    }

    /// It is of no use to try this place again: the next one is tried.
    pub(super) fn place_refused(&mut self, now: Now, id: u64, reason: String) {
        if let Some(attempt) = self.post.attempts.get_mut(&id) {
            attempt.tries = 0;
            attempt.failures.push(reason);
            attempt.places.pop_front();
        }
        self.try_place(now, id);
    }

    /// A letter as it is written to an address.
    fn written_for(
        &self,
        id: u64,
        address: &Address,
        dialect: Dialect,
    ) -> Result<Vec<Bytes>, String> {
        let foreign = self.deliveries.get(&id).and_then(|d| d.foreign.as_deref());
        let foreign = foreign.ok_or("it is not under way any more")?;
        // Nobody on another host is told where only this one reaches us.
        let useful = |own: &&Address| address.is_loopback() || !own.is_loopback();
        let endpoints = self.config.endpoints.iter().filter(|own| own.is_link());
        let endpoints = endpoints.filter(useful).map(Address::to_text).collect();
        dialects::write(foreign, dialect, endpoints, &self.config.limits)
    }

    pub(super) fn post_connected(&mut self, now: Now, conn: ConnId, dial: DialId) {
        let Some(trip) = self.post.dials.remove(&dial) else {
            return;
        };
        match self.post.attempts.get_mut(&trip.delivery) {
            Some(attempt) if !self.closing => {
                attempt.conn = Some(conn);
                self.outputs.push_back(Output::Transmit(conn));
                self.outputs.push_back(Output::Finish(conn));
                self.post.conns.insert(conn, trip);
            }
            _ => {
                self.outputs.push_back(Output::Close(conn));
                self.post.release(&trip.address, |busy| busy.first -= 1);
                self.run_post(now);
            }
        }
    }

    pub(super) fn post_dial_failed(&mut self, now: Now, dial: DialId, reason: &str) {
        if let Some(trip) = self.post.dials.remove(&dial) {
            self.post.release(&trip.address, |busy| busy.first -= 1);
            self.place_failed(now, trip.delivery, reason.to_owned());
            self.run_post(now);
        }
    }

    /// A connection has ended on which a letter was written.
    pub(super) fn post_closed(&mut self, now: Now, conn: ConnId, ended: Ended<'_>) {
        let Some(trip) = self.post.conns.remove(&conn) else {
            return;
        };
        self.post.release(&trip.address, |busy| busy.first -= 1);
        let Trip {
            delivery, address, ..
        } = trip;
        let attempt = self.post.attempts.get_mut(&delivery);
        let Some(attempt) = attempt.filter(|attempt| attempt.conn == Some(conn)) else {
            return self.run_post(now);
        };
        attempt.conn = None;
        let whole = ended.all_written && trip.parts.is_empty();
        if !whole {
            let reason = format!("{address}: {}", ended.reason);
            self.place_failed(now, delivery, reason);
            return self.run_post(now);
        }
        let Some(sent) = self.deliveries.get_mut(&delivery) else {
            return;
        };
        sent.via = Some(address.to_text());
        if ended.orderly {
            if let Some(foreign) = &sent.foreign {
                let name = foreign.to.name.clone();
                self.trust_neighbour(&name);
            }
            self.finish(now, delivery, Outcome::Sent, Text::default());
        } else {
            let reason = format!(
                "the connection to {address} broke when the whole letter was written, \
                 and nobody knows whether it arrived: {}",
                ended.reason
            );
            self.finish(now, delivery, Outcome::Timeout, Text::from(reason));
        }
    }

    /// A letter did not get to where it was tried.
    pub(super) fn place_failed(&mut self, now: Now, id: u64, reason: String) {
        let Some(attempt) = self.post.attempts.get_mut(&id) else {
            return;
        };
        attempt.tries += 1;
        if attempt.tries == TRIES {
            attempt.tries = 0;
            attempt.failures.push(reason);
            attempt.places.pop_front();
        }
        let foreign = self.deliveries.get(&id).and_then(|d| d.foreign.as_deref());
        if let Some(foreign) = foreign.filter(|foreign| foreign.addresses.is_empty()) {
            let name = foreign.to.name.clone();
            self.doubt_neighbour(&name);
        }
        self.try_place(now, id);
    }

    /// A letter is not on its way any more; the next one for the same receiver is.
    pub(super) fn post_ended(&mut self, now: Now, id: u64, foreign: &Foreign, octets: usize) {
        let name = &foreign.to.name;
        if let Some(letterbox) = self.post.boxes.get_mut(name) {
            // It is the first one, as a rule.
            let mut waiting = letterbox.waiting.iter();
            if let Some(at) = waiting.position(|waiting| *waiting == id) {
                letterbox.waiting.remove(at);
                letterbox.octets -= octets;
            }
        }
        if let Some(attempt) = self.post.attempts.remove(&id) {
            if !attempt.posted {
                self.post.queue.retain(|waiting| *waiting != id);
            }
            if let Some(conn) = attempt.conn {
                self.outputs.push_back(Output::Abort(conn));
            }
        }
        self.post.due.push_back(name.clone());
        self.run_post(now);
    }

    /// The letters for a neighbour of which nothing is written yet, the last one first: so none is
    /// tried because the one before it ends.
    pub(super) fn waiting_for_neighbour(&self, name: &str) -> Vec<u64> {
        let letterbox = self.post.boxes.get(name);
        let waiting = letterbox
            .into_iter()
            .flat_map(|letterbox| &letterbox.waiting);
        let by_entry = |id: &&u64| {
            let foreign = self.deliveries.get(id).and_then(|d| d.foreign.as_deref());
            foreign.is_some_and(|foreign| foreign.addresses.is_empty())
        };
        let unwritten = |id: &&u64| {
            let attempt = self.post.attempts.get(id);
            attempt.is_none_or(|attempt| attempt.conn.is_none() && !attempt.posted)
        };
        let waiting = waiting.filter(by_entry).filter(unwritten);
        waiting.rev().copied().collect()
    }

    /// What was tried for a letter, as the end of a sentence.
    pub(super) fn post_failures(&self, id: u64) -> String {
        match self.post.attempts.get(&id) {
            Some(attempt) if !attempt.failures.is_empty() => {
                format!(" ({})", attempt.failures.join("; "))
            }
            _ => String::new(),
        }
    }

    /// Whether a letter is being written: then it may arrive whatever happens here.
    pub(super) fn is_being_posted(&self, id: u64) -> bool {
        let attempt = self.post.attempts.get(&id);
        attempt.is_some_and(|attempt| attempt.conn.is_some() || attempt.posted)
    }

    /// Why a letter did not leave in time.
    pub(super) fn post_lateness(&self, id: u64) -> String {
        let tried = self.post_failures(id);
        let Some(attempt) = self.post.attempts.get(&id) else {
            return "letters to the same receiver were not written in time".to_owned();
        };
        let at = attempt.places.front().map(|(address, _)| address.to_text());
        let at = at.unwrap_or_default();
        match attempt.conn {
            Some(_) => format!("{at} did not take the whole letter in time{tried}"),
            None if attempt.posted => format!("{at} did not answer in time{tried}"),
            None => format!("{at} could not be reached in time{tried}"),
        }
    }

    /// What is being written is broken off.
    pub(super) fn end_post(&mut self) {
        let conns = self.post.conns.keys().copied();
        self.outputs.extend(conns.map(Output::Abort));
    }
}

/// The place of an address among the transports that a sender prefers; those that it does not name
/// are last.
pub(super) fn preference(address: &str, transports: &[Text]) -> usize {
    let scheme = address.split("://").next().unwrap_or_default();
    let mut preferred = transports.iter();
    preferred
        .position(|transport| transport == scheme)
        .unwrap_or(transports.len())
}
