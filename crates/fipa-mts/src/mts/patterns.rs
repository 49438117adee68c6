//! Patterns that letters are for: those that were compiled last, and how many of strangers are
//! compiled. Work is counted here, and never what comes of it.

use std::collections::VecDeque;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Pattern, PatternError};

/// Patterns that are kept.
const KEPT: usize = 64;

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
        if let Some(at) = self.kept.iter().position(|(kept, _)| kept == text) {
            if let Some(used) = self.kept.remove(at) {
                self.kept.push_front(used);
            }
        } else {
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
            self.kept.truncate(KEPT - 1);
            self.kept.push_front((text.detached(), pattern));
        }
        let first = self.kept.front();
        first
            .map(|(_, pattern)| pattern.clone())
            .ok_or(NoPattern::TooMany)
    }

    fn has_left(&mut self, now: Duration) -> bool {
        let since = now.saturating_sub(self.at);
        self.at = now;
        self.left = (self.left + COST * since.as_secs_f64()).min(COST);
        self.left > 0.0
    }
}
