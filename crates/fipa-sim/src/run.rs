//! Letting time pass.

use std::time::Duration;

use crate::events::Event;
use crate::sim::Sim;

impl Sim {
    /// Runs until a point on the clock of [`Now::mono`](fipa_directory::Now::mono).
    pub fn run_until(&mut self, until: Duration) {
        while self.queue.next_at().is_some_and(|at| at <= until) {
            self.step();
        }
        self.advance(until);
    }

    /// Runs for so long.
    pub fn run_for(&mut self, span: Duration) {
        self.run_until(self.now.mono + span);
    }

    /// Runs until nothing is under way - no octets, no dial, no letter without its outcome - but
    /// not longer than `at_most`. Whether it is quiet.
    pub fn run_until_quiet(&mut self, at_most: Duration) -> bool {
        let until = self.now.mono + at_most;
        while !(self.queue.is_quiet() && self.open_tickets == 0) {
            if self.queue.next_at().is_none_or(|at| at > until) {
                self.advance(until);
                return false;
            }
            self.step();
        }
        true
    }

    /// Does something later.
    pub fn after(&mut self, span: Duration, call: impl FnOnce(&mut Sim) + 'static) {
        self.put(span, Event::Call(Box::new(call)));
    }
}
