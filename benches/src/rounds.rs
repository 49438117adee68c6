//! Times operations in rounds: each round runs all of them, one after the other.
//!
//! What is asked for are ratios, on machines whose clock rate changes and which others use too. A
//! harness that measures one operation for seconds and then the next compares different seconds.
//! Here what is compared ran within the same few milliseconds: ratios are taken round by round,
//! and their median is told, which a disturbed round does not move.
//!
//! Where the buffers of an operation lie can make a copy several times as long, in all rounds. So
//! the operations are made anew a few times, each time in other memory.

use std::time::{Duration, Instant};

use crate::operations::Operation;

/// How often the operations are made, rounds with each, and how long one is repeated in a round.
const PLACES: usize = 7;
const ROUNDS: usize = 5;
const SPAN: Duration = Duration::from_millis(2);

/// Nanoseconds that each operation took, round by round.
#[derive(Debug)]
pub struct Rounds(Vec<Vec<f64>>);

impl Rounds {
    /// Runs the operations that `make` makes, the same ones each time.
    pub fn run(make: impl Fn() -> Vec<Operation>) -> Rounds {
        // They are kept, so that the next ones cannot lie in the same place.
        let mut places: Vec<_> = (0..PLACES).map(|_| make()).collect();
        let mut rounds = Rounds(vec![Vec::new(); places[0].len()]);
        for operations in &mut places {
            rounds.add(operations);
        }
        rounds
    }

    /// Every round begins with another operation, so that none always follows the same one.
    fn add(&mut self, operations: &mut [Operation]) {
        let counts: Vec<_> = operations.iter_mut().map(repetitions).collect();
        for round in 0..ROUNDS {
            for step in 0..operations.len() {
                let at = (round + step) % operations.len();
                let time = repeated(&mut operations[at], counts[at]);
                self.0[at].push(time.as_secs_f64() * 1e9 / f64::from(counts[at]));
            }
        }
    }

    /// Nanoseconds of an operation.
    pub fn median(&self, operation: usize) -> f64 {
        median(self.0[operation].clone())
    }

    /// How many times as long as another operation it took in the same round.
    pub fn ratio(&self, operation: usize, other: usize) -> f64 {
        let pairs = self.0[operation].iter().zip(&self.0[other]);
        median(pairs.map(|(one, other)| one / other).collect())
    }
}

/// So many repetitions fill the span of a round; finding that out is a round that does not count.
fn repetitions(operation: &mut Operation) -> u32 {
    let mut count = 1;
    loop {
        let time = repeated(operation, count);
        if time >= SPAN || count >= 1 << 24 {
            let share = SPAN.as_secs_f64() / time.as_secs_f64().max(1e-9);
            return ((f64::from(count) * share) as u32).max(1);
        }
        count *= 2;
    }
}

fn repeated(operation: &mut Operation, count: u32) -> Duration {
    let start = Instant::now();
    for _ in 0..count {
        (operation.run)();
    }
    start.elapsed()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
