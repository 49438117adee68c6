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
pub(super) struct Deadlines(BinaryHeap<Reverse<(Duration, u64)>>);

impl Deadlines {
    /// Notes a deadline. `is_open`: whether a letter still has this one; so many have any.
    pub(super) fn note(
        &mut self,
        at: Duration,
        id: u64,
        open: usize,
        is_open: impl Fn(Duration, u64) -> bool,
    ) {
        if self.0.len() > 2 * open + FEW {
            self.0.retain(|Reverse((at, id))| is_open(*at, *id));
        }
        self.0.push(Reverse((at, id)));
    }

    /// The next deadline; perhaps that of a letter that has ended.
    pub(super) fn next(&self) -> Option<Duration> {
        self.0.peek().map(|Reverse((at, _))| *at)
    }

    /// Takes out the next deadline that has come. Those of letters that have ended go, up to the
    /// first that stays.
    pub(super) fn take_due(
        &mut self,
        now: Duration,
        is_open: impl Fn(Duration, u64) -> bool,
    ) -> Option<u64> {
        while let Some(Reverse((at, id))) = self.0.peek().copied() {
            let open = is_open(at, id);
            if open && at > now {
                return None;
            }
            self.0.pop();
            if open {
                return Some(id);
            }
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
    fn what_has_ended_is_not_kept_until_its_time() {
        let mut deadlines = Deadlines::default();
        for id in 0..100_000 {
            let is_open = |_, noted| noted + 10 >= id;
            deadlines.note(secs(10 + id), id, 10, is_open);
            assert!(deadlines.0.len() <= 2 * 10 + FEW + 1);
        }
        assert_eq!(
            deadlines.take_due(secs(1 << 20), |_, id| id == 99_990),
            Some(99_990)
        );
    }
}
