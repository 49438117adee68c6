//! Letters of a peer that were taken in already: a letter that is sent again over a new link is
//! answered, not delivered twice.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use fipa_directory::{InstanceId, Now, State};
use fipa_link::Outcomes;

use super::{Mts, Numbered, Timer};

/// Letters of one peer that are remembered.
const REMEMBERED: usize = 16_384;

/// What one peer has sent.
///
/// Most letters come in the order of their numbers, and these are found by that order; only the
/// others need a table.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// In the order in which they came.
    letters: VecDeque<Remembered>,
    /// How many came before the first of them.
    gone: u64,
    /// Places of those that came after one with a greater number.
    late: Numbered<u64>,
    /// When the peer was given up last.
    forgotten: Option<Duration>,
}

#[derive(Debug)]
struct Remembered {
    number: u64,
    /// The greatest number that had come by then.
    greatest: u64,
    letter: SeenLetter,
}

/// What became of a letter that was taken in.
#[derive(Clone, Debug)]
pub(super) enum SeenLetter {
    /// Not known yet: this submission will tell.
    Pending(u64),
    /// Not known yet: its copy passes, with this number.
    Passing(u64),
    /// The receipt that was given.
    Done(Arc<Outcomes>),
}

impl Seen {
    /// Whether no letter has come whose number is this or a greater one.
    pub(super) fn is_next(&self, number: u64) -> bool {
        self.letters
            .back()
            .is_none_or(|last| last.greatest < number)
    }

    pub(super) fn get(&self, number: u64) -> Option<&SeenLetter> {
        let at = self.find(number)?;
        self.letters.get(at).map(|known| &known.letter)
    }

    /// The letters that have arrived, the latest first.
    pub(super) fn arrived(&self) -> impl Iterator<Item = (u64, SeenLetter)> {
        let letters = self.letters.iter().rev();
        let known = letters.map(|known| (known.number, known.letter.clone()));
        known.filter(|(_, letter)| {
            let SeenLetter::Done(outcomes) = letter else {
                return false;
            };
            outcomes.iter().all(|told| told.outcome.is_success())
        })
    }

    pub(super) fn set(&mut self, number: u64, letter: SeenLetter) {
        let found = self.find(number).and_then(|at| self.letters.get_mut(at));
        match found {
            Some(known) => known.letter = letter,
            None => drop(self.push(number, letter)),
        }
    }

    /// Adds a letter that is not known; its place.
    pub(super) fn push(&mut self, number: u64, letter: SeenLetter) -> u64 {
        let place = self.gone + self.letters.len() as u64;
        let last = self.letters.back().map(|last| last.greatest);
        let greatest = last.map_or(number, |last| last.max(number));
        if last.is_some_and(|last| last >= number) {
            self.late.insert(number, place);
        }
        self.letters.push_back(Remembered {
            number,
            greatest,
            letter,
        });
        if self.letters.len() > REMEMBERED
            && let Some(oldest) = self.letters.pop_front()
        {
            if oldest.number != oldest.greatest {
                self.late.remove(&oldest.number);
            }
            self.gone += 1;
        }
        place
    }

    /// Says what became of the letter at a place, if that is still remembered.
    pub(super) fn set_at(&mut self, place: u64, letter: SeenLetter) {
        let at = place.checked_sub(self.gone).map(|at| at as usize);
        if let Some(known) = at.and_then(|at| self.letters.get_mut(at)) {
            known.letter = letter;
        }
    }

    fn find(&self, number: u64) -> Option<usize> {
        if self.is_next(number) {
            return None;
        }
        if let Some(place) = self.late.get(&number) {
            return Some((place - self.gone) as usize);
        }
        let at = self
            .letters
            .partition_point(|known| known.greatest < number);
        self.letters
            .get(at)
            .filter(|known| known.number == number)?;
        Some(at)
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_letters_that_came_last_are_remembered() {
        let mut seen = Seen::default();
        let odd = |place: u64| 2 * place + 1;
        // One in seven comes late.
        let numbers: Vec<u64> = (0..20_000)
            .map(|place| match place % 7 {
                0 => odd(place) / 2 * 2,
                _ => odd(place) + 100,
            })
            .collect();
        for (place, number) in numbers.iter().enumerate() {
            assert!(seen.get(*number).is_none());
            seen.set(*number, SeenLetter::Pending(place as u64));
        }
        for (place, number) in numbers.iter().enumerate() {
            let known = match seen.get(*number) {
                Some(SeenLetter::Pending(known)) => Some(*known),
                _ => None,
            };
            let remembered = place >= numbers.len() - REMEMBERED;
            assert_eq!(known, remembered.then_some(place as u64));
        }
        assert!(seen.late.len() < REMEMBERED / 6);
    }

    proptest! {
        #[test]
        fn whatever_the_order_of_the_numbers_each_is_found(numbers: Vec<u8>) {
            let mut seen = Seen::default();
            let mut known = std::collections::BTreeMap::new();
            for (at, number) in numbers.iter().enumerate() {
                let (at, number) = (at as u64, u64::from(*number));
                let is_next = known.keys().all(|other| *other < number);
                prop_assert_eq!(seen.is_next(number), is_next);
                prop_assert_eq!(seen.get(number).is_some(), known.contains_key(&number));
                seen.set(number, SeenLetter::Pending(at));
                known.insert(number, at);
                for (number, at) in &known {
                    let found = seen.get(*number);
                    let fits = matches!(found, Some(SeenLetter::Pending(found)) if found == at);
                    prop_assert!(fits, "{} is {:?}", number, found);
                }
            }
        }
    }
}
