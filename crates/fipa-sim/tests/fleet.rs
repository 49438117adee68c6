//! Fleets as large as they get: everybody knows everybody's agents, also after a cut has healed.

use std::time::Duration;

use fipa_link::Outcome;
use fipa_sim::{NodeId, Sim};

/// Daemons of whose agents it is looked after that everybody knows them all.
const LOOKED_AT: usize = 20;

fn secs(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

struct Fleet {
    sim: Sim,
    nodes: Vec<NodeId>,
}

impl Fleet {
    /// Daemons that mDNS does not reach: each is given the first one, whose gossip tells the rest.
    fn gossiping(daemons: usize) -> Fleet {
        let mut sim = Sim::new(1);
        let set = |config: &mut fipa_mts::Config| {
            config.max_connections = 10_000;
            config.max_connections_an_address = 10_000;
        };
        let nodes = (0..daemons).map(|n| sim.daemon_with(&format!("d{n}"), set));
        let nodes: Vec<NodeId> = nodes.collect();
        for (n, node) in nodes.iter().enumerate() {
            sim.register(*node, &format!("agent{n}"));
        }
        let hub = sim.address(nodes[0]);
        for node in &nodes[1..] {
            sim.add_peer(*node, hub.clone());
        }
        Fleet { sim, nodes }
    }

    /// Runs until everybody knows so many agents.
    fn run_until_known(&mut self, agents: usize) -> Duration {
        let begun = self.sim.now().mono;
        while self
            .nodes
            .iter()
            .any(|n| self.sim.directory(*n).iter().count() != agents)
        {
            self.sim.run_for(secs(1));
            let taken = self.sim.now().mono - begun;
            assert!(taken < secs(120), "not everybody is known after {taken:?}");
        }
        self.sim.now().mono - begun
    }

    /// Letters from some to some others, which all arrive.
    fn write_around(&mut self, what: &str) {
        let count = self.nodes.len();
        let step = count / LOOKED_AT;
        let sent: Vec<_> = (0..LOOKED_AT)
            .map(|n| {
                let (from, to) = (n * step, (n * step + count / 2 + n) % count);
                let names = [format!("agent{from}"), format!("agent{to}")];
                let what = format!("{what} from {from}");
                let ticket = self
                    .sim
                    .send(self.nodes[from], &names[0], &[&names[1]], &what);
                (from, to, ticket)
            })
            .collect();
        self.sim.run_for(secs(12));
        for (from, to, ticket) in sent {
            let told = &self.sim.outcomes(self.nodes[from], ticket)[0];
            assert_eq!(told.outcome, Outcome::Delivered, "{told:?}");
            let got = self.sim.contents(self.nodes[to], &format!("agent{to}"));
            let what = format!("{what} from {from}");
            assert_eq!(got.iter().filter(|got| **got == what).count(), 1);
        }
    }

    /// Cuts one in ten off from all others until these have forgotten them, and mends that.
    fn cut_and_mend(&mut self) {
        let apart: Vec<NodeId> = self.nodes.iter().step_by(10).skip(1).copied().collect();
        apart.iter().for_each(|node| self.sim.isolate(*node));
        self.sim.run_for(secs(90));
        let left = self.nodes.len() - apart.len();
        assert_eq!(self.sim.directory(self.nodes[0]).iter().count(), left);
        apart.iter().for_each(|node| self.sim.mend(*node));
    }
}

fn meet(daemons: usize) {
    let begun = std::time::Instant::now();
    let mut fleet = Fleet::gossiping(daemons);
    let met = fleet.run_until_known(daemons);
    println!(
        "{daemons} daemons know each other after {met:?}: {:?}",
        begun.elapsed()
    );
    fleet.write_around("before");
    fleet.cut_and_mend();
    let met = fleet.run_until_known(daemons);
    println!("again {met:?} after a cut: {:?}", begun.elapsed());
    fleet.write_around("after");
    println!("all in {:?}, {} KiB", begun.elapsed(), memory());
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

#[test]
fn fifty_daemons_that_are_given_one_of_them_know_all_agents_also_after_a_cut() {
    meet(50);
}

/// `cargo test --release -p fipa-sim --test fleet -- --ignored --nocapture`
#[test]
#[ignore = "45,000 links take a minute and three gigabytes"]
fn three_hundred_daemons_that_are_given_one_of_them_know_all_agents_also_after_a_cut() {
    meet(300);
}
