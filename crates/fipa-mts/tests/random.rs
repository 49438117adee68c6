//! Fleets in which everything goes wrong, at random.
mod support;

use std::collections::{BTreeMap, BTreeSet};

use fipa_acl::Text;
use fipa_link::Outcome;
use fipa_sim::{Network, NodeId, Sim};

use support::{millis, secs};

const DAEMONS: usize = 5;
const AGENTS: usize = 20;
const SEEDS: u64 = 50;

struct Fleet {
    sim: Sim,
    /// Daemons, then programs: one at each of the first two daemons.
    nodes: Vec<NodeId>,
    /// What was sent: the node, its ticket, the content, whether the node has crashed since.
    sent: Vec<Sent>,
    /// Per node, how often it was started.
    runs: Vec<u64>,
    discovery: bool,
}

struct Sent {
    node: usize,
    run: u64,
    ticket: u64,
    content: String,
    /// Whether it went to all agents at once.
    to_all: bool,
}

fn agent(n: usize) -> String {
    format!("agent{n}")
}

impl Fleet {
    fn new(seed: u64) -> Fleet {
        let mut sim = Sim::new(seed);
        let latency = millis(sim.random().u64(1..15));
        let jitter = millis(sim.random().u64(0..30));
        sim.set_network(Network {
            latency,
            jitter,
            split: seed.is_multiple_of(2),
            octets_per_second: None,
        });
        let mut nodes: Vec<NodeId> = (0..DAEMONS).map(|n| sim.daemon(&format!("d{n}"))).collect();
        let discovery = !seed.is_multiple_of(3);
        if !discovery || seed.is_multiple_of(5) {
            // Everybody is given some of the others, so that each pair is given at least once.
            for one in 0..DAEMONS {
                for two in (0..DAEMONS).filter(|two| *two != one) {
                    if one < two || sim.random().bool() {
                        let address = sim.address(nodes[two]);
                        sim.add_peer(nodes[one], address);
                    }
                }
            }
        }
        sim.run_for(millis(10));
        nodes.push(sim.program("p0", nodes[0]));
        nodes.push(sim.program("p1", nodes[1]));
        let runs = vec![0; nodes.len()];
        let mut fleet = Fleet {
            sim,
            nodes,
            sent: Vec::new(),
            runs,
            discovery,
        };
        (0..fleet.nodes.len()).for_each(|node| fleet.register(node));
        fleet.discover();
        fleet.sim.run_for(secs(1));
        fleet
    }

    fn discover(&mut self) {
        if self.discovery {
            self.sim.discover_all();
        }
    }

    fn agents_of(&self, node: usize) -> impl Iterator<Item = usize> + use<> {
        (node..AGENTS).step_by(self.nodes.len())
    }

    fn register(&mut self, node: usize) {
        for n in self.agents_of(node) {
            self.sim.register(self.nodes[node], &agent(n));
        }
    }

    fn restart(&mut self, node: usize) {
        self.sim.restart(self.nodes[node]);
        self.runs[node] += 1;
        self.register(node);
        self.discover();
    }

    fn send(&mut self) {
        let node = self.sim.random().usize(0..self.nodes.len());
        let from = self.agents_of(node).next().unwrap();
        let to_all = self.sim.random().u8(0..10) == 0;
        let to = match to_all {
            true => "agent.*".to_owned(),
            false => agent(self.sim.random().usize(0..AGENTS)),
        };
        if !self.sim.is_up(self.nodes[node]) {
            return;
        }
        let content = format!("letter {}", self.sent.len());
        let timeout = millis(self.sim.random().u64(200..20_000));
        let at = self.nodes[node];
        let ticket = self
            .sim
            .send_within(at, &agent(from), &[&to], &content, timeout);
        let run = self.runs[node];
        self.sent.push(Sent {
            node,
            run,
            ticket,
            content,
            to_all,
        });
    }

    fn fault(&mut self) {
        let one = self.sim.random().usize(0..self.nodes.len());
        let two = self.sim.random().usize(0..DAEMONS);
        let (first, second) = (self.nodes[one], self.nodes[two]);
        match self.sim.random().u8(0..12) {
            0..3 => self.sim.reset(first, second),
            3 if one < DAEMONS => self.sim.lose(first, second),
            4 => self.sim.crash(first),
            5 if one < DAEMONS => self.sim.power_off(first),
            6 => self.sim.freeze(first),
            7 => self.sim.cut(first, second),
            8 => (0..self.nodes.len()).for_each(|node| self.sim.thaw(self.nodes[node])),
            9 => self.sim.mend(first),
            _ if !self.sim.is_up(first) => self.restart(one),
            10 => self.sim.shutdown(first),
            _ => self.discover(),
        }
    }

    fn calm_down(&mut self) {
        for node in self.nodes.clone() {
            self.sim.mend(node);
            self.sim.thaw(node);
        }
        self.sim.run_for(secs(1));
        for node in 0..self.nodes.len() {
            // A program may have given up its daemon.
            if !self.sim.is_up(self.nodes[node]) || node >= DAEMONS {
                self.restart(node);
            }
        }
        for _ in 0..20 {
            self.discover();
            self.sim.run_for(secs(10));
        }
    }

    /// How often each agent has got each letter.
    fn received(&self) -> BTreeMap<(String, String), usize> {
        let mut received = BTreeMap::new();
        for (at, node) in self.nodes.iter().enumerate() {
            for n in self.agents_of(at) {
                for content in self.sim.contents(*node, &agent(n)) {
                    *received.entry((agent(n), content)).or_default() += 1;
                }
            }
        }
        received
    }

    fn check(&self, seed: u64) {
        let received = self.received();
        for (letter, times) in &received {
            assert_eq!(*times, 1, "seed {seed}: {letter:?} was delivered again");
        }
        for sent in &self.sent {
            let Some(outcomes) = self.sim.told(self.nodes[sent.node], sent.ticket) else {
                let ended = self.runs[sent.node] > sent.run;
                assert!(ended, "seed {seed}: {} was never told of", sent.content);
                continue;
            };
            assert!(!outcomes.is_empty());
            let names: BTreeSet<_> = outcomes.iter().map(|o| &o.to).collect();
            assert_eq!(names.len(), outcomes.len(), "seed {seed}: {outcomes:?}");
            assert!(sent.to_all || outcomes.len() == 1);
            for told in outcomes {
                let key = (told.to.to_string(), sent.content.clone());
                let arrived = received.contains_key(&key);
                assert!(
                    arrived || told.outcome != Outcome::Delivered,
                    "seed {seed}: {key:?} was not delivered"
                );
                assert!(told.outcome != Outcome::Sent && told.outcome != Outcome::Expired);
            }
        }
        let mut names: Vec<Text> = (0..AGENTS).map(|n| agent(n).into()).collect();
        names.sort();
        for node in &self.nodes {
            assert_eq!(self.sim.names(*node), names, "seed {seed}: {node:?}");
        }
        for node in &self.nodes[..DAEMONS] {
            assert_eq!(self.sim.mts(*node).letters_under_way(), 0, "seed {seed}");
            for other in self.nodes[..DAEMONS].iter().filter(|other| *other != node) {
                assert_eq!(self.sim.streams(*node, *other), 1, "seed {seed}");
            }
        }
    }
}

/// A run; what became of every letter.
fn run(seed: u64) -> Vec<Outcome> {
    let mut fleet = Fleet::new(seed);
    let steps = fleet.sim.random().usize(50..200);
    for _ in 0..steps {
        let pause = millis(fleet.sim.random().u64(0..300));
        fleet.sim.run_for(pause);
        for _ in 0..fleet.sim.random().u8(0..6) {
            fleet.send();
        }
        if fleet.sim.random().u8(0..4) == 0 {
            fleet.fault();
        }
    }
    fleet.calm_down();
    fleet.check(seed);
    let outcomes = fleet.sent.iter().flat_map(|sent| {
        let told = fleet.sim.told(fleet.nodes[sent.node], sent.ticket);
        told.unwrap_or_default().iter().map(|told| told.outcome)
    });
    outcomes.collect()
}

#[test]
fn whatever_goes_wrong_no_letter_is_delivered_twice_or_goes_untold() {
    let mut delivered = 0;
    let mut all = 0;
    for seed in 0..SEEDS {
        let outcomes = run(seed);
        all += outcomes.len();
        delivered += outcomes.iter().filter(|o| o.is_success()).count();
    }
    // The faults are no excuse.
    assert!(delivered * 2 > all, "{delivered} of {all} were delivered");
}

#[test]
fn the_same_seed_gives_the_same_run() {
    for seed in 0..5 {
        assert_eq!(run(seed), run(seed));
    }
}
