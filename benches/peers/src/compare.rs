//! Everything is compared with both of ours, in the same rounds: ours, a rival, ours, the next one.
//! Ratios are taken between neighbours, and their median is told, which a disturbed round does not
//! move.

use std::time::{Duration, Instant};

use fipa_benches::table::Times;

use crate::middle::Ran;
use crate::peers::{Peer, Work};

const ROUNDS: usize = 5;

/// How long one of them sends in a round, roughly.
const SPAN: Duration = Duration::from_millis(400);

/// Letters that are sent to find out how many fill that time.
const TRIAL: usize = 5_000;

/// Octets that may be under way where a peer has no bound of its own, and letters at most.
const WINDOW_OCTETS: usize = 8 << 20;
const WINDOW: usize = 4096;

/// Letters that go there and back in a round.
const TRIPS: usize = 1_000;

/// Those that are compared: ours, by what is at their ends, and the others.
pub(crate) struct Field {
    pub(crate) agents: Box<dyn Peer>,
    pub(crate) bare: Box<dyn Peer>,
    pub(crate) rivals: Vec<Box<dyn Peer>>,
}

/// What was measured of a rival and of ours right before and after it.
struct Step<T> {
    agents: T,
    rival: T,
    bare: T,
}

/// What one of them did in a round.
struct Passed {
    letters_a_second: f64,
    /// Nanoseconds that the middle ran for each letter, on all its threads.
    work: f64,
}

impl Field {
    /// Measures letters with so many octets of content, one way, and prints a table.
    pub(crate) fn one_way(&mut self, octets: usize) {
        let work = |letters| Work {
            octets,
            letters,
            window: (WINDOW_OCTETS / octets).min(WINDOW),
        };
        let mut all = vec![&mut self.agents, &mut self.bare];
        all.extend(&mut self.rivals);
        let enough: Vec<usize> = all
            .into_iter()
            .map(|one| {
                // The first ones make buffers.
                let first = pass(&mut **one, work(TRIAL.min(TRIAL * 1024 / octets)));
                let second = pass(&mut **one, work(filling(&first)));
                filling(&second)
            })
            .collect();
        let steps = self.rounds(|one, at| pass(one, work(enough[at])));

        println!("\n{octets} octets of content, one way");
        println!(
            "{:28} {:>9} {:>8} {:>16} {:>9} {:>9}",
            "", "letters/s", "MB/s", "ns in the middle", "agents/it", "bare/it"
        );
        let rate = |passed: &Passed| passed.letters_a_second;
        let row = |name: &str, passed: &[&Passed], ratios: &str| {
            let letters = median(passed.iter().map(|p| rate(p)));
            let (mega, work) = (
                letters * octets as f64 / 1e6,
                median(passed.iter().map(|p| p.work)),
            );
            println!("{name:28} {letters:9.0} {mega:8.1} {work:16.0} {ratios}");
        };
        self.rows(&steps, row, |ours, rival| rate(ours) / rate(rival));
    }

    /// Times letters with so many octets of content that come back, and prints a table.
    pub(crate) fn round_trips(&mut self, octets: usize) {
        let trips = |one: &mut dyn Peer, _| {
            one.prepare();
            Times::new(one.round_trips(octets, TRIPS))
        };
        // The first ones make buffers.
        self.rounds_of(1, trips);
        let steps = self.rounds(trips);

        println!("\n{octets} octets of content, there and back, one after the other");
        println!(
            "{:28} {:>9} {:>8} {:>16} {:>9} {:>9}",
            "", "p50 us", "p99 us", "", "it/agents", "it/bare"
        );
        let half = |times: &Times| times.percentile(0.5);
        let row = |name: &str, times: &[&Times], ratios: &str| {
            let (p50, p99) = (
                median(times.iter().map(|t| half(t))),
                median(times.iter().map(|t| t.percentile(0.99))),
            );
            println!("{name:28} {p50:9.1} {p99:8.1} {:16} {ratios}", "");
        };
        self.rows(&steps, row, |ours, rival| half(rival) / half(ours));
    }

    fn rounds<T>(&mut self, measure: impl Fn(&mut dyn Peer, usize) -> T) -> Vec<Vec<Step<T>>> {
        self.rounds_of(ROUNDS, measure)
    }

    /// The steps of each rival. What is measured is told with its place: agents, bare, and the
    /// rivals in their order.
    fn rounds_of<T>(
        &mut self,
        rounds: usize,
        measure: impl Fn(&mut dyn Peer, usize) -> T,
    ) -> Vec<Vec<Step<T>>> {
        let mut steps: Vec<Vec<Step<T>>> = self.rivals.iter().map(|_| Vec::new()).collect();
        for _ in 0..rounds {
            for (at, (rival, steps)) in self.rivals.iter_mut().zip(&mut steps).enumerate() {
                steps.push(Step {
                    agents: measure(&mut *self.agents, 0),
                    rival: measure(&mut **rival, at + 2),
                    bare: measure(&mut *self.bare, 1),
                });
            }
        }
        steps
    }

    fn rows<T>(
        &self,
        steps: &[Vec<Step<T>>],
        row: impl Fn(&str, &[&T], &str),
        ratio: impl Fn(&T, &T) -> f64,
    ) {
        let ours = |of: fn(&Step<T>) -> &T| -> Vec<&T> { steps.iter().flatten().map(of).collect() };
        row(&self.agents.name(), &ours(|step| &step.agents), "");
        row(&self.bare.name(), &ours(|step| &step.bare), "");
        for (rival, steps) in self.rivals.iter().zip(steps) {
            let agents = median(steps.iter().map(|s| ratio(&s.agents, &s.rival)));
            let bare = median(steps.iter().map(|s| ratio(&s.bare, &s.rival)));
            let its: Vec<&T> = steps.iter().map(|step| &step.rival).collect();
            row(&rival.name(), &its, &format!("{agents:9.2} {bare:9.2}"));
        }
    }
}

fn pass(peer: &mut dyn Peer, work: Work) -> Passed {
    peer.prepare();
    let process = peer.middle();
    let (start, before) = (Instant::now(), Ran::of(process));
    peer.one_way(work);
    let took = start.elapsed();
    Passed {
        letters_a_second: work.letters as f64 / took.as_secs_f64(),
        work: Ran::of(process).since(&before) / work.letters as f64,
    }
}

/// How many letters fill the span of a round.
fn filling(passed: &Passed) -> usize {
    (passed.letters_a_second * SPAN.as_secs_f64()) as usize + 1
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
