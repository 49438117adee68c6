//! Patterns that letters are for: those that were compiled last, and how many of strangers are
//! compiled. Work is counted here, and never what comes of it.

use std::collections::VecDeque;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Pattern, PatternError};

/// Patterns that are kept, and what each of them costs at most: a costly one takes up to a megabyte.
const KEPT: usize = 16;
const KEPT_COST: u32 = 1024;

/// What patterns of strangers may cost in a second, as [`Pattern::cost`] counts: a twentieth of the
/// time, about. As much is saved up.
const COST: f64 = 100_000.0;

/// What a pattern costs at least, however short it is.
const LEAST: u32 = 200;

/// What names of receivers may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Names {
    /// Names only. Between our services they are exact: the first one resolves.
    Exact,
    /// Patterns as well.
    Patterns,
    /// Patterns as well, as many as may come from strangers.
    FewPatterns,
}

#[derive(Debug)]
pub(super) struct Patterns {
    /// The one that was used last is the first.
    kept: VecDeque<(Text, Pattern)>,
    /// What those of strangers may cost, and since when. It may be less than nothing, since what one
    /// costs is known afterwards.
    left: f64,
    at: Duration,
}

/// Why a pattern is not looked for.
#[derive(Debug)]
pub(super) enum NoPattern {
    Wrong(PatternError),
    TooMany,
}

impl Default for Patterns {
    fn default() -> Patterns {
        Patterns {
            kept: VecDeque::new(),
            left: COST,
            at: Duration::ZERO,
        }
    }
}

impl Patterns {
    /// The pattern of this text.
    pub(super) fn get(
        &mut self,
        now: Duration,
        text: &Text,
        of_stranger: bool,
    ) -> Result<Pattern, NoPattern> {
        let kept = self.kept.iter().position(|(kept, _)| kept == text);
        if let Some(used) = kept.and_then(|at| self.kept.remove(at)) {
            let pattern = used.1.clone();
            self.kept.push_front(used);
            return Ok(pattern);
        }
        if of_stranger && !self.has_left(now) {
            return Err(NoPattern::TooMany);
        }
        let pattern = Pattern::new(text);
        if of_stranger {
            let cost = pattern
                .as_ref()
                .map_or_else(PatternError::cost, Pattern::cost);
            self.left -= f64::from(cost.max(LEAST));
        }
        let pattern = pattern.map_err(NoPattern::Wrong)?;
        if pattern.cost() <= KEPT_COST {
            self.kept.truncate(KEPT - 1);
            self.kept.push_front((text.detached(), pattern.clone()));
        }
        Ok(pattern)
    }

    fn has_left(&mut self, now: Duration) -> bool {
        let since = now.saturating_sub(self.at);
        self.at = now;
        self.left = (self.left + COST * since.as_secs_f64()).min(COST);
        self.left > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_that_were_used_last_are_kept_unless_they_are_large() {
        let mut patterns = Patterns::default();
        let mut get = |text: &str| {
            let known = patterns.get(Duration::ZERO, &Text::from(text), false);
            known.unwrap();
            let kept = patterns.kept.iter().map(|(text, _)| text.to_string());
            kept.collect::<Vec<_>>()
        };
        get("first.*");
        (0..KEPT - 1).for_each(|n| drop(get(&format!("{n}.*"))));
        assert_eq!(get("first.*").len(), KEPT);
        let kept = get("new.*");
        assert_eq!(
            (kept.len(), &*kept[0], &*kept[1]),
            (KEPT, "new.*", "first.*")
        );
        assert!(!kept.contains(&"0.*".to_owned()));
        assert_eq!(get("x{2000}"), kept);
    }
}
