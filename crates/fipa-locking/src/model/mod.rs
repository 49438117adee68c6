//! Every order of events of three agents, searched through: who may hold, with which number, and
//! whether everyone is told in the end.
//!
//! A state is the three machines, the messages between them (each pair's in their order), the
//! agents' clocks in heartbeats, and what may still go wrong. From each state every event that can
//! happen next is tried: a message arrives, an agent asks or gives back, an agent dies or comes
//! back, or heartbeats pass. Probes take no time unless a search says otherwise. States that were
//! seen before, but for what clocks and conversations are counted from, are not followed again.

mod world;

use std::collections::HashSet;

use self::world::{Budget, Clocks, Event, World};
use crate::Algorithm;

const BOTH: [Algorithm; 2] = [
    Algorithm::RicartAgrawalaExtended,
    Algorithm::SuzukiKasamiExtended,
];

/// What a search found.
struct Searched {
    states: usize,
    ends: usize,
    deepest: usize,
}

/// Follows every event of every state. States in which no message is under way, and those in
/// which nothing can happen any more, are also run to their end.
fn search(start: World, most: usize) -> Searched {
    let mut seen = HashSet::from([start.fingerprint()]);
    let mut path: Vec<Step> = Vec::new();
    let (mut ends, mut deepest) = (0, 0);
    path.push(Step::new(start, None));
    while let Some(step) = path.last_mut() {
        if !step.ended {
            step.ended = true;
            if step.world.is_quiet() || step.next.is_empty() {
                ends += 1;
                let ending = step.world.clone().run_to_the_end();
                ending.unwrap_or_else(|complaint| fail(&complaint, &path, None));
                continue;
            }
        }
        let Some(event) = step.next.pop() else {
            path.pop();
            continue;
        };
        let mut world = step.world.clone();
        if let Err(complaint) = world.happens(&event) {
            fail(&complaint, &path, Some(event));
        }
        if seen.insert(world.fingerprint()) {
            assert!(seen.len() <= most, "more than {most} states");
            path.push(Step::new(world, Some(event)));
            deepest = deepest.max(path.len());
        }
    }
    Searched {
        states: seen.len(),
        ends,
        deepest,
    }
}

/// A state on the path that is being followed.
struct Step {
    event: Option<Event>,
    next: Vec<Event>,
    world: World,
    ended: bool,
}

impl Step {
    fn new(world: World, event: Option<Event>) -> Step {
        Step {
            event,
            next: world.events(),
            world,
            ended: false,
        }
    }
}

fn fail(complaint: &str, path: &[Step], last: Option<Event>) -> ! {
    let events = path
        .iter()
        .filter_map(|step| step.event.clone())
        .chain(last);
    panic!("{complaint}\n{:#?}", events.collect::<Vec<_>>());
}

fn report(what: &str, start: World, most: usize) {
    let found = search(start, most);
    println!(
        "{what}: {} states, {} run to the end, {} events deep",
        found.states, found.ends, found.deepest
    );
    assert!(found.ends > 0);
}

/// Searches with both algorithms.
fn both(clocks: Clocks, budget: Budget, most: usize) {
    for algorithm in BOTH {
        let what = format!("{algorithm}, {clocks:?}, {budget:?}");
        report(&what, World::new(algorithm, clocks, budget), most);
    }
}

#[test]
fn never_two_holders_and_everyone_is_told_in_every_order() {
    let budget = Budget {
        requests: [0, 1, 1],
        ..Budget::default()
    };
    both(Clocks::Together, budget, 100_000);
}

#[test]
fn never_two_holders_and_everyone_is_told_when_one_dies_and_comes_back() {
    let budget = Budget {
        requests: [0, 1, 0],
        crashes: 1,
        rejoins: 1,
        losses: 1,
        ..Budget::default()
    };
    both(Clocks::Together, budget, 100_000);
}

#[test]
fn never_two_holders_and_everyone_is_told_when_a_request_is_given_up_and_made_again() {
    let budget = Budget {
        requests: [0, 2, 0],
        withdrawals: 1,
        ..Budget::default()
    };
    both(Clocks::Together, budget, 100_000);
}

#[test]
#[ignore = "takes minutes"]
fn two_agents_one_of_which_gives_up_and_asks_again_in_every_order() {
    let budget = Budget {
        requests: [0, 2, 1],
        withdrawals: 1,
        ..Budget::default()
    };
    both(Clocks::Together, budget, 20_000_000);
}

#[test]
fn no_number_is_granted_twice_when_clocks_go_as_they_like() {
    let budget = Budget {
        requests: [0, 1, 0],
        pauses: 2,
        slow_probes: true,
        ..Budget::default()
    };
    both(Clocks::Apart, budget, 100_000);
}

#[test]
#[ignore = "takes minutes"]
fn two_requests_of_each_of_three_agents_in_every_order() {
    let budget = Budget {
        requests: [2, 2, 2],
        ..Budget::default()
    };
    both(Clocks::Together, budget, 20_000_000);
}

#[test]
#[ignore = "takes hours"]
fn two_requests_of_each_of_three_agents_one_of_which_dies_and_comes_back_in_every_order() {
    let budget = Budget {
        requests: [2, 2, 2],
        crashes: 1,
        rejoins: 1,
        ..Budget::default()
    };
    both(Clocks::Together, budget, 500_000_000);
}

#[test]
#[ignore = "takes minutes"]
fn two_agents_one_of_which_dies_and_comes_back_while_clocks_go_as_they_like() {
    let budget = Budget {
        requests: [0, 1, 1],
        crashes: 1,
        rejoins: 1,
        pauses: 1,
        ..Budget::default()
    };
    both(Clocks::Apart, budget, 20_000_000);
}
