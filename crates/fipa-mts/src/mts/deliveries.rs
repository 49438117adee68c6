//! Letters under way: what waits, what was sent, and what became of each.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::Text;
use fipa_directory::{InstanceId, Now};
use fipa_link::{LetterFrame, Outcome, Outcomes, ReceiverOutcome};
use smallvec::{SmallVec, smallvec};

use super::Mts;
use super::connections::Partner;
use super::dialects::Foreign;
use super::notices::Returnable;
use super::patterns::Names;
use super::routing::{Inbound, Terms};
use super::seen::SeenLetter;
use crate::machine::{ConnId, Output, REPLY_BY};
use crate::outbox::LetterId;
use crate::pieces::{Pieces, read_envelope};
use crate::{MailboxFull, Urgency};

/// Who is told what became of a letter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// Whoever submitted it here.
    Ticket(u64),
    /// The program at the end of this connection, by the number that it gave the letter.
    Program { conn: ConnId, id: u64 },
    /// A peer, by the number that it gave the letter; over whichever link it sent it last.
    Peer {
        instance: InstanceId,
        conn: ConnId,
        id: u64,
        /// It had been stored, and has this id.
        late: Option<LetterId>,
    },
    /// The outbox, in which the letter has this key.
    Outbox(u64),
    /// Nobody over a link: it came over a connection of its own, from there, with so many octets.
    /// Its sender is told of failures by notices.
    Caller {
        from: Text,
        octets: usize,
        letter: Box<Returnable>,
    },
    /// Nobody: it is such a notice itself, to this agent.
    Notice {
        to: Text,
        /// The stored letter that it is about, if it is about one.
        stored: Option<u64>,
    },
}

/// A letter whose outcomes are being collected.
#[derive(Debug)]
pub(super) struct Pending {
    origin: Origin,
    receivers: SmallVec<[Receiver; 1]>,
    open: usize,
}

/// A receiver of a letter, and what became of its copy.
#[derive(Debug)]
pub(super) struct Receiver {
    name: Text,
    told: Option<ReceiverOutcome>,
}

/// A copy of a letter for one receiver.
#[derive(Debug)]
pub(super) struct Delivery {
    pub(super) pending: u64,
    pub(super) slot: usize,
    pub(super) target: Target,
    /// The connection it went out on; `None` while it waits.
    pub(super) sent: Option<ConnId>,
    pub(super) parts: Pieces,
    /// What is needed where it may go to a service of another make.
    pub(super) foreign: Option<Box<Foreign>>,
    pub(super) deadline: Duration,
    /// When it is looked at next.
    pub(super) timer: Duration,
    /// After its deadline it is not to be sent any more.
    pub(super) expires: bool,
    /// Its sender waits for room where there is none.
    pub(super) patient: bool,
    /// In whose name it is, and how urgent it is.
    pub(super) sender: Text,
    pub(super) urgency: Urgency,
    pub(super) via: Option<Text>,
}

/// Where a copy goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    Program(ConnId),
    Peer(InstanceId),
    Seed(u64),
    /// A service of another make.
    Post,
    /// Nowhere yet: the receiver is on the move.
    Held,
    /// Nowhere yet: there is no room at the receiver.
    Full,
    /// Nowhere yet: the receiver's robot is away.
    Away,
}

impl Pending {
    /// A letter with one receiver, of which nothing is known yet.
    pub(super) fn of_one(origin: Origin, name: Text) -> Pending {
        Pending {
            origin,
            receivers: smallvec![Receiver { name, told: None }],
            open: 1,
        }
    }
}

impl Delivery {
    pub(super) fn octets(&self) -> usize {
        self.parts.iter().map(Bytes::len).sum()
    }

    /// Whether it has gone out, so that somebody may have it.
    pub(super) fn was_written(&self) -> bool {
        self.via.is_some()
    }

    /// Makes it a copy that nobody has.
    pub(super) fn take_back(&mut self) {
        self.sent = None;
        self.via = None;
    }
}

impl Mts {
    /// A letter that came over a link.
    pub(super) fn letter_received(&mut self, now: Now, conn: ConnId, frame: LetterFrame) {
        let Some(open) = self.conns.get(&conn) else {
            return;
        };
        let id = frame.id;
        let (mut origin, from, names) = match &open.partner {
            Partner::Unknown => return,
            Partner::Program { name, .. } => {
                let origin = Origin::Program { conn, id };
                (origin, name.clone(), Names::Patterns)
            }
            Partner::Daemon { instance, .. } => {
                let instance = *instance;
                if self.answered_before(now, instance, conn, id) {
                    return;
                }
                let name = self.peer_name(instance);
                let origin = Origin::Peer {
                    instance,
                    conn,
                    id,
                    late: None,
                };
                (origin, name, Names::Exact)
            }
        };
        let mut parts: Pieces = frame.parts.into_iter().collect();
        let mut envelope = std::mem::take(&mut self.spare);
        match read_envelope(&mut parts, &self.config.limits, &mut envelope) {
            Ok(payload) => {
                if let Origin::Peer { instance, late, .. } = &mut origin {
                    *late = Mts::late_letter(*instance, id, &envelope);
                    let instance = *instance;
                    if let Some(letter) = *late
                        && self.arrived_before(now, letter, (instance, conn, id))
                    {
                        return;
                    }
                }
                let inbound = Inbound {
                    payload,
                    parts,
                    envelope,
                    from: Some(from),
                    via: Some(match origin {
                        Origin::Program { .. } => "unix",
                        _ => "tcp",
                    }),
                    names,
                };
                let timeout = Duration::from_millis(frame.ttl_millis.into());
                // The first service on the way waits for room, on behalf of the sender.
                let terms = match origin {
                    Origin::Program { .. } => Terms::patient_within(timeout),
                    _ => Terms::within(timeout),
                };
                self.take_in(now, origin, inbound, terms);
            }
            Err(error) => {
                let reason = Text::from(format!("the envelope cannot be read: {error}"));
                self.answer_whole(now, origin, Outcome::Refused, reason);
            }
        }
    }

    /// Whether the letter was taken in before; then its receipt is given again, now or as soon as
    /// it is known.
    fn answered_before(&mut self, now: Now, instance: InstanceId, conn: ConnId, id: u64) -> bool {
        let seen = self.seen.get(&instance).and_then(|seen| seen.get(id));
        match seen.cloned().map(|seen| self.unfolded(seen)) {
            None | Some(SeenLetter::Passing(_)) => false,
            Some(SeenLetter::Done(outcomes)) => {
                self.send_receipt(now, conn, id, &outcomes);
                true
            }
            Some(SeenLetter::Pending(pending)) => {
                let late = match self.pending.get(&pending).map(|p| &p.origin) {
                    Some(Origin::Peer { late, .. }) => *late,
                    _ => None,
                };
                let origin = Origin::Peer {
                    instance,
                    conn,
                    id,
                    late,
                };
                self.repoint(pending, origin);
                true
            }
        }
    }

    /// Has somebody else told what becomes of a letter; whether that is not told already.
    pub(super) fn repoint(&mut self, pending: u64, origin: Origin) -> bool {
        let Some(pending) = self.pending.get_mut(&pending) else {
            return false;
        };
        pending.origin = origin;
        true
    }

    /// Begins to collect the outcomes of a letter.
    pub(super) fn open_pending<R>(
        &mut self,
        origin: Origin,
        receivers: &[R],
        name: impl Fn(&R) -> Text,
    ) -> u64 {
        let pending = self.id();
        if let Some(tap) = &mut self.tap {
            tap.opened(pending);
        }
        if let Origin::Peer {
            instance, id, late, ..
        } = origin
        {
            let seen = self.seen.entry(instance).or_default();
            seen.set(id, SeenLetter::Pending(pending));
            if let Some(late) = late {
                self.late.set(late, SeenLetter::Pending(pending));
            }
        }
        let receivers: SmallVec<_> = receivers
            .iter()
            .map(|receiver| Receiver {
                name: name(receiver).detached(),
                told: None,
            })
            .collect();
        let opened = Pending {
            origin,
            open: receivers.len(),
            receivers,
        };
        self.pending.insert(pending, opened);
        pending
    }

    /// Answers a letter that nothing was started for.
    pub(super) fn answer_whole(
        &mut self,
        now: Now,
        origin: Origin,
        outcome: Outcome,
        reason: Text,
    ) {
        let pending = self.open_pending(origin, &[()], |()| Text::default());
        self.settle(now, pending, 0, outcome, None, reason);
    }

    /// Notes one outcome; with the last one the origin is told.
    pub(super) fn settle(
        &mut self,
        now: Now,
        pending: u64,
        slot: usize,
        outcome: Outcome,
        via: Option<Text>,
        reason: Text,
    ) {
        let Some(collected) = self.pending.get_mut(&pending) else {
            return;
        };
        let Some(receiver) = collected.receivers.get_mut(slot) else {
            return;
        };
        if receiver.told.is_none() {
            collected.open -= 1;
        }
        receiver.told = Some(ReceiverOutcome {
            to: receiver.name.clone(),
            outcome,
            via,
            reason,
        });
        if collected.open == 0
            && let Some(collected) = self.pending.remove(&pending)
        {
            let told = collected.receivers.into_iter();
            let outcomes: Outcomes = told.filter_map(|receiver| receiver.told).collect();
            if self.tap.is_some() {
                self.tap_outcomes(now, pending, &outcomes);
            }
            self.tell(now, collected.origin, outcomes);
        }
    }

    fn tell(&mut self, now: Now, origin: Origin, outcomes: Outcomes) {
        match origin {
            Origin::Ticket(ticket) => {
                let outcomes = outcomes.into();
                self.outputs.push_back(Output::Outcome { ticket, outcomes });
            }
            Origin::Program { conn, id } => self.send_receipt(now, conn, id, &outcomes),
            Origin::Peer {
                instance,
                conn,
                id,
                late,
            } => {
                self.send_receipt(now, conn, id, &outcomes);
                let outcomes = Arc::new(outcomes);
                if let Some(late) = late {
                    self.late.set(late, SeenLetter::Done(Arc::clone(&outcomes)));
                }
                if let Some(seen) = self.seen.get_mut(&instance) {
                    seen.set(id, SeenLetter::Done(outcomes));
                }
            }
            Origin::Outbox(key) => self.outbox_told(now, key, &outcomes),
            Origin::Caller {
                from,
                octets,
                letter,
            } => {
                self.tell_of_caller(from, octets, &outcomes);
                self.return_letter(now, &letter, &outcomes);
            }
            Origin::Notice { to, stored } => self.tell_of_notice(now, (&to, stored), &outcomes),
        }
    }

    /// Sends a copy on its way: its number, which is that of our stamp on it, and where its outcome
    /// belongs.
    pub(super) fn deliver(
        &mut self,
        now: Now,
        place: (u64, u64, usize),
        target: Target,
        parts: Pieces,
        foreign: Option<Box<Foreign>>,
        terms: &Terms,
    ) {
        let (id, _, _) = place;
        self.add_delivery(now, place, target, parts, foreign, terms);
        if terms.patient && target != Target::Full && self.is_waited_for(id) {
            return self.wait_for_room(now, id, Text::default());
        }
        match target {
            Target::Program(conn) => self.transmit_delivery(now, conn, id),
            Target::Peer(instance) => self.queue_for_peer(now, instance, id),
            Target::Seed(seed) => self.queue_for_seed(now, seed, id),
            Target::Post => self.post(now, id),
            Target::Held => self.hold(now, id),
            Target::Away => self.wait_for_robot(now, id),
            Target::Full => {
                let reason = Text::from(MailboxFull.to_string());
                self.wait_for_room(now, id, reason);
            }
        }
    }

    /// Begins to look after a copy.
    pub(super) fn add_delivery(
        &mut self,
        now: Now,
        (id, pending, slot): (u64, u64, usize),
        target: Target,
        parts: Pieces,
        foreign: Option<Box<Foreign>>,
        terms: &Terms,
    ) {
        let deadline = now.mono + terms.timeout;
        let timer = self.first_look(deadline, terms.timeout);
        let delivery = Delivery {
            pending,
            slot,
            target,
            sent: None,
            parts,
            foreign,
            deadline,
            timer,
            expires: terms.expires,
            patient: terms.patient,
            sender: terms.sender.clone(),
            urgency: terms.urgency,
            via: None,
        };
        self.deliveries.insert(id, delivery);
        self.set_timer_of(id, timer);
    }

    /// Whether a copy was stored, and its sender told so.
    pub(super) fn is_from_outbox(&self, id: u64) -> bool {
        let pending = self.deliveries.get(&id).map(|delivery| delivery.pending);
        let pending = pending.and_then(|pending| self.pending.get(&pending));
        pending.is_some_and(|pending| matches!(pending.origin, Origin::Outbox(_)))
    }

    /// Writes a copy to a connection.
    pub(super) fn transmit_delivery(&mut self, now: Now, conn: ConnId, id: u64) {
        let (Some(delivery), Some(open)) = (self.deliveries.get(&id), self.conns.get(&conn)) else {
            return;
        };
        let octets = delivery.octets();
        let refusal = match open.partner {
            Partner::Daemon { max_letter, .. } | Partner::Program { max_letter, .. }
                if octets as u64 > max_letter =>
            {
                Some(format!(
                    "a letter of {octets} octets is larger than the {max_letter} it takes"
                ))
            }
            _ if open.link.queued() > self.config.queue_octets => {
                Some("what waits to be written to it is full".to_owned())
            }
            _ => None,
        };
        if let Some(reason) = refusal {
            self.not_taken(now, id, Outcome::Refused, Text::from(reason));
            return;
        }
        let via = self.conn_via(conn);
        let Some(delivery) = self.deliveries.get_mut(&id) else {
            return;
        };
        delivery.sent = Some(conn);
        delivery.via = Some(via);
        let left = delivery.deadline.saturating_sub(now.mono);
        let frame = LetterFrame {
            id,
            ttl_millis: ttl_for_next_hop(left),
            parts: delivery.parts.iter().cloned().collect(),
        };
        let urgency = delivery.urgency;
        if let Some(open) = self.conns.get_mut(&conn) {
            open.outstanding.insert(id);
        }
        self.send_letter(now, conn, urgency, frame);
    }

    /// The receipt for a letter that went out on a connection.
    pub(super) fn receipt(&mut self, now: Now, conn: ConnId, id: u64, outcomes: Outcomes) {
        self.unfold(id);
        let delivery = self.deliveries.get(&id);
        let delivery = delivery.filter(|delivery| delivery.sent == Some(conn));
        let has_left = |told: &ReceiverOutcome| {
            told.outcome == Outcome::Unknown
                && delivery.is_some_and(|delivery| delivery.target == Target::Program(conn))
                && !self.holds(conn, &told.to)
        };
        if outcomes.iter().any(has_left) {
            // The letter and the agent's leave have crossed.
            self.receipted(now, conn, id);
            self.reroute(now, id);
            return;
        }
        if delivery.is_some() {
            // A copy has one receiver; more come only from one whose name is a pattern elsewhere.
            let worst = outcomes.iter().find(|o| !o.outcome.is_success());
            match worst.or(outcomes.first()) {
                Some(told) => self.not_taken(now, id, told.outcome, told.reason.clone()),
                None => {
                    let reason = Text::from_static("the receipt names no receiver");
                    self.finish(now, id, Outcome::Refused, reason);
                }
            }
        }
        self.receipted(now, conn, id);
    }

    /// The receiver of a copy, and the octets of the copy.
    pub(super) fn receiver_of(&self, id: u64) -> Option<(Text, usize)> {
        let delivery = self.deliveries.get(&id)?;
        let pending = self.pending.get(&delivery.pending)?;
        let receiver = pending.receivers.get(delivery.slot)?;
        Some((receiver.name.clone(), delivery.octets()))
    }

    /// A connection owes no receipt for this letter any more.
    fn receipted(&mut self, now: Now, conn: ConnId, id: u64) {
        if let Some(open) = self.conns.get_mut(&conn) {
            open.outstanding.remove(&id);
            let partner = match open.partner {
                Partner::Daemon { instance, .. } if open.starved => Some(instance),
                _ => None,
            };
            if open.retired {
                self.retire(now, conn);
            }
            if let Some(instance) = partner {
                self.flush_waiting(now, instance);
            }
        }
    }

    /// Ends a delivery.
    pub(super) fn finish(&mut self, now: Now, id: u64, outcome: Outcome, reason: Text) {
        let Some(delivery) = self.deliveries.remove(&id) else {
            return;
        };
        let octets = delivery.octets();
        self.forget_waiting(now, id, &delivery);
        let Delivery {
            pending,
            slot,
            target,
            foreign,
            via,
            ..
        } = delivery;
        self.settle(now, pending, slot, outcome, via, reason);
        self.outbox_forgets(now, id);
        if let (Target::Post, Some(foreign)) = (target, foreign) {
            self.post_ended(now, id, &foreign, octets);
        }
    }

    /// Whether others wait already for room at the receiver of a copy.
    fn is_waited_for(&self, id: u64) -> bool {
        let receiver = self.receiver_of(id);
        receiver.is_some_and(|(receiver, _)| self.backlog.has(&receiver))
    }

    /// A copy that has ended does not wait any more.
    pub(super) fn forget_waiting(&mut self, now: Now, id: u64, ended: &Delivery) {
        if let (Target::Peer(instance), None) = (ended.target, ended.sent)
            && let Some(peer) = self.peers.get_mut(instance)
        {
            peer.waiting.remove(ended.urgency, &ended.sender, id);
        }
        if self.backlog.is_empty() {
            return;
        }
        let pending = self.pending.get(&ended.pending);
        let receiver = pending.and_then(|pending| pending.receivers.get(ended.slot));
        if let Some(receiver) = receiver.map(|receiver| receiver.name.clone()) {
            self.leave_backlog(now, &receiver, id);
        }
    }

    /// Gives a copy that nobody has a new number.
    pub(super) fn renew(&mut self, id: u64) -> Option<u64> {
        let delivery = self.deliveries.remove(&id)?;
        let renewed = self.id();
        let timer = delivery.timer;
        self.deliveries.insert(renewed, delivery);
        self.set_timer_of(renewed, timer);
        Some(renewed)
    }

    /// Makes a copy wait again whose connection ended before the receipt came.
    pub(super) fn unsend(&mut self, id: u64) {
        if let Some(delivery) = self.deliveries.get_mut(&id) {
            delivery.sent = None;
        }
    }

    pub(super) fn delivery_timeout(&mut self, now: Now, id: u64) {
        self.unfold(id);
        let deadline = self.deliveries.get(&id).map(|delivery| delivery.deadline);
        if deadline.is_some_and(|deadline| now.mono < deadline) {
            self.look_ahead(now, id);
            return;
        }
        if self.is_kept_for_later(now, id) {
            return;
        }
        let Some(delivery) = self.deliveries.get(&id) else {
            return;
        };
        let (target, sent) = (delivery.target, delivery.sent);
        let written = delivery.was_written();
        let reason = match (target, sent) {
            (Target::Program(_), _) => "its program did not take the letter in time".to_owned(),
            (Target::Peer(instance), Some(_)) => {
                format!("{} gave no receipt in time", self.peer_name(instance))
            }
            (Target::Peer(instance), None) => {
                let (name, error) = (self.peer_name(instance), self.peer_error(instance));
                format!("{name} could not be reached in time: {error}")
            }
            (Target::Seed(seed), _) => self.seed_error(seed),
            (Target::Post, _) => self.post_lateness(id),
            (Target::Held, _) => "the agent has gone, and has not turned up elsewhere".to_owned(),
            (Target::Full, _) => {
                let reason = self.full_reason(id);
                return self.finish(now, id, Outcome::Refused, reason);
            }
            (Target::Away, _) => self.away_reason(id),
        };
        // Also one that waits for another link: who had the first may have got it.
        let under_way = written || self.is_being_posted(id);
        if delivery.expires && !under_way {
            let reason = Text::from(format!("{REPLY_BY}: {reason}"));
            self.finish(now, id, Outcome::Expired, reason);
        } else {
            self.finish(now, id, Outcome::Timeout, Text::from(reason));
        }
        if let Some(conn) = sent {
            self.receipted(now, conn, id);
        }
    }
}

/// The next hop answers a little before we give up, so that its reason reaches the sender.
pub(super) fn ttl_for_next_hop(left: Duration) -> u32 {
    let margin = (left / 10).min(Duration::from_millis(250));
    u32::try_from((left - margin).as_millis()).unwrap_or(u32::MAX)
}
