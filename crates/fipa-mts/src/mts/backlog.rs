//! Letters whose queue was full, of senders that wait for room: a mailbox that nobody reads, here or
//! elsewhere, or a peer for which too much waits.
//!
//! The letters for one receiver keep their order: one at a time is tried again, after a pause that
//! grows, until there is room or its time is over. Nobody else waits for them.

use std::collections::{HashMap, VecDeque};
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::Now;
use fipa_link::Outcome;

use super::deliveries::Target;
use super::routing::Route;
use super::{Mts, Timer};
use crate::machine::was_full;

/// Letters of all that wait for room, at most.
const MAX_LETTERS: usize = 10_000;

/// The pause before a letter is tried again; each further one is twice as long, up to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(10);
const LONGEST_PAUSE: Duration = Duration::from_millis(200);

/// Letters that wait for room.
#[derive(Debug, Default)]
pub(super) struct Backlog {
    crowds: HashMap<Text, Crowd>,
    letters: usize,
    octets: usize,
}

/// Those for one receiver.
#[derive(Debug)]
struct Crowd {
    waiting: VecDeque<(u64, usize)>,
    octets: usize,
    /// The first one, on its way.
    trying: Option<u64>,
    pause: Duration,
    /// Why the last one had to wait.
    reason: Text,
}

impl Backlog {
    /// Whether nobody waits.
    pub(super) fn is_empty(&self) -> bool {
        self.crowds.is_empty()
    }

    /// Whether others wait for room at this receiver.
    pub(super) fn has(&self, receiver: &Text) -> bool {
        self.crowds.contains_key(receiver)
    }

    /// Whether one more may wait; each receiver may have as much as is left free.
    fn has_room(&self, receiver: &Text, octets: usize, max_octets: usize) -> bool {
        let crowd = self.crowds.get(receiver);
        let letters = crowd.map_or(0, |crowd| crowd.waiting.len());
        let held = crowd.map_or(0, |crowd| crowd.octets);
        let free = max_octets.saturating_sub(self.octets);
        letters < MAX_LETTERS - self.letters && (letters == 0 || held + octets <= free)
    }

    fn put(&mut self, receiver: Text, id: u64, octets: usize, first: bool) -> &mut Crowd {
        self.letters += 1;
        self.octets += octets;
        let crowd = self.crowds.entry(receiver).or_insert_with(|| Crowd {
            waiting: VecDeque::new(),
            octets: 0,
            trying: None,
            pause: FIRST_PAUSE,
            reason: Text::default(),
        });
        crowd.octets += octets;
        match first {
            true => crowd.waiting.push_front((id, octets)),
            false => crowd.waiting.push_back((id, octets)),
        }
        crowd
    }

    /// Takes the first letter for a receiver out, to be tried.
    fn take_first(&mut self, receiver: &Text) -> Option<u64> {
        let crowd = self.crowds.get_mut(receiver)?;
        if crowd.trying.is_some() {
            return None;
        }
        let (id, octets) = crowd.waiting.pop_front()?;
        crowd.trying = Some(id);
        crowd.octets -= octets;
        self.letters -= 1;
        self.octets -= octets;
        Some(id)
    }

    fn remove(&mut self, receiver: &Text, id: u64) {
        if let Some(crowd) = self.crowds.get_mut(receiver)
            && let Some(at) = crowd.waiting.iter().position(|(known, _)| *known == id)
            && let Some((_, octets)) = crowd.waiting.remove(at)
        {
            crowd.octets -= octets;
            self.letters -= 1;
            self.octets -= octets;
        }
    }
}

impl Mts {
    /// Ends a copy that was not taken, unless that is because a queue is full and its sender waits
    /// for room.
    pub(super) fn not_taken(&mut self, now: Now, id: u64, outcome: Outcome, reason: Text) {
        match self.deliveries.get(&id) {
            Some(delivery) if delivery.patient && was_full(outcome, &reason) => {
                self.wait_for_room(now, id, reason);
            }
            _ => self.finish(now, id, outcome, reason),
        }
    }

    /// Lets a copy wait for room at its receiver.
    pub(super) fn wait_for_room(&mut self, now: Now, id: u64, reason: Text) {
        let Some((receiver, octets)) = self.receiver_of(id) else {
            return;
        };
        let crowd = self.backlog.crowds.get_mut(&receiver);
        let again = crowd.is_some_and(|crowd| {
            let again = crowd.trying == Some(id);
            if again {
                crowd.trying = None;
                crowd.pause = (crowd.pause * 2).min(LONGEST_PAUSE);
            }
            again
        });
        let max = self.config.queue_octets;
        if !again && !self.backlog.has_room(&receiver, octets, max) {
            return self.finish(now, id, Outcome::Refused, reason);
        }
        let Some(delivery) = self.deliveries.get_mut(&id) else {
            return;
        };
        delivery.take_back();
        delivery.target = Target::Full;
        let crowd = self.backlog.put(receiver.clone(), id, octets, again);
        if !reason.is_empty() {
            crowd.reason = reason;
        }
        let at = now.mono + crowd.pause;
        if again || crowd.waiting.len() == 1 {
            self.timer(at, Timer::Room(receiver));
        }
    }

    /// Tries the first letter for a receiver again.
    pub(super) fn room_timeout(&mut self, now: Now, receiver: &Text) {
        let Some(id) = self.backlog.take_first(receiver) else {
            return;
        };
        // A peer that refused it would answer the same number with the same receipt.
        let Some(renewed) = self.renew(id) else {
            return;
        };
        if let Some(crowd) = self.backlog.crowds.get_mut(receiver) {
            crowd.trying = Some(renewed);
        }
        self.try_again(now, renewed, receiver);
    }

    /// Starts a copy anew that had to wait, to where its receiver is now.
    fn try_again(&mut self, now: Now, id: u64, receiver: &Text) {
        let foreign = self.deliveries.get(&id).and_then(|d| d.foreign.as_deref());
        let addresses = match (foreign, self.route_to(receiver)) {
            (None, _) | (_, Some(Route::Peer(_) | Route::Program(_) | Route::Mailbox)) => {
                return self.reroute(now, id);
            }
            (Some(foreign), _) => foreign.addresses.clone(),
        };
        let target = self.target_at(now, &addresses);
        if let Some(delivery) = self.deliveries.get_mut(&id) {
            delivery.target = target;
        }
        match target {
            Target::Seed(seed) => self.queue_for_seed(now, seed, id),
            _ => self.post(now, id),
        }
    }

    /// A copy has ended: it does not wait for room any more, and the next one may be tried.
    pub(super) fn leave_backlog(&mut self, now: Now, receiver: &Text, id: u64) {
        self.backlog.remove(receiver, id);
        let Some(crowd) = self.backlog.crowds.get_mut(receiver) else {
            return;
        };
        let tried = crowd.trying == Some(id);
        if tried {
            crowd.trying = None;
            crowd.pause = FIRST_PAUSE;
        }
        if crowd.trying.is_none() && crowd.waiting.is_empty() {
            self.backlog.crowds.remove(receiver);
        } else if tried {
            self.timer(now.mono, Timer::Room(receiver.clone()));
        }
    }

    /// Why a copy waits for room.
    pub(super) fn full_reason(&self, id: u64) -> Text {
        let receiver = self.receiver_of(id).map(|(receiver, _)| receiver);
        let crowd = receiver.and_then(|receiver| self.backlog.crowds.get(&receiver));
        crowd.map(|crowd| crowd.reason.clone()).unwrap_or_default()
    }
}
