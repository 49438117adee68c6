//! Three agents of which the first owns the resource, the messages between them, and what may
//! still happen.

use std::collections::VecDeque;

use super::store::{Action, Id, Input, Store};
use crate::Record;

pub(crate) const RESOURCE: &str = "door";
pub(crate) const AGENTS: usize = 3;
pub(crate) const NAMES: [&str; AGENTS] = ["a", "b", "c"];
const OWNER: usize = 0;
/// Heartbeats in which a run comes to its end, whatever has happened.
const PATIENCE: usize = 60;
/// What is unanswered is said again every so many heartbeats.
const AGAIN: usize = 4;
/// Lamport's clocks count in such steps, so that there is room between any two.
const GAP: u64 = 64;

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
    /// Times for which an agent is cut off from the others.
    pub(crate) cuts: u8,
    /// Times for which an agent's clock runs on alone.
    pub(crate) pauses: u8,
    /// Requests that are given up before they are answered.
    pub(crate) withdrawals: u8,
}

/// What is searched through.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Setting {
    pub(crate) clocks: Clocks,
    pub(crate) budget: Budget,
    /// Whether the others know the owner from before; else they have to ask who it is.
    pub(crate) known: bool,
    /// Whether heartbeats may pass while messages are under way; else those take less than one.
    pub(crate) late: bool,
    /// Whether probes take time like other messages; else an agent that lives answers at once.
    pub(crate) slow_probes: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// A message arrives. If a request begins by it, then at this place in the order of the
    /// requests.
    Arrives {
        from: usize,
        to: usize,
        place: u64,
    },
    Lost {
        from: usize,
        to: usize,
    },
    Asks {
        agent: usize,
        place: u64,
    },
    GivesBack(usize),
    /// It does not want it any more, before it has it.
    GivesUp(usize),
    /// It dies; whether the others will be told.
    Dies {
        agent: usize,
        told: bool,
    },
    /// An agent is told that another one died.
    Hears {
        agent: usize,
        dead: usize,
    },
    ComesBack(usize),
    /// Nothing that it says, and nothing that is said to it, arrives from now on.
    IsCutOff(usize),
    Mends,
    /// A heartbeat passes for all, in this order; a bit for each that says something again.
    Heartbeat {
        order: [usize; AGENTS],
        again: u8,
    },
    /// So many heartbeats pass for one agent.
    Pause(usize, usize),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Node {
    machine: Id,
    up: bool,
    life: u8,
    /// Whether it waits for an answer to its request.
    waits: bool,
    /// The number with which it believes that it holds.
    holds: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Letter {
    from: u8,
    to: u8,
    message: Id,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct World {
    clocks: Clocks,
    budget: Budget,
    nodes: [Node; AGENTS],
    /// By their ends, and in the order in which they were sent.
    letters: Vec<Letter>,
    /// Probes and their answers that arrive before anything else happens.
    probes: VecDeque<(usize, Id)>,
    /// Who has not been told yet that an agent died, a bit each.
    untold: [u8; AGENTS],
    cut_off: Option<usize>,
    /// What the owner keeps over a crash.
    disk: Record,
    /// The numbers that were granted, a bit each.
    granted: u32,
    /// Whether heartbeats may pass while messages are under way.
    late: bool,
    slow_probes: bool,
}

impl Setting {
    /// The usual setting: the owner has to be found, probes take no time, messages less than a
    /// heartbeat, and clocks go together unless some are to run on alone.
    pub(crate) fn of(budget: Budget) -> Setting {
        Setting {
            budget,
            clocks: if budget.pauses > 0 {
                Clocks::Apart
            } else {
                Clocks::Together
            },
            known: false,
            late: false,
            slow_probes: false,
        }
    }
}

impl World {
    pub(crate) fn new(store: &mut Store, setting: &Setting) -> World {
        let disk = Record::default();
        let node = |agent| Node {
            machine: store.machine(agent, 0, setting.known, disk),
            up: true,
            life: 0,
            waits: false,
            holds: None,
        };
        World {
            clocks: setting.clocks,
            budget: setting.budget,
            nodes: [0, 1, 2].map(node),
            letters: Vec::new(),
            probes: VecDeque::new(),
            untold: [0; AGENTS],
            cut_off: None,
            disk,
            granted: 0,
            late: setting.late,
            slow_probes: setting.slow_probes,
        }
    }

    pub(crate) fn is_quiet(&self) -> bool {
        self.letters.is_empty() && self.untold == [0; AGENTS]
    }

    fn up(&self) -> u8 {
        let up = (0..AGENTS).filter(|agent| self.nodes[*agent].up);
        up.map(|agent| 1 << agent).sum()
    }

    /// All that can happen next.
    pub(crate) fn events(&self, store: &Store) -> Vec<Event> {
        let mut events = Vec::new();
        self.events_of_letters(store, &mut events);
        for (agent, node) in self.nodes.iter().enumerate() {
            let idle = node.up && !node.waits && node.holds.is_none();
            if idle && self.budget.requests[agent] > 0 {
                let places = self.places(store, agent);
                events.extend(places.map(|place| Event::Asks { agent, place }));
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
            if !node.up && self.budget.rejoins > 0 && self.untold[agent] == 0 {
                events.push(Event::ComesBack(agent));
            }
            if self.budget.cuts > 0 && self.cut_off.is_none() {
                events.push(Event::IsCutOff(agent));
            }
            if node.up && self.budget.pauses > 0 && self.clocks == Clocks::Apart {
                events.extend([1, AGAIN].map(|span| Event::Pause(agent, span)));
            }
        }
        if self.cut_off.is_some() {
            events.push(Event::Mends);
        }
        if self.clocks == Clocks::Together && (self.late || self.is_quiet()) {
            self.events_of_time(store, &mut events);
        }
        events
    }

    fn events_of_letters(&self, store: &Store, events: &mut Vec<Event>) {
        let mut last = None;
        for letter in &self.letters {
            let ends = (letter.from, letter.to);
            if last.replace(ends) == Some(ends) {
                continue;
            }
            let (from, to) = (usize::from(letter.from), usize::from(letter.to));
            let begins = store.look(self.nodes[to].machine).discovers;
            let places = self.places(store, to).take(if begins { AGENTS } else { 1 });
            events.extend(places.map(|place| Event::Arrives { from, to, place }));
            if self.budget.losses > 0 {
                events.push(Event::Lost { from, to });
            }
        }
        for (dead, untold) in self.untold.iter().enumerate() {
            let told = (0..AGENTS).filter(|agent| untold >> agent & 1 == 1);
            events.extend(told.map(|agent| Event::Hears { agent, dead }));
        }
    }

    fn events_of_time(&self, store: &Store, events: &mut Vec<Event>) {
        let up: Vec<usize> = (0..AGENTS).filter(|agent| self.nodes[*agent].up).collect();
        let says_again = |agent: usize| store.look(self.nodes[agent].machine).says_again;
        for order in orders() {
            // Those that are down come last.
            if up.len() < AGENTS && order[..up.len()].iter().any(|at| !self.nodes[*at].up) {
                continue;
            }
            let silent = |again: u8| (0..AGENTS).any(|at| again >> at & 1 == 1 && !says_again(at));
            let most = if self.is_quiet() { 1 << AGENTS } else { 1 };
            for again in (0..most).filter(|again| again & !self.up() == 0 && !silent(*again)) {
                events.push(Event::Heartbeat { order, again });
            }
        }
    }

    /// Where a request that an agent makes now may stand among those that are under way: behind
    /// all that it has heard of.
    fn places(&self, store: &Store, agent: usize) -> std::ops::RangeInclusive<u64> {
        let heard = store.look(self.nodes[agent].machine).clock / GAP;
        heard..=self.stamps(store).len() as u64
    }

    /// The stamps of the requests that are under way, in their order.
    fn stamps(&self, store: &Store) -> Vec<u64> {
        let own = self.nodes.iter();
        let own = own.filter_map(|node| store.look(node.machine).stamp);
        let sent = self.letters.iter();
        let sent = sent.filter_map(|letter| store.stamp(letter.message));
        let sent = sent.filter(|stamp| stamp.compared);
        let mut stamps: Vec<u64> = own.chain(sent.map(|stamp| stamp.number)).collect();
        stamps.sort_unstable();
        stamps.dedup();
        stamps
    }

    pub(crate) fn happens(&mut self, store: &mut Store, event: &Event) -> Result<(), String> {
        match *event {
            Event::Arrives { from, to, place } => self.arrives(store, from, to, place)?,
            Event::Lost { from, to } => {
                self.budget.losses -= 1;
                self.take(from, to);
            }
            Event::Asks { agent, place } => {
                self.budget.requests[agent] -= 1;
                self.nodes[agent].waits = true;
                self.leap(store, agent, place)?;
                self.step(store, agent, Input::Ask(self.up()))?;
            }
            Event::GivesBack(agent) => {
                self.nodes[agent].holds = None;
                self.step(store, agent, Input::Release)?;
            }
            Event::GivesUp(agent) => {
                self.budget.withdrawals -= 1;
                self.nodes[agent].waits = false;
                self.step(store, agent, Input::Release)?;
            }
            Event::Dies { agent, told } => self.dies(store, agent, told),
            Event::Hears { agent, dead } => {
                self.untold[dead] &= !(1 << agent);
                self.step(store, agent, Input::Gone(dead))?;
            }
            Event::ComesBack(agent) => self.comes_back(store, agent)?,
            Event::IsCutOff(agent) => {
                self.budget.cuts -= 1;
                self.cut_off = Some(agent);
            }
            Event::Mends => self.cut_off = None,
            Event::Heartbeat { order, again } => {
                for agent in order {
                    self.step(store, agent, Input::Age)?;
                }
                for agent in order {
                    let again = again >> agent & 1 == 1;
                    self.step(store, agent, Input::Wake { again })?;
                }
            }
            Event::Pause(agent, span) => {
                self.budget.pauses -= 1;
                for at in 1..=span {
                    let again = at == AGAIN;
                    self.step(store, agent, Input::Age)?;
                    self.step(store, agent, Input::Wake { again })?;
                }
            }
        }
        self.forget(store)
    }

    fn take(&mut self, from: usize, to: usize) -> Option<Id> {
        let mut letters = self.letters.iter();
        let at = letters
            .position(|letter| usize::from(letter.from) == from && usize::from(letter.to) == to)?;
        Some(self.letters.remove(at).message)
    }

    fn arrives(
        &mut self,
        store: &mut Store,
        from: usize,
        to: usize,
        place: u64,
    ) -> Result<(), String> {
        let message = self.take(from, to).ok_or("there is no such letter")?;
        self.leap(store, to, place)?;
        self.step(store, to, Input::Message(message))
    }

    /// An agent's Lamport clock leaps to where its next request stands.
    fn leap(&mut self, store: &mut Store, agent: usize, place: u64) -> Result<(), String> {
        let look = store.look(self.nodes[agent].machine);
        if place <= look.clock / GAP {
            return Ok(());
        }
        let clock = place * GAP + GAP / 2;
        self.step(store, agent, Input::Lamport(clock, look.stamp))
    }

    fn dies(&mut self, store: &mut Store, agent: usize, told: bool) {
        self.budget.crashes -= 1;
        let node = &mut self.nodes[agent];
        (node.up, node.waits, node.holds) = (false, false, None);
        node.life += 1;
        let life = u64::from(node.life);
        node.machine = store.machine(agent, life, false, Record::default());
        self.letters
            .retain(|letter| usize::from(letter.to) != agent);
        self.untold
            .iter_mut()
            .for_each(|untold| *untold &= !(1 << agent));
        if told {
            self.untold[agent] = self.up();
        }
    }

    fn comes_back(&mut self, store: &mut Store, agent: usize) -> Result<(), String> {
        self.budget.rejoins -= 1;
        let node = &mut self.nodes[agent];
        node.up = true;
        let life = u64::from(node.life);
        node.machine = store.machine(agent, life, false, self.disk);
        for other in 0..AGENTS {
            self.step(store, other, Input::Participants(self.up()))?;
        }
        Ok(())
    }

    /// Something comes to a machine, and what it wants done is done.
    fn step(&mut self, store: &mut Store, agent: usize, input: Input) -> Result<(), String> {
        self.give(store, agent, input)?;
        while let Some((to, message)) = self.probes.pop_front() {
            self.give(store, to, Input::Message(message))?;
        }
        Ok(())
    }

    fn give(&mut self, store: &mut Store, agent: usize, input: Input) -> Result<(), String> {
        let node = &mut self.nodes[agent];
        if !node.up {
            return Ok(());
        }
        let (machine, actions) = store.step(node.machine, input)?;
        node.machine = machine;
        for action in actions.iter() {
            let node = &mut self.nodes[agent];
            match *action {
                Action::Send { to, .. } | Action::Probe { to, .. }
                    if [agent, to].map(Some).contains(&self.cut_off) => {}
                Action::Send { to, message } => self.send(agent, to, message),
                Action::Probe { to, message } => self.probes.push_back((to, message)),
                Action::Granted(number) => {
                    (node.waits, node.holds) = (false, Some(number));
                    self.granted(number)?;
                }
                Action::Lost => node.holds = None,
                Action::Failed => node.waits = false,
                Action::Keep(record) => self.disk = record,
            }
        }
        Ok(())
    }

    fn send(&mut self, from: usize, to: usize, message: Id) {
        if !self.nodes[to].up {
            return;
        }
        let (from, to) = (from as u8, to as u8);
        let behind = |letter: &Letter| (letter.from, letter.to) <= (from, to);
        let at = self.letters.partition_point(behind);
        self.letters.insert(at, Letter { from, to, message });
    }

    fn granted(&mut self, number: u64) -> Result<(), String> {
        let bit = 1 << number;
        if self.granted & bit != 0 {
            return Err(format!("the number {number} was granted twice"));
        }
        self.granted |= bit;
        if self.clocks == Clocks::Apart {
            return Ok(());
        }
        if self.granted >> number > 1 {
            return Err(format!("a number greater than {number} was granted before"));
        }
        let holders = self.nodes.iter().filter(|node| node.holds.is_some());
        if holders.count() > 1 {
            return Err("two agents hold it at the same time".to_owned());
        }
        Ok(())
    }

    /// Forgets what decides nothing any more, and counts the requests that are under way anew.
    fn forget(&mut self, store: &mut Store) -> Result<(), String> {
        let probed = self.slow_probes && !self.letters.is_empty();
        for agent in 0..AGENTS {
            self.give(store, agent, Input::Forget { probed })?;
        }
        let stamps = self.stamps(store);
        let rank = |number: u64| GAP * stamps.partition_point(|stamp| *stamp <= number) as u64;
        for agent in 0..AGENTS {
            let look = store.look(self.nodes[agent].machine);
            let new = (rank(look.clock), look.stamp.map(rank));
            if new != (look.clock, look.stamp) {
                self.give(store, agent, Input::Lamport(new.0, new.1))?;
            }
        }
        for letter in &mut self.letters {
            if let Some(stamp) = store.stamp(letter.message)
                && rank(stamp.number) != stamp.number
            {
                letter.message = store.restamp(letter.message, rank(stamp.number));
            }
        }
        Ok(())
    }

    /// Nothing goes wrong any more: messages arrive at once, holders give back at once, and time
    /// passes. Everyone must be told, and the resource must be free in the end.
    pub(crate) fn run_to_the_end(
        &mut self,
        store: &mut Store,
        mut is_known: impl FnMut(&World) -> bool,
    ) -> Result<(), String> {
        self.budget = Budget::default();
        self.cut_off = None;
        for heartbeat in 1..=PATIENCE {
            self.drain(store)?;
            if is_known(self) {
                return Ok(());
            }
            let waits = self.nodes.iter().any(|node| node.waits);
            if !waits && !store.look(self.nodes[OWNER].machine).lends {
                return Ok(());
            }
            let again = if heartbeat % AGAIN == 0 { 0b111 } else { 0 };
            let order = [0, 1, 2];
            self.happens(store, &Event::Heartbeat { order, again })?;
        }
        Err("somebody is never told".to_owned())
    }

    /// All messages arrive, and who holds gives back.
    fn drain(&mut self, store: &mut Store) -> Result<(), String> {
        loop {
            let holder = (0..AGENTS).find(|agent| self.nodes[*agent].holds.is_some());
            let letter = self.letters.first().copied();
            let dead = (0..AGENTS).find(|dead| self.untold[*dead] != 0);
            let event = match (letter, dead, holder) {
                (Some(Letter { from, to, .. }), _, _) => {
                    let (from, to) = (usize::from(from), usize::from(to));
                    Event::Arrives { from, to, place: 0 }
                }
                (_, Some(dead), _) => {
                    let agent = self.untold[dead].trailing_zeros() as usize;
                    Event::Hears { agent, dead }
                }
                (_, _, Some(agent)) => Event::GivesBack(agent),
                (None, None, None) => return Ok(()),
            };
            self.happens(store, &event)?;
        }
    }
}

fn orders() -> impl Iterator<Item = [usize; AGENTS]> {
    let orders = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    orders.into_iter()
}
