//! Letters of a peer that were taken in already: a letter that is sent again over a new link is
//! answered, not delivered twice.

use std::collections::VecDeque;
use std::time::Duration;

use fipa_directory::{InstanceId, Now, State};
use fipa_link::Outcomes;

use super::{Mts, Numbered, Timer};

/// Letters of one peer that are remembered.
const REMEMBERED: usize = 16_384;

#[derive(Debug, Default)]
pub(super) struct Seen {
    letters: Numbered<SeenLetter>,
    order: VecDeque<u64>,
    /// When the peer was given up last.
    forgotten: Option<Duration>,
}

/// What became of a letter that was taken in.
#[derive(Clone, Debug)]
pub(super) enum SeenLetter {
    /// Not known yet: this submission will tell.
    Pending(u64),
    /// The receipt that was given.
    Done(Outcomes),
}

impl Seen {
    pub(super) fn get(&self, id: u64) -> Option<&SeenLetter> {
        self.letters.get(&id)
    }

    /// The letters that have arrived, the latest first.
    pub(super) fn arrived(&self) -> impl Iterator<Item = (u64, SeenLetter)> {
        let known = |id: &u64| Some((*id, self.letters.get(id)?.clone()));
        self.order
            .iter()
            .rev()
            .filter_map(known)
            .filter(|(_, letter)| {
                let SeenLetter::Done(outcomes) = letter else {
                    return false;
                };
                outcomes.iter().all(|told| told.outcome.is_success())
            })
    }

    pub(super) fn set(&mut self, id: u64, letter: SeenLetter) {
        if self.letters.insert(id, letter).is_none() {
            self.order.push_back(id);
            if self.order.len() > REMEMBERED
                && let Some(oldest) = self.order.pop_front()
            {
                self.letters.remove(&oldest);
            }
        }
    }
}

impl Mts {
    /// A peer that is given up here may not have given us up: what it sent is remembered for as
    /// long as it may wait for the receipts.
    pub(super) fn forget_seen_later(&mut self, now: Now, instance: InstanceId) {
        if let Some(seen) = self.seen.get_mut(&instance) {
            seen.forgotten = Some(now.mono);
            let at = now.mono + self.config.longest_wait;
            self.timer(at, Timer::Seen(instance));
        }
    }

    pub(super) fn seen_timeout(&mut self, now: Now, instance: InstanceId) {
        let over = self
            .seen
            .get(&instance)
            .and_then(|seen| seen.forgotten)
            .is_some_and(|at| now.mono >= at + self.config.longest_wait);
        let peer = self.peers.get(instance);
        if over && peer.is_none_or(|peer| peer.state == State::Gone) {
            let seen = self.seen.remove(&instance).unwrap_or_default();
            self.late.take_over(instance, &seen);
        }
    }
}
