//! Letters of a peer that were taken in already: a letter that is sent again over a new link is
//! answered, not delivered twice.

use std::collections::{HashMap, VecDeque};

use fipa_link::ReceiverOutcome;

/// Letters of one peer that are remembered.
const REMEMBERED: usize = 16_384;

#[derive(Debug, Default)]
pub(super) struct Seen {
    letters: HashMap<u64, SeenLetter>,
    order: VecDeque<u64>,
}

/// What became of a letter that was taken in.
#[derive(Clone, Debug)]
pub(super) enum SeenLetter {
    /// Not known yet: this submission will tell.
    Pending(u64),
    /// The receipt that was given.
    Done(Vec<ReceiverOutcome>),
}

impl Seen {
    pub(super) fn get(&self, id: u64) -> Option<&SeenLetter> {
        self.letters.get(&id)
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
