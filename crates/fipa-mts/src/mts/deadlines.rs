//! When copies of letters are to be looked at.
//!
//! Nearly every letter has its outcome long before its deadline, and most deadlines come in their
//! order. So one is only noted, at the end; nothing is done when its letter has ended. What was
//! noted of letters that have ended is thrown away once it is most of all.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::time::Duration;

/// So few deadlines of letters that have ended are not worth throwing away.
const FEW: usize = 1024;

/// Deadlines, the next one first, and the letters that they are of.
#[derive(Debug, Default)]
pub(super) struct Deadlines {
    noted: BinaryHeap<Reverse<Noted>>,
    /// What was noted last, to which more letters may be added.
    last: Option<Noted>,
}

/// When letters are to be looked at: from this number to that one, as far as they are open.
type Noted = (Duration, u64, u64);

/// How far apart the numbers of letters are that came together.
const STEP: u64 = 2;

impl Deadlines {
    /// Notes a deadline. `is_open`: whether a letter still has this one; so many have any.
    pub(super) fn note(
        &mut self,
        at: Duration,
        id: u64,
        open: usize,
        is_open: impl Fn(Duration, u64) -> bool,
    ) {
        if let Some((same, _, to)) = &mut self.last
            && *same == at
            && id.checked_sub(*to).is_some_and(|apart| apart <= STEP)
        {
            *to = id;
            return;
        }
        if self.noted.len() > 2 * open + FEW {
            self.noted
                .retain(|Reverse((at, from, to))| (*from..=*to).any(|id| is_open(*at, id)));
        }
        self.noted
            .extend(self.last.replace((at, id, id)).map(Reverse));
    }

    /// The next deadline; perhaps that of a letter that has ended.
    pub(super) fn next(&self) -> Option<Duration> {
        let first = self.noted.peek().map(|Reverse(noted)| noted);
        first
            .into_iter()
            .chain(&self.last)
            .map(|noted| noted.0)
            .min()
    }

    /// Takes out the next deadline that has come. Those of letters that have ended go, up to the
    /// first that stays.
    pub(super) fn take_due(
        &mut self,
        now: Duration,
        is_open: impl Fn(Duration, u64) -> bool,
    ) -> Option<u64> {
        self.noted.extend(self.last.take().map(Reverse));
        while let Some(Reverse((at, from, to))) = self.noted.pop() {
            let Some(id) = (from..=to).find(|id| is_open(at, *id)) else {
                continue;
            };
            if at > now {
                self.noted.push(Reverse((at, id, to)));
                return None;
            }
            if id < to {
                self.noted.push(Reverse((at, id + 1, to)));
            }
            return Some(id);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn secs(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn what_is_due_comes_in_its_order_and_what_has_ended_does_not_come() {
        let mut deadlines = Deadlines::default();
        for (at, id) in [(3, 1), (1, 2), (2, 3), (4, 4), (9, 5)] {
            deadlines.note(secs(at), id, 5, |_, _| true);
        }
        let is_open = |_, id| id != 3 && id != 4;
        assert_eq!(deadlines.next(), Some(secs(1)));
        assert_eq!(deadlines.take_due(secs(3), is_open), Some(2));
        assert_eq!(deadlines.take_due(secs(3), is_open), Some(1));
        assert_eq!(deadlines.take_due(secs(3), is_open), None);
        // The fourth has gone without being due.
        assert_eq!(deadlines.next(), Some(secs(9)));
    }

    #[test]
    fn letters_that_came_together_are_noted_once_and_each_comes() {
        let mut deadlines = Deadlines::default();
        for id in (2..=200).step_by(2) {
            deadlines.note(secs(5), id, 100, |_, _| true);
        }
        deadlines.note(secs(4), 202, 101, |_, _| true);
        deadlines.note(secs(5), 204, 102, |_, _| true);
        assert_eq!(deadlines.noted.len(), 2);
        assert_eq!(deadlines.next(), Some(secs(4)));
        let is_open = |_, id| id % 4 == 0 || id == 202;
        let due = std::iter::from_fn(|| deadlines.take_due(secs(9), is_open));
        let expected: Vec<u64> = std::iter::once(202).chain((4..=204).step_by(4)).collect();
        assert_eq!(due.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn what_has_ended_is_not_kept_until_its_time() {
        let mut deadlines = Deadlines::default();
        for id in 0..100_000 {
            let is_open = |_, noted| noted + 10 >= id;
            deadlines.note(secs(10 + id), id, 10, is_open);
            assert!(deadlines.noted.len() <= 2 * 10 + FEW + 1);
        }
        assert_eq!(
            deadlines.take_due(secs(1 << 20), |_, id| id == 99_990),
            Some(99_990)
        );
    }
}
