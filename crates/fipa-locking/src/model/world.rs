//! Three agents of which the first owns the resource, the messages between them, and their clocks.

use std::collections::hash_map::DefaultHasher;
use std::collections::{BTreeMap, VecDeque};
use std::hash::{Hash, Hasher};
use std::rc::Rc;
use std::time::Duration;

use crate::agent::canonical::Renaming;
use crate::{Algorithm, Config, LockAgent, Output, Record};
use fipa_acl::{Message, Text};

pub(crate) const RESOURCE: &str = "door";
pub(crate) const AGENTS: usize = 3;
const NAMES: [&str; AGENTS] = ["a", "b", "c"];
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Heartbeats in which a run comes to its end, whatever has happened.
const PATIENCE: usize = 60;

/// Heartbeats that may pass at once: one, and as many as make an agent silent.
const PAUSES: [u8; 2] = [1, 4];

/// More grants than any run needs.
const MOST_GRANTS: u64 = 30;

/// How the agents' clocks go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Clocks {
    /// At the same pace, so that leases are kept.
    Together,
    /// Each as it likes: an agent may stand still while the others take it for dead.
    Apart,
}

/// What may still happen, at most.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct Budget {
    pub(crate) requests: [u8; AGENTS],
    pub(crate) crashes: u8,
    pub(crate) rejoins: u8,
    pub(crate) losses: u8,
    pub(crate) pauses: u8,
    /// Requests that are given up before they are answered.
    pub(crate) withdrawals: u8,
    /// Whether probes take time like other messages; else an agent that lives answers at once.
    pub(crate) slow_probes: bool,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Event {
    Arrives {
        from: usize,
        to: usize,
    },
    Lost {
        from: usize,
        to: usize,
    },
    Asks(usize),
    GivesBack(usize),
    /// It does not want it any more, before it has it.
    GivesUp(usize),
    /// It dies; whether the others are told at once.
    Dies {
        agent: usize,
        told: bool,
    },
    ComesBack(usize),
    /// So many heartbeats pass in which nothing arrives, for one agent or for all.
    Pause(Option<usize>, u8),
}

#[derive(Clone, Debug)]
struct Node {
    machine: Rc<LockAgent>,
    up: bool,
    life: u64,
    clock: u32,
    /// Whether it waits for an answer to its request.
    waits: bool,
    /// The number with which it believes that it holds.
    holds: Option<u64>,
}

#[derive(Clone, Debug)]
pub(crate) struct World {
    algorithm: Algorithm,
    clocks: Clocks,
    budget: Budget,
    nodes: Vec<Node>,
    wires: BTreeMap<(usize, usize), VecDeque<Rc<Message>>>,
    /// Probes and their answers that arrive before anything else happens.
    probes: VecDeque<(usize, Message)>,
    /// What the owner keeps over a crash.
    disk: Record,
    /// The numbers that were granted, a bit each.
    granted: u64,
}

impl World {
    pub(crate) fn new(algorithm: Algorithm, clocks: Clocks, budget: Budget) -> World {
        let mut world = World {
            algorithm,
            clocks,
            budget,
            nodes: Vec::new(),
            wires: BTreeMap::new(),
            probes: VecDeque::new(),
            disk: Record::default(),
            granted: 0,
        };
        for agent in 0..AGENTS {
            world.nodes.push(Node {
                machine: Rc::new(machine(agent, 0)),
                up: true,
                life: 0,
                clock: 0,
                waits: false,
                holds: None,
            });
        }
        world.own().unwrap();
        for agent in 0..AGENTS {
            world.settle(agent).unwrap();
        }
        world
    }

    fn own(&mut self) -> Result<(), String> {
        let (record, now) = (self.disk, self.now(0));
        let owner = Rc::make_mut(&mut self.nodes[0].machine);
        owner
            .own(now, RESOURCE, record)
            .map_err(|error| error.to_string())
    }

    fn now(&self, agent: usize) -> Duration {
        // Not at zero, so that nothing is taken for never.
        HEARTBEAT * (100 + self.nodes[agent].clock)
    }

    pub(crate) fn is_quiet(&self) -> bool {
        self.wires.values().all(VecDeque::is_empty)
    }

    /// All that can happen next.
    pub(crate) fn events(&self) -> Vec<Event> {
        let mut events = Vec::new();
        for (&(from, to), wire) in &self.wires {
            if !wire.is_empty() {
                events.push(Event::Arrives { from, to });
                if self.budget.losses > 0 {
                    events.push(Event::Lost { from, to });
                }
            }
        }
        for (agent, node) in self.nodes.iter().enumerate() {
            let idle = node.up && !node.waits && node.holds.is_none();
            if idle && self.budget.requests[agent] > 0 {
                events.push(Event::Asks(agent));
            }
            if node.waits && self.budget.withdrawals > 0 {
                events.push(Event::GivesUp(agent));
            }
            if node.holds.is_some() {
                events.push(Event::GivesBack(agent));
            }
            if node.up && self.budget.crashes > 0 {
                events.extend([true, false].map(|told| Event::Dies { agent, told }));
            }
            if !node.up && self.budget.rejoins > 0 {
                events.push(Event::ComesBack(agent));
            }
            if self.budget.pauses > 0 && self.clocks == Clocks::Apart {
                events.extend(PAUSES.map(|span| Event::Pause(Some(agent), span)));
            }
        }
        if self.budget.pauses > 0 && self.clocks == Clocks::Together {
            events.extend(PAUSES.map(|span| Event::Pause(None, span)));
        }
        events
    }

    pub(crate) fn happens(&mut self, event: &Event) -> Result<(), String> {
        match *event {
            Event::Arrives { from, to } => self.arrives(from, to)?,
            Event::Lost { from, to } => {
                self.budget.losses -= 1;
                self.take(from, to);
            }
            Event::Asks(agent) => self.asks(agent)?,
            Event::GivesBack(agent) => self.gives_back(agent)?,
            Event::GivesUp(agent) => {
                self.budget.withdrawals -= 1;
                self.nodes[agent].waits = false;
                self.gives_back(agent)?;
            }
            Event::Dies { agent, told } => self.dies(agent, told)?,
            Event::ComesBack(agent) => self.comes_back(agent)?,
            Event::Pause(agent, span) => {
                self.budget.pauses -= 1;
                for _ in 0..span {
                    match agent {
                        Some(agent) => self.passes(agent)?,
                        None => self.all_pass()?,
                    }
                }
            }
        }
        Ok(())
    }

    fn take(&mut self, from: usize, to: usize) -> Option<Rc<Message>> {
        let wire = self.wires.get_mut(&(from, to))?;
        let message = wire.pop_front();
        if wire.is_empty() {
            self.wires.remove(&(from, to));
        }
        message
    }

    fn arrives(&mut self, from: usize, to: usize) -> Result<(), String> {
        let now = self.now(to);
        let message = self.take(from, to);
        if let Some(message) = message.filter(|_| self.nodes[to].up) {
            Rc::make_mut(&mut self.nodes[to].machine).handle(now, &message);
        }
        self.settle(to)
    }

    fn asks(&mut self, agent: usize) -> Result<(), String> {
        self.budget.requests[agent] -= 1;
        self.nodes[agent].waits = true;
        let (now, algorithm) = (self.now(agent), self.algorithm);
        let up = (0..AGENTS).filter(|other| self.nodes[*other].up);
        let names: Vec<Text> = up.map(|other| Text::from(NAMES[other])).collect();
        let machine = Rc::make_mut(&mut self.nodes[agent].machine);
        let asked = machine.request(now, RESOURCE, algorithm, names);
        asked.map_err(|error| error.to_string())?;
        self.settle(agent)
    }

    fn gives_back(&mut self, agent: usize) -> Result<(), String> {
        let now = self.now(agent);
        self.nodes[agent].holds = None;
        Rc::make_mut(&mut self.nodes[agent].machine).release(now, RESOURCE);
        self.settle(agent)
    }

    fn dies(&mut self, agent: usize, told: bool) -> Result<(), String> {
        self.budget.crashes -= 1;
        let node = &mut self.nodes[agent];
        (node.up, node.waits, node.holds) = (false, false, None);
        node.machine = Rc::new(machine(agent, node.life));
        for from in 0..AGENTS {
            self.wires.remove(&(from, agent));
        }
        self.settle(agent)?;
        for other in 0..AGENTS {
            if told && self.nodes[other].up {
                let now = self.now(other);
                Rc::make_mut(&mut self.nodes[other].machine).agent_gone(now, NAMES[agent]);
                self.settle(other)?;
            }
        }
        Ok(())
    }

    fn comes_back(&mut self, agent: usize) -> Result<(), String> {
        self.budget.rejoins -= 1;
        let node = &mut self.nodes[agent];
        node.up = true;
        node.life += 1;
        node.machine = Rc::new(machine(agent, node.life));
        if agent == 0 {
            self.own()?;
        }
        for other in 0..AGENTS {
            let now = self.now(other);
            if self.nodes[other].up {
                let up = (0..AGENTS).filter(|other| self.nodes[*other].up);
                let names: Vec<Text> = up.map(|other| Text::from(NAMES[other])).collect();
                let machine = Rc::make_mut(&mut self.nodes[other].machine);
                machine.set_participants(now, RESOURCE, names);
            }
            self.settle(other)?;
        }
        Ok(())
    }

    fn passes(&mut self, agent: usize) -> Result<(), String> {
        self.nodes[agent].clock += 1;
        let now = self.now(agent);
        let node = &mut self.nodes[agent];
        if node.up && node.machine.poll_timeout().is_some_and(|at| at <= now) {
            let machine = Rc::make_mut(&mut node.machine);
            machine.handle_timeout(now);
            let again = machine.poll_timeout();
            if again.is_some_and(|at| at <= now) {
                return Err(format!(
                    "{} wants to be woken again and again",
                    NAMES[agent]
                ));
            }
        }
        self.settle(agent)
    }

    /// In every order in which the agents can notice it, the outcome must be the same; the owner
    /// is the one whose lateness would hide a second holder, so it is first.
    fn all_pass(&mut self) -> Result<(), String> {
        (0..AGENTS).try_for_each(|agent| self.passes(agent))
    }

    /// Does what a machine wants done, and looks whether it may be so.
    fn settle(&mut self, agent: usize) -> Result<(), String> {
        let now = self.now(agent);
        while self.nodes[agent].up {
            let node = &mut self.nodes[agent];
            let machine = Rc::make_mut(&mut node.machine);
            let Some(output) = machine.poll_output() else {
                break;
            };
            match output {
                Output::Send(message) => self.send(agent, &message),
                Output::Granted { fencing, .. } => {
                    node.waits = false;
                    node.holds = Some(fencing.unwrap_or_default());
                    let number = fencing.ok_or("a grant without a number")?;
                    let bit = 1 << number;
                    if self.granted & bit != 0 {
                        return Err(format!("the number {number} was granted twice"));
                    }
                    self.granted |= bit;
                }
                Output::Lost { .. } => node.holds = None,
                Output::Failed { .. } => node.waits = false,
                Output::Persist { record, .. } => {
                    self.disk = record;
                    if record.fencing > MOST_GRANTS {
                        return Err("it is granted again and again".to_owned());
                    }
                    if record.held {
                        machine.persisted(now, RESOURCE, record.fencing);
                    }
                }
            }
        }
        self.check()?;
        while let Some((to, message)) = self.probes.pop_front() {
            let now = self.now(to);
            Rc::make_mut(&mut self.nodes[to].machine).handle(now, &message);
            self.settle(to)?;
        }
        Ok(())
    }

    fn send(&mut self, from: usize, message: &Message) {
        for receiver in &message.receiver {
            let to = NAMES.iter().position(|name| receiver.name == *name);
            let Some(to) = to.filter(|to| self.nodes[*to].up) else {
                continue;
            };
            if message.protocol.as_deref() == Some("dlm_probe") && !self.budget.slow_probes {
                self.probes.push_back((to, message.clone()));
            } else {
                let wire = self.wires.entry((from, to)).or_default();
                wire.push_back(Rc::new(message.clone()));
            }
        }
    }

    fn check(&self) -> Result<(), String> {
        let holders = (0..AGENTS).filter(|agent| self.nodes[*agent].holds.is_some());
        let holders: Vec<&str> = holders.map(|agent| NAMES[agent]).collect();
        if holders.len() > 1 && self.clocks == Clocks::Together {
            return Err(format!("{holders:?} hold it at the same time"));
        }
        Ok(())
    }

    /// Nothing goes wrong any more: messages arrive at once, holders give back at once, and time
    /// passes. Everyone must be told, and the resource must be free in the end.
    pub(crate) fn run_to_the_end(&mut self) -> Result<(), String> {
        self.budget = Budget::default();
        let most = self.nodes.iter().map(|node| node.clock).max();
        for agent in 0..AGENTS {
            while Some(self.nodes[agent].clock) < most {
                self.passes(agent)?;
            }
        }
        for _ in 0..PATIENCE {
            self.drain()?;
            let waits = self.nodes.iter().any(|node| node.waits);
            let held = self.nodes[0]
                .machine
                .owned()
                .any(|view| view.holder.is_some());
            if !waits && !held {
                return Ok(());
            }
            self.all_pass()?;
        }
        Err("somebody is never told".to_owned())
    }

    fn drain(&mut self) -> Result<(), String> {
        loop {
            let next = self.wires.keys().next().copied();
            let holder = (0..AGENTS).find(|agent| self.nodes[*agent].holds.is_some());
            match (next, holder) {
                (Some((from, to)), _) => self.arrives(from, to)?,
                (None, Some(agent)) => self.gives_back(agent)?,
                (None, None) => return Ok(()),
            }
        }
    }

    /// States with the same one have the same future, and are taken for the same.
    pub(crate) fn fingerprint(&self) -> u128 {
        let machines = self.nodes.iter().map(|node| (*node.machine).clone());
        let mut machines: Vec<LockAgent> = machines.collect();
        let messages = self
            .wires
            .values()
            .flatten()
            .map(|message| (**message).clone());
        let mut messages: Vec<Message> = messages.collect();
        let last = self.disk.fencing;
        let renaming = Renaming::new(&mut machines, &messages, last);
        for (agent, machine) in machines.iter_mut().enumerate() {
            renaming.agent(self.now(agent), machine);
        }
        for message in &mut messages {
            renaming.message(message);
        }
        let wires = self.wires.iter().map(|(ends, wire)| (ends, wire.len()));
        let wires: Vec<_> = wires.collect();
        let nodes = self.nodes.iter().map(|node| {
            let number = node.holds.map(|number| last - number.min(last));
            (node.up, node.waits, number)
        });
        let nodes: Vec<_> = nodes.collect();
        let granted = self.granted << (63 - last);
        let halves = [0_u8, 1].map(|half| {
            let mut hasher = DefaultHasher::new();
            (half, &self.budget, &machines, &messages).hash(&mut hasher);
            (&wires, &nodes, granted, self.disk.held).hash(&mut hasher);
            u128::from(hasher.finish())
        });
        halves[0] << 64 | halves[1]
    }
}

fn machine(agent: usize, life: u64) -> LockAgent {
    LockAgent::new(Config {
        heartbeat: HEARTBEAT,
        ..Config::new(NAMES[agent], life * 1000)
    })
}
