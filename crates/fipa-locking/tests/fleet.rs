//! Fifty agents on a bad network, over many runs that chance decides: delays, partitions, agents
//! that die and come back. The same seed gives the same run.

mod fleet_world;

use std::ops::Range;
use std::sync::Mutex;
use std::thread;
use std::time::Duration;

use fipa_locking::Algorithm;

use fleet_world::{Fleet, Told};

const BOTH: [Algorithm; 2] = [
    Algorithm::RicartAgrawalaExtended,
    Algorithm::SuzukiKasamiExtended,
];

/// Says which run it was that failed.
struct Running(Algorithm, u64);

impl Drop for Running {
    fn drop(&mut self) {
        if thread::panicking() {
            eprintln!("{} with seed {} fails", self.0, self.1);
        }
    }
}

fn runs(agents: usize, seeds: Range<u64>) {
    for algorithm in BOTH {
        let (left, told) = (Mutex::new(seeds.clone()), Mutex::new(Told::default()));
        let next = || left.lock().unwrap().next();
        let runs = || {
            while let Some(seed) = next() {
                let running = Running(algorithm, seed);
                let mut fleet = Fleet::new(seed, agents, algorithm);
                fleet.run();
                told.lock().unwrap().add(fleet.told());
                drop(running);
            }
        };
        thread::scope(|scope| {
            for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
                scope.spawn(runs);
            }
        });
        let told = told.into_inner().unwrap();
        println!("{algorithm}: seeds {seeds:?}, {agents} agents: {told}");
        assert!(told.grants > seeds.end - seeds.start && told.recoveries() > 0);
    }
}

#[test]
fn fifty_agents_never_hold_together_and_all_are_told_whatever_the_network_does() {
    runs(50, 0..6);
}

#[test]
fn a_few_agents_never_hold_together_and_all_are_told_whatever_the_network_does() {
    runs(6, 0..300);
}

/// Some of them: `FIPA_FIRST_SEED=1000 FIPA_SEEDS=500`.
#[test]
#[ignore = "takes minutes: run it in a release build"]
fn fifty_agents_over_ten_thousand_seeds() {
    let read = |name: &str, usual: u64| {
        let value = std::env::var(name);
        value.map_or(usual, |value| value.parse().unwrap())
    };
    let first = read("FIPA_FIRST_SEED", 0);
    runs(50, first..first + read("FIPA_SEEDS", 10_000));
}

#[test]
fn a_silent_holder_is_recovered_from_within_seven_heartbeats() {
    for algorithm in BOTH {
        for seed in 0..50 {
            let mut fleet = Fleet::calm(seed, 5, algorithm);
            let waited = fleet.recovery_from_silence();
            assert!(
                waited <= Duration::from_secs(7 * 5),
                "{algorithm}, seed {seed}: {waited:?}"
            );
        }
    }
}
