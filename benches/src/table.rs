//! Figures of one run.

use std::time::Duration;

/// Round trips that were timed.
#[derive(Debug)]
pub struct Times(Vec<Duration>);

impl Times {
    /// The times, in any order; one at least.
    pub fn new(mut times: Vec<Duration>) -> Times {
        times.sort();
        Times(times)
    }

    /// The time that this share of the round trips did not exceed, in microseconds.
    pub fn percentile(&self, share: f64) -> f64 {
        let last = self.0.len().saturating_sub(1);
        let at = (last as f64 * share).round() as usize;
        self.0.get(at).map_or(0.0, |time| time.as_secs_f64() * 1e6)
    }
}
