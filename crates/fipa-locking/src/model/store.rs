//! The machines and messages of all states, each kept once, and what each machine does at each
//! input, worked out once.

use std::collections::HashMap;
use std::hash::Hash;
use std::rc::Rc;
use std::time::Duration;

use fipa_acl::{Message, Text};

use super::world::{AGENTS, NAMES, RESOURCE};
use crate::agent::canonical::{self, Stamp};
use crate::{Algorithm, Config, LockAgent, Output, Record};

pub(crate) const HEARTBEAT: Duration = Duration::from_secs(1);
/// It is always now: what is remembered ages instead.
const NOW: Duration = Duration::from_secs(100);
/// More grants than any run needs.
const MOST_GRANTS: u64 = 30;

pub(crate) type Id = u32;

/// What comes to a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Input {
    Message(Id),
    /// It asks those that are up, a bit each.
    Ask(u8),
    Release,
    Gone(usize),
    Participants(u8),
    /// A heartbeat passes.
    Age,
    /// It does what is due; whether what is unanswered is said again.
    Wake {
        again: bool,
    },
    /// Its Lamport clock, and the stamp of its request, are moved.
    Lamport(u64, Option<u64>),
    /// What decides nothing any more is forgotten; whether answers to probes are under way.
    Forget {
        probed: bool,
    },
}

/// What a machine wants done.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Action {
    Send { to: usize, message: Id },
    Probe { to: usize, message: Id },
    Granted(u64),
    Lost,
    Failed,
    Keep(Record),
}

/// What is looked at of a machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look {
    pub(crate) clock: u64,
    pub(crate) stamp: Option<u64>,
    pub(crate) discovers: bool,
    pub(crate) says_again: bool,
    pub(crate) lends: bool,
}

type Step = Result<(Id, Rc<[Action]>), String>;

pub(crate) struct Store {
    algorithm: Algorithm,
    slow_probes: bool,
    machines: Kept<LockAgent>,
    looks: Vec<Look>,
    messages: Kept<Message>,
    stamps: Vec<Option<Stamp>>,
    steps: HashMap<(Id, Input), Step>,
    restamped: HashMap<(Id, u64), Id>,
}

impl Store {
    pub(crate) fn new(algorithm: Algorithm, slow_probes: bool) -> Store {
        Store {
            algorithm,
            slow_probes,
            machines: Kept::new(),
            looks: Vec::new(),
            messages: Kept::new(),
            stamps: Vec::new(),
            steps: HashMap::new(),
            restamped: HashMap::new(),
        }
    }

    /// An agent that begins a life. The owner takes what it has kept; whether the others know it
    /// from before.
    pub(crate) fn machine(&mut self, agent: usize, life: u64, knows: bool, disk: Record) -> Id {
        let mut machine = LockAgent::new(Config {
            heartbeat: HEARTBEAT,
            ..Config::new(NAMES[agent], life * 1024)
        });
        if agent == 0 {
            machine.own(NOW, RESOURCE, disk).unwrap();
        } else if knows {
            machine.know_owner(RESOURCE, NAMES[0]);
        }
        machine.forget(NOW, false);
        self.keep(machine)
    }

    fn keep(&mut self, machine: LockAgent) -> Id {
        let (id, new) = self.machines.id(machine);
        if let Some(machine) = new {
            let (clock, stamp) = machine.lamport();
            self.looks.push(Look {
                clock,
                stamp,
                discovers: machine.is_discovering(),
                says_again: machine.says_again(),
                lends: machine.owned().any(|view| view.holder.is_some()),
            });
        }
        id
    }

    pub(crate) fn look(&self, machine: Id) -> Look {
        self.looks[machine as usize]
    }

    pub(crate) fn stamp(&self, message: Id) -> Option<Stamp> {
        self.stamps[message as usize]
    }

    pub(crate) fn restamp(&mut self, message: Id, number: u64) -> Id {
        if let Some(id) = self.restamped.get(&(message, number)) {
            return *id;
        }
        let stamped = canonical::with_stamp(self.messages.get(message), number);
        let id = self.keep_message(stamped);
        self.restamped.insert((message, number), id);
        id
    }

    fn keep_message(&mut self, message: Message) -> Id {
        let (id, new) = self.messages.id(message);
        if let Some(message) = new {
            self.stamps.push(canonical::stamp(message));
        }
        id
    }

    pub(crate) fn step(&mut self, machine: Id, input: Input) -> Step {
        if let Some(step) = self.steps.get(&(machine, input)) {
            return step.clone();
        }
        let step = self.work_out(machine, input);
        self.steps.insert((machine, input), step.clone());
        step
    }

    fn work_out(&mut self, id: Id, input: Input) -> Step {
        let mut machine = self.machines.get(id).clone();
        match input {
            Input::Message(message) => drop(machine.handle(NOW, self.messages.get(message))),
            Input::Ask(up) => {
                machine.count_request();
                let asked = machine.request(NOW, RESOURCE, self.algorithm, names(up));
                asked.map_err(|error| error.to_string())?;
            }
            Input::Release => machine.release(NOW, RESOURCE),
            Input::Gone(agent) => machine.agent_gone(NOW, NAMES[agent]),
            Input::Participants(up) => machine.set_participants(NOW, RESOURCE, names(up)),
            Input::Age => machine.age(HEARTBEAT),
            Input::Wake { again } => {
                if again {
                    machine.say_again(NOW);
                }
                let due = |machine: &LockAgent| machine.poll_timeout().is_some_and(|at| at <= NOW);
                if due(&machine) {
                    machine.handle_timeout(NOW);
                }
                if due(&machine) {
                    return Err(format!("{} is woken again and again", machine.name()));
                }
            }
            Input::Lamport(clock, stamp) => machine.set_lamport(clock, stamp),
            Input::Forget { probed } => machine.forget(NOW, probed),
        }
        let mut actions = Vec::new();
        while let Some(output) = machine.poll_output() {
            self.note(&mut machine, &output, &mut actions)?;
        }
        if !matches!(input, Input::Forget { .. }) {
            let probed = self.slow_probes || machine.waits_for_probes();
            machine.forget(NOW, probed);
        }
        Ok((self.keep(machine), actions.into()))
    }

    fn note(
        &mut self,
        machine: &mut LockAgent,
        output: &Output,
        actions: &mut Vec<Action>,
    ) -> Result<(), String> {
        match output {
            Output::Send(message) => {
                let fast = message.protocol.as_deref() == Some("dlm_probe") && !self.slow_probes;
                for receiver in &message.receiver {
                    let to = NAMES.iter().position(|name| receiver.name == **name);
                    let to = to.ok_or("a message to nobody")?;
                    if to != 0 && canonical::is_for_owners(message) {
                        continue;
                    }
                    let message = canonical::received(message, NAMES[to]);
                    let message = self.keep_message(message);
                    actions.push(if fast {
                        Action::Probe { to, message }
                    } else {
                        Action::Send { to, message }
                    });
                }
            }
            Output::Granted { fencing, .. } => {
                actions.push(Action::Granted(fencing.ok_or("a grant without a number")?));
            }
            Output::Lost { .. } => actions.push(Action::Lost),
            Output::Failed { .. } => actions.push(Action::Failed),
            Output::Persist { record, .. } => {
                if record.fencing > MOST_GRANTS {
                    return Err("it is granted again and again".to_owned());
                }
                actions.push(Action::Keep(*record));
                if record.held {
                    machine.persisted(NOW, RESOURCE, record.fencing);
                }
            }
        }
        Ok(())
    }
}

fn names(up: u8) -> impl Iterator<Item = Text> {
    let up = (0..AGENTS).filter(move |agent| up >> agent & 1 == 1);
    up.map(|agent| Text::from_static(NAMES[agent]))
}

/// Values that are kept once each, and counted.
struct Kept<T> {
    ids: HashMap<Rc<T>, Id>,
    values: Vec<Rc<T>>,
}

impl<T: Eq + Hash> Kept<T> {
    fn new() -> Kept<T> {
        Kept {
            ids: HashMap::new(),
            values: Vec::new(),
        }
    }

    fn get(&self, id: Id) -> &T {
        &self.values[id as usize]
    }

    /// The number of a value, and the value if it is new.
    fn id(&mut self, value: T) -> (Id, Option<&T>) {
        if let Some(id) = self.ids.get(&value) {
            return (*id, None);
        }
        let id = Id::try_from(self.values.len()).unwrap();
        let value = Rc::new(value);
        self.ids.insert(Rc::clone(&value), id);
        self.values.push(value);
        (id, self.values.last().map(|value| &**value))
    }
}
