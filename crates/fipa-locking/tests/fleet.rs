//! Fifty agents on a bad network, over many runs that chance decides: delays, partitions, agents
//! that die and come back. The same seed gives the same run.

mod fleet_world;

use std::time::Duration;

use fipa_locking::Algorithm;

use fleet_world::{Fleet, Told};

const BOTH: [Algorithm; 2] = [
    Algorithm::RicartAgrawalaExtended,
    Algorithm::SuzukiKasamiExtended,
];

fn runs(agents: usize, seeds: std::ops::Range<u64>) {
    for algorithm in BOTH {
        let mut told = Told::default();
        let runs = seeds.end - seeds.start;
        for seed in seeds.clone() {
            let mut fleet = Fleet::new(seed, agents, algorithm);
            fleet.run();
            told.add(fleet.told());
        }
        println!("{algorithm}: {runs} runs of {agents} agents: {told}");
        assert!(told.grants > runs && told.recoveries() > 0);
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

#[test]
#[ignore = "takes long: run it in a release build"]
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
