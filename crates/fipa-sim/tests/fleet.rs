//! Fleets as large as they get: everybody knows everybody's agents, and what is said of letters is
//! true, also while daemons crash and others are cut off.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use fipa_link::Outcome;
use fipa_sim::{NodeId, Sim};

/// Daemons in the usual run.
const DAEMONS: usize = 150;

fn secs(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

struct Fleet {
    sim: Sim,
    nodes: Vec<NodeId>,
    begun: Instant,
    letters: usize,
}

/// A letter on its way, and who has it afterwards.
struct Sent {
    from: usize,
    to: usize,
    ticket: u64,
    content: String,
}

impl Fleet {
    /// Daemons that mDNS does not reach: each is given the first one, whose gossip tells the rest.
    fn gossiping(daemons: usize) -> Fleet {
        let mut sim = Sim::new(1);
        let nodes = (0..daemons).map(|n| sim.daemon(&format!("d{n}")));
        let nodes: Vec<NodeId> = nodes.collect();
        let hub = sim.address(nodes[0]);
        for (n, node) in nodes.iter().enumerate() {
            sim.register(*node, &format!("agent{n}"));
            if n > 0 {
                sim.add_peer(*node, hub.clone());
            }
        }
        Fleet {
            sim,
            nodes,
            begun: Instant::now(),
            letters: 0,
        }
    }

    /// Runs until everybody knows all agents.
    fn meet(&mut self, what: &str) {
        let begun = self.sim.now().mono;
        let all = self.nodes.len();
        let knows_all = |fleet: &Fleet, node: &NodeId| fleet.sim.directory(*node).len() == all;
        while !self.nodes.iter().all(|node| knows_all(self, node)) {
            self.sim.run_for(Duration::from_millis(100));
            self.nodes.iter().for_each(|node| self.sim.forget(*node));
            let taken = self.sim.now().mono - begun;
            assert!(taken < secs(120), "not everybody is known after {taken:?}");
        }
        let taken = self.sim.now().mono - begun;
        self.report(&format!(
            "{what}: {all} daemons know all agents after {taken:?}"
        ));
    }

    /// Sends letters between agents drawn at random, of senders that are up.
    fn send(&mut self, count: usize) -> Vec<Sent> {
        let all = self.nodes.len();
        let mut sent = Vec::new();
        while sent.len() < count {
            let (from, to) = (
                self.sim.random().usize(..all),
                self.sim.random().usize(..all),
            );
            if from == to || !self.sim.is_up(self.nodes[from]) {
                continue;
            }
            self.letters += 1;
            let content = format!("letter {}", self.letters);
            let names = [format!("agent{from}"), format!("agent{to}")];
            let ticket = self
                .sim
                .send(self.nodes[from], &names[0], &[&names[1]], &content);
            sent.push(Sent {
                from,
                to,
                ticket,
                content,
            });
        }
        sent
    }

    /// Waits for all outcomes. Each letter came once or not at all, and that is what they say; how
    /// many came.
    fn settle(&mut self, sent: &[Sent]) -> usize {
        self.sim.run_for(secs(12));
        let mut came: HashMap<String, usize> = HashMap::new();
        for n in 0..self.nodes.len() {
            for content in self.sim.contents(self.nodes[n], &format!("agent{n}")) {
                *came.entry(content).or_default() += 1;
            }
        }
        let mut delivered = 0;
        for letter in sent {
            let told = &self.sim.outcomes(self.nodes[letter.from], letter.ticket)[0];
            let came = came.get(&letter.content).copied().unwrap_or_default();
            match told.outcome {
                Outcome::Delivered => assert_eq!(came, 1, "{told:?}"),
                // It was written to a link, and no receipt came back.
                Outcome::Timeout => assert!(came <= 1, "{told:?}"),
                Outcome::Unknown => assert_eq!(came, 0, "{told:?}"),
                _ => panic!("{} to {}: {told:?}", letter.from, letter.to),
            }
            delivered += usize::from(told.outcome == Outcome::Delivered);
        }
        self.report(&format!("{delivered} of {} letters delivered", sent.len()));
        delivered
    }

    /// One daemon in thirty crashes, as many are cut off; meanwhile letters are sent, and then all
    /// is mended.
    fn suffer(&mut self, letters: usize) {
        let crashed: Vec<NodeId> = self.nodes.iter().skip(1).step_by(30).copied().collect();
        let apart: Vec<NodeId> = self.nodes.iter().skip(2).step_by(30).copied().collect();
        crashed.iter().for_each(|node| self.sim.crash(*node));
        apart.iter().for_each(|node| self.sim.isolate(*node));
        let sent = self.send(letters);
        let delivered = self.settle(&sent);
        assert!(delivered < letters);
        let reached = |letter: &&Sent| {
            let is_well =
                |n: usize| !crashed.contains(&self.nodes[n]) && !apart.contains(&self.nodes[n]);
            is_well(letter.from) && is_well(letter.to)
        };
        assert!(delivered >= sent.iter().filter(reached).count());
        apart.iter().for_each(|node| self.sim.mend(*node));
        for (n, node) in self.nodes.clone().into_iter().enumerate() {
            if crashed.contains(&node) {
                self.sim.restart(node);
                self.sim.register(node, &format!("agent{n}"));
            }
        }
    }

    fn report(&self, what: &str) {
        let octets = self.nodes.iter().map(|n| self.sim.collected(*n).octets);
        println!(
            "{what}; so far {:?}, {} MiB of memory, {} MiB over the network",
            self.begun.elapsed(),
            memory() >> 10,
            octets.sum::<u64>() >> 20
        );
    }
}

/// The most memory that this process had, in KiB.
fn memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let number = line.and_then(|line| line.split_whitespace().nth(1));
    number
        .and_then(|number| number.parse().ok())
        .unwrap_or_default()
}

fn live(daemons: usize) {
    let mut fleet = Fleet::gossiping(daemons);
    fleet.meet("at first");
    let sent = fleet.send(daemons);
    assert_eq!(fleet.settle(&sent), daemons);
    fleet.suffer(daemons);
    fleet.meet("after crashes and cuts");
    let sent = fleet.send(daemons);
    assert_eq!(fleet.settle(&sent), daemons);
}

#[test]
fn a_fleet_that_is_given_one_address_knows_all_agents_and_tells_the_truth_of_letters() {
    live(DAEMONS);
}

/// `cargo test --release -p fipa-sim --test fleet -- --ignored --nocapture`
#[test]
#[ignore = "half a million links take minutes and six gigabytes"]
fn a_thousand_daemons_know_all_agents_and_tell_the_truth_of_letters() {
    live(1000);
}

#[test]
fn who_is_cut_off_until_it_is_forgotten_comes_back() {
    let mut fleet = Fleet::gossiping(50);
    fleet.meet("at first");
    let apart: Vec<NodeId> = fleet.nodes.iter().step_by(10).skip(1).copied().collect();
    apart.iter().for_each(|node| fleet.sim.isolate(*node));
    fleet.sim.run_for(secs(90));
    let left = fleet.nodes.len() - apart.len();
    assert_eq!(fleet.sim.directory(fleet.nodes[0]).len(), left);
    apart.iter().for_each(|node| fleet.sim.mend(*node));
    fleet.meet("after a cut");
    let sent = fleet.send(50);
    assert_eq!(fleet.settle(&sent), 50);
}
