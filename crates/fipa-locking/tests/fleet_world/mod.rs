//! A fleet of agents, of which the first owns the resource, on a simulated network and clock.

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};
use std::fmt;
use std::rc::Rc;
use std::time::Duration;

use fastrand::Rng;
use fipa_acl::{Message, Text};
use fipa_locking::{Algorithm, Config, LockAgent, Output, Record};

const RESOURCE: &str = "gripper";
const HEARTBEAT: Duration = Duration::from_secs(5);
/// For how long things go wrong, and how long everybody has after that.
const TROUBLE: Duration = Duration::from_secs(120);
const CALM: Duration = Duration::from_secs(1200);

/// What became of the runs.
#[derive(Clone, Debug, Default)]
pub(crate) struct Told {
    pub(crate) grants: u64,
    pub(crate) failures: u64,
    pub(crate) losses: u64,
    pub(crate) messages: u64,
    /// From the silence of a holder, with others waiting, to the next grant.
    recovery: Vec<Duration>,
}

impl Told {
    pub(crate) fn add(&mut self, other: &Told) {
        self.grants += other.grants;
        self.failures += other.failures;
        self.losses += other.losses;
        self.messages += other.messages;
        self.recovery.extend(&other.recovery);
    }

    pub(crate) fn recoveries(&self) -> usize {
        self.recovery.len()
    }
}

impl fmt::Display for Told {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut sorted = self.recovery.clone();
        sorted.sort();
        let at = |part: usize| {
            let index = (sorted.len() * part / 100).min(sorted.len().saturating_sub(1));
            sorted.get(index).map_or(0.0, Duration::as_secs_f32)
        };
        write!(
            f,
            "{} grants, {} failures, {} losses, {} messages; {} recoveries, seconds: \
             p50 {:.1}, p90 {:.1}, p99 {:.1}, max {:.1}",
            self.grants,
            self.failures,
            self.losses,
            self.messages,
            sorted.len(),
            at(50),
            at(90),
            at(99),
            at(100)
        )
    }
}

#[derive(Clone, Debug)]
enum Event {
    Arrives {
        to: usize,
        life: u64,
        message: Rc<Message>,
    },
    Wakes {
        agent: usize,
        life: u64,
    },
    Asks(usize),
    GivesBack {
        agent: usize,
        number: u64,
    },
    Dies {
        agent: usize,
        told: bool,
    },
    HolderDies {
        told: bool,
    },
    ComesBack(usize),
    Parts(usize),
    Heals,
}

/// An event and when it happens; of those at the same time the first that was put.
struct Due {
    at: Duration,
    put: u64,
    event: Event,
}

impl Ord for Due {
    /// The earliest is the greatest, which a heap gives first.
    fn cmp(&self, other: &Due) -> Ordering {
        (other.at, other.put).cmp(&(self.at, self.put))
    }
}

impl PartialOrd for Due {
    fn partial_cmp(&self, other: &Due) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Due {
    fn eq(&self, other: &Due) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Due {}

struct Node {
    name: Text,
    machine: LockAgent,
    up: bool,
    life: u64,
    wakes: Option<Duration>,
    waits: bool,
    holds: Option<u64>,
}

pub(crate) struct Fleet {
    random: Rng,
    now: Duration,
    algorithm: Algorithm,
    nodes: Vec<Node>,
    events: BinaryHeap<Due>,
    put: u64,
    /// Which agents are on the other side of a partition.
    apart: BTreeSet<usize>,
    calm: bool,
    disk: Record,
    granted: BTreeSet<u64>,
    /// When the holder died while others waited.
    silent_since: Option<Duration>,
    told: Told,
}

impl Fleet {
    /// A fleet in which each agent asks some times, and much goes wrong.
    pub(crate) fn new(seed: u64, agents: usize, algorithm: Algorithm) -> Fleet {
        let mut fleet = Fleet::calm(seed, agents, algorithm);
        fleet.calm = false;
        for agent in 0..agents {
            for _ in 0..2 {
                fleet.sometime(Event::Asks(agent));
            }
        }
        for _ in 0..4 {
            let agent = fleet.random.usize(0..agents);
            let told = fleet.random.bool();
            fleet.sometime(Event::Dies { agent, told });
            fleet.sometime(Event::HolderDies { told: !told });
        }
        for _ in 0..3 {
            let size = fleet.random.usize(1..agents);
            fleet.sometime(Event::Parts(size));
        }
        fleet
    }

    /// A fleet in which nothing happens yet.
    pub(crate) fn calm(seed: u64, agents: usize, algorithm: Algorithm) -> Fleet {
        let nodes = (0..agents).map(|agent| Node {
            name: name(agent),
            machine: machine(agent, 0),
            up: true,
            life: 0,
            wakes: None,
            waits: false,
            holds: None,
        });
        let mut fleet = Fleet {
            random: Rng::with_seed(seed),
            now: Duration::from_secs(1000),
            algorithm,
            nodes: nodes.collect(),
            events: BinaryHeap::new(),
            put: 0,
            apart: BTreeSet::new(),
            calm: true,
            disk: Record::default(),
            granted: BTreeSet::new(),
            silent_since: None,
            told: Told::default(),
        };
        let now = fleet.now;
        let owned = fleet.nodes[0].machine.own(now, RESOURCE, Record::default());
        owned.unwrap();
        fleet
    }

    pub(crate) fn told(&self) -> &Told {
        &self.told
    }

    /// Runs through the trouble and on until everybody was told.
    pub(crate) fn run(&mut self) {
        let start = self.now;
        self.run_until(start + TROUBLE, |_| false);
        self.calm = true;
        self.apart.clear();
        for agent in 0..self.nodes.len() {
            if !self.nodes[agent].up {
                self.comes_back(agent);
            }
        }
        let done = |fleet: &Fleet| {
            let waits = fleet
                .nodes
                .iter()
                .any(|node| node.waits || node.holds.is_some());
            let held = fleet.nodes[0]
                .machine
                .owned()
                .any(|view| view.holder.is_some());
            !waits && !held
        };
        let end = self.run_until(start + TROUBLE + CALM, done);
        assert!(end, "somebody is never told");
    }

    /// The time from the silent death of a holder to the next grant.
    pub(crate) fn recovery_from_silence(&mut self) -> Duration {
        self.happens(Event::Asks(1));
        let later = self.now + Duration::from_secs(1);
        self.run_until(later, |fleet| fleet.nodes[1].holds.is_some());
        assert!(self.nodes[1].holds.is_some());
        self.happens(Event::Asks(2));
        let later = self.now + HEARTBEAT;
        self.run_until(later, |_| false);
        self.happens(Event::Dies {
            agent: 1,
            told: false,
        });
        let died = self.now;
        assert!(self.run_until(died + CALM, |fleet| !fleet.nodes[2].waits));
        self.now - died
    }

    fn run_until(&mut self, until: Duration, done: impl Fn(&Fleet) -> bool) -> bool {
        while !done(self) {
            match self.events.pop() {
                Some(due) if due.at <= until => {
                    self.now = due.at;
                    self.happens(due.event);
                }
                later => {
                    self.events.extend(later);
                    self.now = until;
                    return false;
                }
            }
        }
        true
    }

    fn put(&mut self, at: Duration, event: Event) {
        self.put += 1;
        let put = self.put;
        self.events.push(Due { at, put, event });
    }

    fn sometime(&mut self, event: Event) {
        let at = self.now + TROUBLE.mul_f32(self.random.f32());
        self.put(at, event);
    }

    fn names(&self) -> Vec<Text> {
        let up = self.nodes.iter().filter(|node| node.up);
        up.map(|node| node.name.clone()).collect()
    }

    fn happens(&mut self, event: Event) {
        let now = self.now;
        match event {
            Event::Arrives { to, life, message } => {
                let node = &mut self.nodes[to];
                if node.up && node.life == life {
                    node.machine.handle(now, &message);
                    self.settle(to);
                }
            }
            Event::Wakes { agent, life } => {
                let node = &mut self.nodes[agent];
                if node.up && node.life == life && node.wakes == Some(now) {
                    node.wakes = None;
                    node.machine.handle_timeout(now);
                    let again = node.machine.poll_timeout();
                    assert!(
                        again.is_none_or(|at| at > now),
                        "{agent} is woken again and again"
                    );
                    self.settle(agent);
                }
            }
            Event::Asks(agent) => {
                let names = self.names();
                let algorithm = self.algorithm;
                let node = &mut self.nodes[agent];
                if node.up && !node.waits && node.holds.is_none() {
                    node.waits = true;
                    let asked = node.machine.request(now, RESOURCE, algorithm, names);
                    asked.unwrap();
                    self.settle(agent);
                }
            }
            Event::GivesBack { agent, number } => {
                let node = &mut self.nodes[agent];
                if node.holds == Some(number) {
                    node.holds = None;
                    node.machine.release(now, RESOURCE);
                    self.settle(agent);
                }
            }
            Event::Dies { agent, told } => self.dies(agent, told),
            Event::HolderDies { told } => {
                let holder = self.nodes.iter().position(|node| node.holds.is_some());
                if let Some(agent) = holder {
                    self.dies(agent, told);
                }
            }
            Event::ComesBack(agent) => self.comes_back(agent),
            Event::Parts(size) => {
                let mut agents: Vec<usize> = (0..self.nodes.len()).collect();
                self.random.shuffle(&mut agents);
                self.apart = agents.into_iter().take(size).collect();
                let span = Duration::from_secs(40).mul_f32(self.random.f32());
                self.put(now + span, Event::Heals);
            }
            Event::Heals => self.apart.clear(),
        }
    }

    fn dies(&mut self, agent: usize, told: bool) {
        let now = self.now;
        let node = &mut self.nodes[agent];
        if !node.up {
            return;
        }
        let held = node.holds.is_some();
        (node.up, node.waits, node.holds) = (false, false, None);
        node.life += 1;
        if held && !told && agent != 0 && self.nodes.iter().any(|node| node.waits) {
            self.silent_since = Some(now);
        }
        if told {
            for other in 0..self.nodes.len() {
                if self.nodes[other].up {
                    self.nodes[other].machine.agent_gone(now, &name(agent));
                    self.settle(other);
                }
            }
        }
        let span = Duration::from_secs(40).mul_f32(self.random.f32());
        self.put(now + span, Event::ComesBack(agent));
    }

    fn comes_back(&mut self, agent: usize) {
        let now = self.now;
        let record = self.disk;
        let node = &mut self.nodes[agent];
        if node.up {
            return;
        }
        node.up = true;
        node.wakes = None;
        node.machine = machine(agent, node.life);
        if agent == 0 {
            node.machine.own(now, RESOURCE, record).unwrap();
        }
        let names = self.names();
        for other in 0..self.nodes.len() {
            if self.nodes[other].up {
                let names = names.iter().cloned();
                self.nodes[other]
                    .machine
                    .set_participants(now, RESOURCE, names);
                self.settle(other);
            }
        }
    }

    fn settle(&mut self, agent: usize) {
        let now = self.now;
        while let Some(output) = self.nodes[agent].machine.poll_output() {
            let node = &mut self.nodes[agent];
            match output {
                Output::Send(message) => self.send(agent, &Rc::new(message)),
                Output::Granted { fencing, .. } => self.granted(agent, fencing.unwrap()),
                Output::Lost { .. } => {
                    node.holds = None;
                    self.told.losses += 1;
                }
                Output::Failed { .. } => {
                    node.waits = false;
                    self.told.failures += 1;
                }
                Output::Persist { record, .. } => {
                    self.disk = record;
                    if record.held {
                        node.machine.persisted(now, RESOURCE, record.fencing);
                    }
                }
            }
        }
        let node = &mut self.nodes[agent];
        let next = node.machine.poll_timeout().map(|at| at.max(now));
        if let Some(at) = next.filter(|at| node.wakes.is_none_or(|wakes| *at < wakes)) {
            node.wakes = Some(at);
            let life = node.life;
            self.put(at, Event::Wakes { agent, life });
        }
    }

    fn granted(&mut self, agent: usize, number: u64) {
        let now = self.now;
        let holder = self.nodes.iter().position(|node| {
            let leased = node.machine.holds(now, RESOURCE);
            node.up && leased && node.holds.is_some()
        });
        assert_eq!(holder, None, "{agent} holds it as well");
        assert!(
            self.granted.insert(number),
            "the number {number} was granted twice"
        );
        assert_eq!(self.granted.last(), Some(&number), "a number does not grow");
        let node = &mut self.nodes[agent];
        node.waits = false;
        node.holds = Some(number);
        self.told.grants += 1;
        if let Some(since) = self.silent_since.take() {
            self.told.recovery.push(now - since);
        }
        let long = !self.calm && self.random.u32(0..10) == 0;
        let most = Duration::from_secs(if long { 40 } else { 2 });
        let span = most.mul_f32(self.random.f32());
        self.put(now + span, Event::GivesBack { agent, number });
    }

    fn send(&mut self, from: usize, message: &Rc<Message>) {
        for receiver in &message.receiver {
            let to = receiver.name.trim_start_matches("agent").parse::<usize>();
            let to = to.unwrap();
            self.told.messages += 1;
            let cut = self.apart.contains(&from) != self.apart.contains(&to);
            if !self.calm && (cut || self.random.u32(0..200) == 0) {
                continue;
            }
            // Usually some milliseconds, now and then many seconds: order is not kept.
            let slow = !self.calm && self.random.u32(0..100) == 0;
            let most = if slow { 25_000 } else { 20 };
            let delay = Duration::from_micros(self.random.u64(500..most * 1000));
            let life = self.nodes[to].life;
            let message = Rc::clone(message);
            self.put(self.now + delay, Event::Arrives { to, life, message });
        }
    }
}

fn name(agent: usize) -> Text {
    Text::from(format!("agent{agent}"))
}

fn machine(agent: usize, life: u64) -> LockAgent {
    LockAgent::new(Config {
        heartbeat: HEARTBEAT,
        ..Config::new(name(agent), life * 1_000_000)
    })
}
