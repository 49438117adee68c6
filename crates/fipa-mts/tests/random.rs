//! Fleets in which everything goes wrong, at random. Streams break, are changed on their way, cut
//! off and mended; letters are sent again over new ones, and overtake each other; mDNS packets are
//! lost, doubled and late; daemons freeze, crash, lose their power and end.
//!
//! A long run: `FIPA_SEEDS=10000 cargo test --release -p fipa-mts --test random`; one seed again:
//! `FIPA_FIRST_SEED=… FIPA_SEEDS=1`.
mod support;

use std::collections::{BTreeMap, BTreeSet};

use bytes::Bytes;
use fipa_acl::{
    AgentId, Envelope, FipaTime, Letter, Message, Performative, Representation, Slots, Text,
};
use fipa_codec::{
    Dialect, EnvelopeRepresentation, Limits, Output as Encoded, decode_letter, decode_payload,
    encode_letter_as, encode_message,
};
use fipa_directory::MESSAGE_TRANSPORT;
use fipa_link::Outcome;
use fipa_mts::{DeliveryFailure, Notice};
use fipa_sim::{Network, NodeId, Sim, Then};

use support::{entry, millis, secs, seeds};

const AGENTS: usize = 24;
const SEEDS: u64 = 40;

struct Fleet {
    sim: Sim,
    daemons: usize,
    /// A robot of another make, whose letters nobody gives a receipt for.
    robot: NodeId,
    /// What it wrote: the daemon, which run of it, and when.
    written: Vec<Written>,
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
    /// Whether its answer was wanted by some time.
    reply_by: bool,
}

/// A letter of the robot, to one agent.
struct Written {
    node: usize,
    run: u64,
    to: String,
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
        // Most fleets are small, so that many can be tried.
        let daemons = match seed % 8 {
            7 => sim.random().usize(9..=20),
            _ => sim.random().usize(5..9),
        };
        let mut nodes: Vec<NodeId> = (0..daemons).map(|n| sim.daemon(&format!("d{n}"))).collect();
        let discovery = !seed.is_multiple_of(3);
        if !discovery || seed.is_multiple_of(5) {
            // Everybody is given some of the others, so that each pair is given at least once.
            for one in 0..daemons {
                for two in (0..daemons).filter(|two| *two != one) {
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
        let robot = sim.robot("robot");
        let mut fleet = Fleet {
            sim,
            daemons,
            robot,
            written: Vec::new(),
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
        let place = [("tcp://robot:9999", MESSAGE_TRANSPORT)];
        self.sim.announce(self.robot, &entry("robot-x", &place));
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
        let payload = content.clone().into_bytes().into();
        let letter = self
            .sim
            .letter(&agent(from), vec![to.as_str().into()], payload);
        let reply_by = self.sim.random().u8(0..5) == 0;
        let until = millis(self.sim.random().u64(0..5000));
        let until = self.sim.now().plus(until).unix_millis;
        let ticket = self.sim.submit_with(at, letter, timeout, |submission| {
            submission.reply_by = reply_by.then_some(until);
        });
        let run = self.runs[node];
        self.sent.push(Sent {
            node,
            run,
            ticket,
            content,
            to_all,
            reply_by,
        });
    }

    /// Has the robot write a letter to some daemon.
    fn write(&mut self) {
        let node = self.sim.random().usize(0..self.daemons);
        // One in five is for an agent that does not exist.
        let to = agent(self.sim.random().usize(0..AGENTS + AGENTS / 4));
        if !self.sim.is_up(self.nodes[node]) {
            return;
        }
        let number = self.written.len();
        let octets = robot_letter(&to, &format!("robot letter {number};"));
        let address = self.sim.address(self.nodes[node]);
        self.sim
            .robot_writes(self.robot, address, octets, Then::Ends);
        let run = self.runs[node];
        self.written.push(Written { node, run, to });
    }

    /// What the robot was told: by content, why its letter failed.
    fn notices(&mut self) -> BTreeMap<String, String> {
        let mut told = BTreeMap::new();
        for octets in self.sim.robot_letters(self.robot) {
            let letter = decode_letter(&octets, &Limits::default()).unwrap();
            let limits = Limits::default();
            let message = decode_payload(&letter.envelope, &letter.payload, &limits).unwrap();
            let failure = DeliveryFailure::of(&message).unwrap();
            let about = message.conversation_id.unwrap().to_string();
            let about = about.trim_matches('"').to_owned();
            let before = told.insert(about, failure.reason.to_string());
            assert_eq!(before, None, "told twice");
        }
        told
    }

    fn fault(&mut self) {
        let one = self.sim.random().usize(0..self.nodes.len());
        let two = self.sim.random().usize(0..self.daemons);
        let (first, second) = (self.nodes[one], self.nodes[two]);
        match self.sim.random().u8(0..14) {
            0..3 => self.sim.reset(first, second),
            3 if one < self.daemons => self.sim.lose(first, second),
            4 => self.sim.crash(first),
            5 if one < self.daemons => self.sim.power_off(first),
            6 => self.sim.freeze(first),
            7 => self.sim.cut(first, second),
            12 | 13 => self.corrupt(first, second),
            8 => (0..self.nodes.len()).for_each(|node| self.sim.thaw(self.nodes[node])),
            9 => self.sim.mend(first),
            _ if !self.sim.is_up(first) => self.restart(one),
            10 => self.sim.shutdown(first),
            _ if self.discovery => self.sim.discover_badly(),
            _ => self.discover(),
        }
    }

    /// Letters of programs stay on their host, where nothing changes them.
    fn corrupt(&mut self, one: NodeId, two: NodeId) {
        if self.nodes[..self.daemons].contains(&one) {
            self.sim.corrupt(one, two);
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
            if !self.sim.is_up(self.nodes[node]) || node >= self.daemons {
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
                    let content = match content.find("robot letter") {
                        Some(at) => content[at..=at + content[at..].find(';').unwrap()].to_owned(),
                        None => content,
                    };
                    *received.entry((agent(n), content)).or_default() += 1;
                }
            }
        }
        received
    }

    /// Whether a daemon could not bring the robot a notice in time - it was frozen meanwhile - and
    /// says so.
    fn gave_up_telling(&self, node: usize) -> bool {
        let notices = &self.sim.collected(self.nodes[node]).notices;
        notices.iter().any(|(_, notice)| match notice {
            Notice::LinkFailed { with, reason } => {
                with == "robot-x" && reason.contains("could not be told")
            }
            _ => false,
        })
    }

    fn check_robot(&mut self, seed: u64, received: &BTreeMap<(String, String), usize>) {
        let notices = self.notices();
        for (number, written) in self.written.iter().enumerate() {
            let content = format!("robot letter {number};");
            let arrived = received.contains_key(&(written.to.clone(), content.clone()));
            let ended = self.runs[written.node] > written.run;
            match notices.get(&content) {
                None => assert!(
                    arrived || ended || self.gave_up_telling(written.node),
                    "seed {seed}: nobody told of {content} for {}",
                    written.to
                ),
                Some(reason) => assert!(
                    !arrived || reason.starts_with("timeout: "),
                    "seed {seed}: {content} has arrived: {reason}"
                ),
            }
        }
    }

    fn check(&mut self, seed: u64) {
        let received = self.received();
        self.check_robot(seed, &received);
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
                let nobody_has_it = matches!(
                    told.outcome,
                    Outcome::Unknown | Outcome::Refused | Outcome::Expired
                );
                assert!(
                    !arrived || !nobody_has_it,
                    "seed {seed}: {key:?} has arrived: {told:?}"
                );
                assert!(told.outcome != Outcome::Sent);
                assert!(sent.reply_by || told.outcome != Outcome::Expired);
            }
        }
        let names = (0..AGENTS).map(agent).chain(["robot-x".to_owned()]);
        let mut names: Vec<Text> = names.map(Text::from).collect();
        names.sort();
        for node in &self.nodes {
            assert_eq!(self.sim.names(*node), names, "seed {seed}: {node:?}");
        }
        for node in &self.nodes[..self.daemons] {
            assert_eq!(self.sim.mts(*node).letters_under_way(), 0, "seed {seed}");
            for other in self.nodes[..self.daemons]
                .iter()
                .filter(|other| *other != node)
            {
                assert_eq!(self.sim.streams(*node, *other), 1, "seed {seed}");
            }
        }
    }
}

/// A letter as fipa_services writes it; the content is its conversation, too.
fn robot_letter(to: &str, content: &str) -> Bytes {
    let message = Message::new(Performative::Inform)
        .from_agent("robot-x")
        .to(to)
        .conversation_id(content)
        .content(content.to_owned());
    let mut payload = Encoded::new();
    encode_message(&Representation::BitEfficient, &message, &mut payload).unwrap();
    let payload = payload.take_bytes();
    let envelope = Envelope::new(Slots {
        to: vec![AgentId::new(to)],
        from: Some(AgentId::new("robot-x")),
        acl_representation: Some(Representation::BitEfficient),
        payload_length: Some(payload.len() as u64),
        date: Some(FipaTime::from_unix_millis(0)),
        intended_receiver: vec![AgentId::new(to)],
        ..Slots::default()
    });
    let letter = Letter { envelope, payload };
    let mut octets = Encoded::new();
    let form = EnvelopeRepresentation::BitEfficient;
    encode_letter_as(Dialect::Cpp, form, &letter, &mut octets).unwrap();
    octets.take_bytes()
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
        if fleet.sim.random().u8(0..3) == 0 {
            fleet.write();
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
    let mut expired = 0;
    for seed in seeds(SEEDS) {
        let outcomes = run(seed);
        all += outcomes.len();
        delivered += outcomes.iter().filter(|o| o.is_success()).count();
        expired += outcomes.iter().filter(|o| **o == Outcome::Expired).count();
    }
    println!("{all} letters: {delivered} delivered, {expired} expired");
    // The faults are no excuse.
    assert!(delivered * 2 > all, "{delivered} of {all} were delivered");
    assert!(expired > 0 || all < 10_000);
}

#[test]
fn the_same_seed_gives_the_same_run() {
    for seed in 0..5 {
        assert_eq!(run(seed), run(seed));
    }
}
