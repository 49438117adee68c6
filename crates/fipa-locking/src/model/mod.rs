//! Every order of events of three agents, searched through: who may hold, with which number, and
//! whether everyone is told in the end.
//!
//! A state is the three machines, the messages between them, what the owner keeps, and what may
//! still happen. From each state every event that can happen next is tried: a message arrives or is
//! lost, an agent asks, gives back or gives up, it dies or comes back, is told that another one
//! died, is cut off or is not any more, or a heartbeat passes. The machines are those of the crate, not a model of them.
//!
//! # What is shown
//!
//! * While leases are kept no two agents hold at a time, and numbers grow: looked at in each grant.
//! * Where clocks go as they like, and so leases are not kept, no number is granted twice.
//! * Every request is granted, or its agent is told why not: from every state in which nothing is
//!   under way, everyone is told, and the resource is free, once no more goes wrong, holders give
//!   back, and time passes. Between two such states there are finitely many events: nothing goes
//!   round unless time passes. So of the finitely many states there is none without a way to that
//!   end, and a run that for ever leaves out nothing that can happen for ever comes to it.
//!
//! # What is left out, and why that hides nothing
//!
//! * *Links keep order*: each pair's messages arrive in the order in which they were sent, or not
//!   at all. Messages that overtake others are left to the simulation of a fleet.
//! * *Probes take no time* unless a search says otherwise: who lives answers at once. So what
//!   depends on them changes in heartbeats only.
//! * *Heartbeats pass for all at once*, and the agents then do what is due in any order. They pass
//!   when nothing is under way: messages take less than one, or are lost. Where a search has
//!   messages late, they pass whenever they like. Where clocks go apart, they pass for one agent at
//!   any time, so often as the search allows.
//! * *What is said again after a while* may be said again in any heartbeat, by any of the agents:
//!   when it is due does not matter.
//! * *Clocks by rank*: Lamport's clocks count for nothing but the order of the requests that are
//!   under way. A request therefore takes each place in that order that is behind all that its agent
//!   has heard of, as if its clock had leapt, which it may do at any time because other resources
//!   move it too. After each event clocks are put back to the last of those requests that they are
//!   not before: whoever has heard less can do all that whoever has heard more can.
//! * *Time by distance*: what machines remember ages while it always is now, and all that is older
//!   than anything waits is the same.
//! * *Names of conversations* are counted anew for each request. They are compared, never ordered.
//! * *What decides nothing any more is forgotten*: see `LockAgent::forget`.
//! * A query for the owner, and a request for a token, do nothing at an agent that owns nothing:
//!   they are not delivered there.
//! * States are told apart by 64 bits of a hash, as other checkers do. That two of *n* states are
//!   taken for one has the odds n²/2^65: one in ten thousand for sixty million.
//!
//! Each machine is kept once, and what it does at an input is worked out once.

mod store;
mod world;

use std::collections::hash_map::{DefaultHasher, Entry};
use std::collections::{HashMap, HashSet};
use std::hash::{BuildHasherDefault, Hash, Hasher};

use self::store::Store;
use self::world::{Budget, Event, Setting, World};
use crate::Algorithm;

const BOTH: [Algorithm; 2] = [
    Algorithm::RicartAgrawalaExtended,
    Algorithm::SuzukiKasamiExtended,
];

/// What a search found, beside the states.
#[derive(Debug, Default)]
struct Found {
    transitions: usize,
    /// States in which nothing was under way, from which everyone was told.
    ends: usize,
    deepest: usize,
}

/// A hash that is one already.
#[derive(Default)]
struct Itself(u64);

impl Hasher for Itself {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, _: &[u8]) {
        unreachable!("only whole fingerprints are hashed");
    }

    fn write_u64(&mut self, number: u64) {
        self.0 = number;
    }
}

type ByItself = BuildHasherDefault<Itself>;

fn fingerprint(world: &World) -> u64 {
    let mut hasher = DefaultHasher::new();
    world.hash(&mut hasher);
    hasher.finish()
}

struct Search {
    store: Store,
    /// Events that are followed one after the other, at most.
    deep: usize,
    /// The states, and after how few events.
    seen: HashMap<u64, u32, ByItself>,
    /// States from which everyone was told.
    ended: HashSet<u64, ByItself>,
    path: Vec<Step>,
    /// Where the states of the path stand in it.
    places: HashMap<u64, usize, ByItself>,
    found: Found,
}

/// A state on the path that is being followed.
struct Step {
    event: Option<Event>,
    fingerprint: u64,
    next: Vec<Event>,
    world: World,
}

impl Search {
    /// Follows every event of every state.
    fn run(&mut self, start: World) {
        self.enter(start, None);
        while let Some(step) = self.path.last_mut() {
            let Some(event) = step.next.pop() else {
                let left = self.path.pop();
                left.map(|step| self.places.remove(&step.fingerprint));
                continue;
            };
            let mut world = step.world.clone();
            if let Err(complaint) = world.happens(&mut self.store, &event) {
                self.fail(&complaint, Some(event));
            }
            self.found.transitions += 1;
            if self.path.len() <= self.deep {
                self.enter(world, Some(event));
            }
        }
    }

    fn enter(&mut self, world: World, event: Option<Event>) {
        let fingerprint = fingerprint(&world);
        let events = self.path.len() as u32;
        match self.seen.entry(fingerprint) {
            Entry::Vacant(place) => drop(place.insert(events)),
            // More of what follows is within reach.
            Entry::Occupied(mut place) if self.deep < usize::MAX && *place.get() > events => {
                place.insert(events);
            }
            Entry::Occupied(_) => {
                if let Some(at) = self.places.get(&fingerprint) {
                    self.check_that_time_passes(*at, event);
                }
                return;
            }
        }
        let quiet = world.is_quiet();
        let step = Step {
            next: world.events(&self.store),
            event,
            fingerprint,
            world,
        };
        self.places.insert(fingerprint, self.path.len());
        self.path.push(step);
        self.found.deepest = self.found.deepest.max(self.path.len());
        if quiet {
            self.check_the_end();
        }
    }

    /// Where nothing is under way, everyone is told if nothing more happens.
    fn check_the_end(&mut self) {
        self.found.ends += 1;
        let world = &self.path[self.path.len() - 1].world;
        let (store, ended) = (&mut self.store, &mut self.ended);
        let mut passed = Vec::new();
        let ending = world.clone().run_to_the_end(store, |world| {
            let at = fingerprint(world);
            passed.push(at);
            ended.contains(&at)
        });
        ended.extend(passed);
        if let Err(complaint) = ending {
            self.fail(&complaint, None);
        }
    }

    /// Only with time does anything come again.
    fn check_that_time_passes(&self, at: usize, last: Option<Event>) {
        let since = self.path[at + 1..].iter();
        let mut events = since.filter_map(|step| step.event.as_ref()).chain(&last);
        let passes = |event: &Event| matches!(event, Event::Heartbeat { .. });
        if !events.any(passes) {
            self.fail("it goes round, and no time passes", last);
        }
    }

    fn fail(&self, complaint: &str, last: Option<Event>) -> ! {
        let path = self.path.iter();
        let events = path.filter_map(|step| step.event.clone()).chain(last);
        panic!("{complaint}\n{:#?}", events.collect::<Vec<_>>());
    }
}

fn search(algorithm: Algorithm, setting: Setting, deep: usize) {
    let mut store = Store::new(algorithm, setting.slow_probes);
    let start = World::new(&mut store, &setting);
    let mut search = Search {
        store,
        deep,
        seen: HashMap::default(),
        ended: HashSet::default(),
        path: Vec::new(),
        places: HashMap::default(),
        found: Found::default(),
    };
    search.run(start);
    let (states, found) = (search.seen.len(), search.found);
    println!("{algorithm}, {setting:?}: {states} states, {found:?}");
    assert!(found.ends > 0);
}

/// Searches with both algorithms.
fn both(setting: Setting) {
    for algorithm in BOTH {
        search(algorithm, setting, usize::MAX);
    }
}

/// Two requests of each agent, one of which dies and comes back.
const FULL: Budget = Budget {
    requests: [2, 2, 2],
    crashes: 1,
    rejoins: 1,
    losses: 0,
    cuts: 0,
    pauses: 0,
    withdrawals: 0,
};

#[test]
fn two_requests_of_each_of_three_agents_in_every_order() {
    both(Setting::of(Budget {
        crashes: 0,
        rejoins: 0,
        ..FULL
    }));
}

#[test]
fn two_agents_that_ask_while_any_of_three_dies_and_comes_back() {
    both(Setting::of(Budget {
        requests: [0, 1, 1],
        ..FULL
    }));
}

#[test]
fn two_agents_that_ask_when_a_message_is_lost_and_others_are_late() {
    both(Setting {
        late: true,
        ..Setting::of(Budget {
            requests: [0, 1, 1],
            losses: 1,
            ..Budget::default()
        })
    });
}

#[test]
fn two_agents_that_ask_while_any_of_three_is_cut_off_for_a_while() {
    both(Setting::of(Budget {
        requests: [0, 1, 1],
        cuts: 1,
        ..Budget::default()
    }));
}

#[test]
fn a_request_that_is_given_up_and_made_again_beside_another_one() {
    both(Setting::of(Budget {
        requests: [0, 2, 1],
        withdrawals: 1,
        ..Budget::default()
    }));
}

#[test]
fn an_agent_that_asks_while_any_dies_and_comes_back_and_probes_take_time() {
    both(Setting {
        slow_probes: true,
        ..Setting::of(Budget {
            requests: [0, 1, 0],
            ..FULL
        })
    });
}

#[test]
fn no_number_is_granted_twice_when_clocks_go_as_they_like() {
    let pauses = |requests, pauses| Budget {
        requests,
        pauses,
        ..Budget::default()
    };
    both(Setting::of(pauses([0, 1, 1], 1)));
    both(Setting {
        slow_probes: true,
        ..Setting::of(pauses([0, 1, 0], 2))
    });
}

/// `cargo test --release -p fipa-locking --lib -- --ignored --nocapture --test-threads 1`
#[test]
#[ignore = "takes half a minute"]
fn a_request_of_each_of_three_agents_while_any_dies_and_comes_back() {
    both(Setting::of(Budget {
        requests: [1, 1, 1],
        ..FULL
    }));
}

#[test]
#[ignore = "takes a minute"]
fn two_requests_of_each_of_three_agents_for_a_token_while_any_dies_and_comes_back() {
    search(
        Algorithm::SuzukiKasamiExtended,
        Setting::of(FULL),
        usize::MAX,
    );
}

/// The others know the owner from before, and ask for it only when they or it come back.
#[test]
#[ignore = "takes many minutes, and some gigabytes"]
fn two_requests_of_each_of_three_agents_for_grants_while_any_dies_and_comes_back() {
    let known = Setting {
        known: true,
        ..Setting::of(FULL)
    };
    search(Algorithm::RicartAgrawalaExtended, known, usize::MAX);
}

#[test]
#[ignore = "takes minutes"]
fn two_agents_that_ask_while_any_of_three_dies_and_comes_back_and_messages_are_late() {
    both(Setting {
        late: true,
        ..Setting::of(Budget {
            requests: [0, 1, 1],
            ..FULL
        })
    });
}

#[test]
#[ignore = "takes minutes"]
fn no_number_is_granted_twice_when_clocks_go_as_they_like_and_any_dies_and_comes_back() {
    both(Setting::of(Budget {
        requests: [0, 2, 1],
        pauses: 1,
        ..FULL
    }));
}

#[test]
#[ignore = "takes minutes"]
fn nothing_goes_wrong_within_nine_events_when_clocks_go_as_they_like_and_any_dies() {
    let setting = Setting::of(Budget { pauses: 2, ..FULL });
    for algorithm in BOTH {
        search(algorithm, setting, 9);
    }
}
