//! Letters that pass from one link to another, as nearly all do: to one agent, by a way that an
//! earlier letter took, and whose receipt says that they were delivered.
//!
//! ```text
//!   letter ─▶ has it a shape that is known here? ─▶ is the way still the same? ─▶ stamp, letter ─▶
//!        ◀─ the receipt that all letters of the way get                            ◀─ delivered
//! ```
//!
//! Such a letter is not read into an envelope, and what is kept of it is small. As soon as anything
//! else happens to it, it is unfolded to what any other letter is: a copy with its deadline, and
//! somebody who waits for its outcome. A way is looked at anew after whatever else has happened, so
//! nothing has to be told here when an agent moves, a link ends or a rule says no.

use std::sync::Arc;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Envelope, FipaTime, Received, Slots, Text};
use fipa_codec::bit_efficient::{EnvelopeShape, decode_envelope};
use fipa_directory::{InstanceId, Now};
use fipa_link::{
    Frame, LetterFrame, LinkError, Outcome, Outcomes, Piece, ReceiverOutcome, Run, WrittenOutcomes,
};
use smallvec::smallvec;

use super::Mts;
use super::connections::Partner;
use super::deliveries::{Delivery, Origin, Pending, Target, ttl_for_next_hop};
use super::peers::MAX_WAITING;
use super::routing::{MAX_HOPS, Route};
use super::seen::SeenLetter;
use super::stamps::{Date, Overlay};
use crate::Urgency;
use crate::machine::ConnId;

/// Ways that are known for the letters of one connection.
const WAYS: usize = 32;

/// Octets of an envelope whose shape is kept.
const MAX_ENVELOPE: usize = 512;

/// Letters that are passed over at most before another way is learned, where many cannot be learned
/// or are known.
const MAX_PAUSE: u32 = 31;

/// A letter on its way, as long as nothing out of the ordinary happens to it.
#[derive(Debug)]
pub(super) struct Passing {
    way: Arc<Way>,
    /// The number that it came with.
    theirs: u64,
    letter: Bytes,
    /// Our stamp's.
    date: Date,
    /// Whether it has gone out; until then it waits.
    sent: bool,
    deadline: Duration,
    /// When it is looked at first.
    timer: Duration,
    /// Its place among what its peer has sent.
    place: u64,
}

/// What letters have in common that come over one connection, from one agent, for another one.
#[derive(Debug)]
pub(super) struct Way {
    from: ConnId,
    /// The peer that sends them; `None`: a program.
    peer: Option<InstanceId>,
    target: Target,
    /// The connection that they go out on, and what their receipts say of it.
    conn: ConnId,
    via: Text,
    receiver: Text,
    sender: Text,
    urgency: Urgency,
    /// Our stamp.
    overlay: Overlay,
    /// What becomes of them.
    delivered: Arc<Outcomes>,
    receipt: WrittenOutcomes,
}

/// The ways that letters of a connection take.
#[derive(Debug, Default)]
pub(super) struct Ways {
    known: Vec<Known>,
    /// The one that was used last.
    last: usize,
    /// Letters that are passed over before another way is learned, and were the last time.
    skip: u32,
    pause: u32,
    /// What the number of the newest stamp begins with, which goes on with that of the letter; empty:
    /// the letters come from a program.
    prefix: String,
}

/// A way, and how the envelopes of its letters look.
#[derive(Debug)]
struct Known {
    shape: EnvelopeShape,
    sample: Box<Sample>,
    way: Arc<Way>,
    /// When it was looked at last.
    turn: u64,
    /// Letters wait for the same peer already.
    waits: bool,
}

/// One of the letters, as it was read.
#[derive(Debug)]
struct Sample {
    envelope: Envelope,
    origin: Origin,
    /// Its only receiver.
    to: Text,
    /// Whoever handed it over, as our stamp names it.
    from: Text,
}

/// Where the letters for an agent go now.
struct Place {
    target: Target,
    conn: ConnId,
    via: Text,
    /// Others wait for it.
    waits: bool,
}

impl Passing {
    pub(super) fn urgency(&self) -> Urgency {
        self.way.urgency
    }
}

impl Ways {
    /// The way of a letter with this number. `is_own`: whether a stamp is ours.
    fn find(&mut self, letter: &Bytes, id: u64, is_own: impl Fn(&[u8]) -> bool) -> Option<usize> {
        let order = (self.last..self.known.len()).chain(0..self.last);
        for at in order {
            if self.fits(&self.known.get(at)?.shape, letter, id, &is_own) {
                self.last = at;
                return Some(at);
            }
        }
        None
    }

    /// Whether a letter has this shape, and stamps that need not be looked at: it has not been here,
    /// and comes for the first time.
    fn fits(
        &self,
        shape: &EnvelopeShape,
        letter: &Bytes,
        id: u64,
        is_own: impl Fn(&[u8]) -> bool,
    ) -> bool {
        let mut newest = !self.prefix.is_empty();
        let stamp = |number: &[u8]| match std::mem::take(&mut newest) {
            true => {
                number
                    .strip_prefix(self.prefix.as_bytes())
                    .and_then(decimal)
                    == Some(id)
            }
            false => !is_own(number),
        };
        shape.fits(letter, stamp).is_some()
    }

    /// Whether it is worth while to learn a way that is not known.
    fn wants(&mut self) -> bool {
        let wants = self.skip == 0;
        self.skip = self.skip.saturating_sub(1);
        wants
    }

    /// A letter takes a way that cannot be learned. Others may take the same.
    fn failed(&mut self) {
        self.pause = (2 * self.pause + 1).min(MAX_PAUSE);
        self.skip = self.pause;
    }

    fn learn(&mut self, known: Known) -> usize {
        if self.known.len() < WAYS {
            self.last = self.known.len();
            self.known.push(known);
        } else {
            self.last = (self.last + WAYS - 1) % WAYS;
            if let Some(oldest) = self.known.get_mut(self.last) {
                *oldest = known;
            }
            self.skip = MAX_PAUSE;
        }
        self.pause = 0;
        self.last
    }
}

impl Mts {
    /// Reads letters and receipts that came one after the other, as long as their connection is
    /// there. An error when it is to be given up.
    pub(super) fn read_run(
        &mut self,
        now: Now,
        conn: ConnId,
        mut run: Run,
    ) -> Result<(), LinkError> {
        self.turn += 1;
        let open = self.conns.get_mut(&conn);
        let mut ways = open
            .map(|open| std::mem::take(&mut open.ways))
            .unwrap_or_default();
        let result = loop {
            match run.next_piece() {
                Ok(None) => break Ok(()),
                Ok(Some(piece)) => self.read_piece(now, conn, piece, &mut ways),
                Err(error) => break Err(error),
            }
            if !self.conns.contains_key(&conn) {
                break Ok(());
            }
        };
        if let Some(open) = self.conns.get_mut(&conn) {
            open.ways = ways;
        }
        self.settle_touched(now);
        result
    }

    fn read_piece(&mut self, now: Now, conn: ConnId, piece: Piece, ways: &mut Ways) {
        match piece {
            Piece::Letter {
                id,
                ttl_millis,
                mut octets,
            } => {
                if self.pass(now, conn, (id, ttl_millis), &mut octets, ways) {
                    return;
                }
                let parts = octets.into();
                let letter = LetterFrame {
                    id,
                    ttl_millis,
                    parts,
                };
                self.on_frame(now, conn, Frame::Letter(letter));
            }
            Piece::Delivered(id) => {
                if self.passed(now, conn, id) {
                    return;
                }
                // Neither the name nor the address in it is looked at.
                let outcomes = delivered(Text::default(), None).into();
                self.on_frame(now, conn, Frame::Receipt { id, outcomes });
            }
            Piece::Frame(frame) => self.on_frame(now, conn, frame),
        }
        self.turn += 1;
    }

    /// Passes a letter on, and takes it, if its way is known. Otherwise nothing is done.
    fn pass(
        &mut self,
        now: Now,
        conn: ConnId,
        (id, ttl_millis): (u64, u32),
        letter: &mut Bytes,
        ways: &mut Ways,
    ) -> bool {
        let is_own = |number: &[u8]| self.stamps.is_own(number);
        let at = match ways.find(letter, id, is_own) {
            Some(at) => at,
            None if !ways.wants() => return false,
            None => match self.learn_way(now, conn, id, letter, ways) {
                Some(at) => at,
                None => {
                    ways.failed();
                    return false;
                }
            },
        };
        let Some(known) = ways.known.get_mut(at) else {
            return false;
        };
        if known.turn != self.turn && !self.look_again(now, known) {
            return false;
        }
        let way = &known.way;
        let mut seen = way.peer.and_then(|peer| self.seen.get_mut(&peer));
        if seen.as_ref().is_some_and(|seen| !seen.is_next(id))
            || way.peer.is_some() && seen.is_none()
        {
            return false;
        }
        let Some(date) = self.stamps.date(now.unix_millis) else {
            return false;
        };
        let number = self.next_id + 2;
        self.front.clear();
        way.overlay.put(&date, number, &mut self.front);
        let octets = self.front.len() + letter.len();
        let Some(open) = self.conns.get_mut(&way.conn) else {
            return false;
        };
        if !open.takes(octets, self.config.queue_octets) {
            return false;
        }
        // As long as others wait it is they who are told when there is room.
        let sent = !known.waits && open.has_room();
        let timeout = Duration::from_millis(ttl_millis.into()).min(self.config.longest_wait);
        if sent {
            let head = (number, ttl_for_next_hop(timeout));
            open.link.pass_letter(now, head, &self.front, letter);
            open.passing += 1;
            open.touch(&mut self.touched, way.conn, false);
        } else {
            let Target::Peer(instance) = way.target else {
                return false;
            };
            let max = self.config.queue_octets;
            let peer = self.peers.get_mut(instance);
            let Some(peer) =
                peer.filter(|peer| peer.waiting.has_room(&way.sender, octets, MAX_WAITING, max))
            else {
                return false;
            };
            if peer.waiting.is_empty() {
                // Those on other ways to it wait, too.
                self.turn += 1;
                (known.turn, known.waits) = (self.turn, true);
            }
            peer.waiting.push(way.urgency, &way.sender, number, octets);
        }
        self.next_id = number;
        let place = seen
            .as_mut()
            .map(|seen| seen.push(id, SeenLetter::Passing(number)));
        let deadline = now.mono + timeout;
        let timer = self.first_look(deadline, timeout);
        let passing = Passing {
            way: Arc::clone(way),
            theirs: id,
            letter: std::mem::take(letter),
            date,
            sent,
            deadline,
            timer,
            place: place.unwrap_or_default(),
        };
        self.passing.push(number, passing);
        self.note_timer(number, timer);
        true
    }

    /// The receipt for a letter that passed: it was delivered. Whether it is one that passed over
    /// this connection; otherwise nothing is done.
    fn passed(&mut self, now: Now, conn: ConnId, id: u64) -> bool {
        let is_its = |passing: &Passing| passing.sent && passing.way.conn == conn;
        let Some(passing) = self.passing.remove_if(id, is_its) else {
            return false;
        };
        let way = passing.way;
        if let Some(open) = self.conns.get_mut(&conn) {
            open.passing -= 1;
            open.touch(&mut self.touched, conn, true);
        }
        if let Some(origin) = self.conns.get_mut(&way.from) {
            origin
                .link
                .send_written_receipt(now, passing.theirs, &way.receipt);
            origin.touch(&mut self.touched, way.from, false);
        }
        if let Some(seen) = way.peer.and_then(|peer| self.seen.get_mut(&peer)) {
            seen.set_at(passing.place, SeenLetter::Done(Arc::clone(&way.delivered)));
        }
        true
    }

    /// Does what is to be done once for all that was written, and all receipts that came.
    fn settle_touched(&mut self, now: Now) {
        while let Some(conn) = self.touched.pop() {
            let Some(open) = self.conns.get_mut(&conn) else {
                continue;
            };
            let freed = open.take_touch();
            let (starved, retired) = (open.starved && freed, open.retired && freed);
            let partner = match open.partner {
                Partner::Daemon { instance, .. } if starved => Some(instance),
                _ => None,
            };
            self.was_queued(conn);
            if retired {
                self.retire(now, conn);
            }
            if let Some(instance) = partner {
                self.flush_waiting(now, instance);
            }
        }
    }

    /// Writes a letter that has waited. Whether it is one that passes.
    pub(super) fn transmit_passing(&mut self, now: Now, conn: ConnId, id: u64) -> bool {
        let Some(passing) = self.passing.get_mut(id) else {
            return false;
        };
        self.front.clear();
        passing.way.overlay.put(&passing.date, id, &mut self.front);
        let octets = self.front.len() + passing.letter.len();
        let open = self.conns.get_mut(&conn);
        let open = open.filter(|open| {
            passing.way.conn == conn && open.takes(octets, self.config.queue_octets)
        });
        let Some(open) = open else {
            self.unfold(id);
            return false;
        };
        let left = passing.deadline.saturating_sub(now.mono);
        let head = (id, ttl_for_next_hop(left));
        open.link
            .pass_letter(now, head, &self.front, &passing.letter);
        open.passing += 1;
        passing.sent = true;
        true
    }

    /// Makes a letter that passes one like any other.
    pub(super) fn unfold(&mut self, id: u64) {
        let Some(passing) = self.passing.remove(id) else {
            return;
        };
        let way = passing.way;
        // The number before is that of whoever waits for the outcome.
        let pending = id - 1;
        let origin = match way.peer {
            Some(instance) => Origin::Peer {
                instance,
                conn: way.from,
                id: passing.theirs,
                late: None,
            },
            None => Origin::Program {
                conn: way.from,
                id: passing.theirs,
            },
        };
        self.pending
            .insert(pending, Pending::of_one(origin, way.receiver.clone()));
        if let Some(seen) = way.peer.and_then(|peer| self.seen.get_mut(&peer)) {
            seen.set_at(passing.place, SeenLetter::Pending(pending));
        }
        if passing.sent
            && let Some(open) = self.conns.get_mut(&way.conn)
        {
            open.passing -= 1;
            open.outstanding.insert(id);
        }
        let mut overlay = BytesMut::new();
        way.overlay.put(&passing.date, id, &mut overlay);
        let delivery = Delivery {
            pending,
            slot: 0,
            target: way.target,
            sent: passing.sent.then_some(way.conn),
            parts: smallvec![overlay.freeze(), passing.letter],
            foreign: None,
            deadline: passing.deadline,
            timer: passing.timer,
            expires: false,
            patient: way.peer.is_none(),
            sender: way.sender.clone(),
            urgency: way.urgency,
            via: passing.sent.then(|| way.via.clone()),
        };
        self.deliveries.insert(id, delivery);
    }

    /// The same for all that go to where this is so, in the order of their numbers; these.
    pub(super) fn unfold_all(
        &mut self,
        is_so: impl Fn(Target, Option<ConnId>) -> bool,
    ) -> Vec<u64> {
        let of = |passing: &Passing| {
            let way = &passing.way;
            is_so(way.target, passing.sent.then_some(way.conn))
        };
        let all = self.passing.iter().filter(|(_, passing)| of(passing));
        let mut all: Vec<u64> = all.map(|(id, _)| id).collect();
        all.sort_unstable();
        all.iter().for_each(|id| self.unfold(*id));
        all
    }

    /// What was seen, with its letter unfolded if that passes.
    pub(super) fn unfolded(&mut self, seen: SeenLetter) -> SeenLetter {
        match seen {
            SeenLetter::Passing(id) => {
                self.unfold(id);
                SeenLetter::Pending(id - 1)
            }
            seen => seen,
        }
    }

    /// Learns the way of a letter, if it is one that others may take.
    fn learn_way(
        &mut self,
        now: Now,
        conn: ConnId,
        id: u64,
        letter: &Bytes,
        ways: &mut Ways,
    ) -> Option<usize> {
        let (origin, from) = match &self.conns.get(&conn)?.partner {
            Partner::Unknown => return None,
            Partner::Program { name, .. } => (Origin::Program { conn, id }, name.clone()),
            Partner::Daemon { instance, .. } => {
                let instance = *instance;
                ways.prefix = format!("{instance}:");
                let from = self.peer_name(instance);
                let late = None;
                (
                    Origin::Peer {
                        instance,
                        conn,
                        id,
                        late,
                    },
                    from,
                )
            }
        };
        let begin = letter.slice(..letter.len().min(MAX_ENVELOPE));
        let shape = EnvelopeShape::of(&begin, &self.config.limits).ok()??;
        if !ways.fits(&shape, letter, id, |number| self.stamps.is_own(number)) {
            return None;
        }
        let (envelope, _) = decode_envelope(shape.octets(), &self.config.limits).ok()?;
        let [only] = envelope.intended_receiver() else {
            return None;
        };
        if envelope.stamps().count() >= MAX_HOPS {
            return None;
        }
        let to = only.name.detached();
        let sample = Sample {
            envelope,
            origin,
            to,
            from,
        };
        let place = self.place_of(&sample)?;
        let waits = place.waits;
        let way = Arc::new(self.way(now, &sample, place)?);
        Some(ways.learn(Known {
            shape,
            sample: Box::new(sample),
            way,
            turn: self.turn,
            waits,
        }))
    }

    /// Whether letters take a way still; it is another one where their receiver has moved, or the
    /// link.
    fn look_again(&mut self, now: Now, known: &mut Known) -> bool {
        let sample = &mut *known.sample;
        let Some(place) = self.place_of(sample) else {
            return false;
        };
        let way = &known.way;
        let same = (place.target, place.conn, &place.via) == (way.target, way.conn, &way.via);
        let renamed = way
            .peer
            .map(|peer| self.peer_name(peer))
            .filter(|name| *name != sample.from);
        known.waits = place.waits;
        if let Some(name) = renamed {
            sample.from = name;
        } else if same {
            known.turn = self.turn;
            return true;
        }
        let Some(way) = self.way(now, sample, place) else {
            return false;
        };
        known.way = Arc::new(way);
        known.turn = self.turn;
        true
    }

    /// Where such letters go; `None`: not by the way of most.
    fn place_of(&self, sample: &Sample) -> Option<Place> {
        let Sample {
            envelope,
            origin,
            to,
            ..
        } = sample;
        if self.tap.is_some()
            || !self.backlog.is_empty()
            || self.outbox.has(to)
            || self.letter_refusal(origin, envelope, to).is_some()
        {
            return None;
        }
        let (target, conn, waits) = match self.route_to(to)? {
            Route::Program(conn) => (Target::Program(conn), conn, false),
            Route::Peer(instance) => {
                let peer = self.peers.get(instance)?;
                let mut links = peer.links.iter();
                let used = |conn: &&ConnId| self.conns.get(conn).is_some_and(|open| !open.retired);
                let conn = *links.find(used)?;
                (Target::Peer(instance), conn, !peer.waiting.is_empty())
            }
            _ => return None,
        };
        let open = self.conns.get(&conn)?;
        (open.is_whole() && !open.link.has_lanes()).then(|| Place {
            target,
            conn,
            via: open.via.clone(),
            waits,
        })
    }

    fn way(&mut self, now: Now, sample: &Sample, place: Place) -> Option<Way> {
        let (from, peer, via) = match sample.origin {
            Origin::Peer { instance, conn, .. } => (conn, Some(instance), "tcp"),
            Origin::Program { conn, .. } => (conn, None, "unix"),
            _ => return None,
        };
        let number = self.next_id;
        let overlay = Slots {
            received: Some(Received {
                by: self.config.name.clone(),
                from: Some(sample.from.clone()),
                date: FipaTime::from_unix_millis(now.unix_millis),
                id: Some(self.stamps.id(number)),
                via: Some(Text::from_static(via)),
                user_defined: Vec::new(),
            }),
            ..Slots::default()
        };
        let delivered = delivered(sample.to.clone(), Some(place.via.clone()));
        let sender = sample.envelope.from();
        Some(Way {
            from,
            peer,
            target: place.target,
            conn: place.conn,
            via: place.via,
            receiver: sample.to.clone(),
            sender: sender.map(|from| from.name.clone()).unwrap_or_default(),
            urgency: Urgency::of(&sample.envelope),
            overlay: self.stamps.repeated(&overlay, number, now.unix_millis)?,
            receipt: WrittenOutcomes::new(std::slice::from_ref(&delivered)),
            delivered: Arc::new(delivered.into()),
        })
    }
}

/// The outcome of a letter that was delivered.
fn delivered(to: Text, via: Option<Text>) -> ReceiverOutcome {
    ReceiverOutcome {
        to,
        outcome: Outcome::Delivered,
        via,
        reason: Text::default(),
    }
}

/// The number in these digits, if they are written as usual.
fn decimal(digits: &[u8]) -> Option<u64> {
    if digits.is_empty() || digits.len() > 1 && digits.starts_with(b"0") {
        return None;
    }
    digits.iter().try_fold(0_u64, |number, digit| {
        let digit = digit.checked_sub(b'0').filter(|digit| *digit < 10)?;
        number.checked_mul(10)?.checked_add(digit.into())
    })
}
