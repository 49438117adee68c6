//! Which of the own agents are announced in the way of `fipa_services`, and under which labels.
use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};

use fipa_acl::Text;
use fipa_directory::{Entry, InstanceId};

use crate::service_directory::answer::Told;
use crate::service_directory::reach::Reach;
use crate::service_directory::{ServiceType, key, label, txt};
use crate::{AgentsReport, LeftOut};

/// The agents of this daemon.
#[derive(Debug)]
pub(super) struct Announcer {
    instance: InstanceId,
    service_type: Option<ServiceType>,
    most: usize,
    reach: Reach,
    agents: BTreeMap<Text, Agent>,
    /// Whose labels are announced, by what makes them the same.
    labels: HashMap<String, Text>,
    /// Who lacks a label that another one has, by the same.
    lacking: HashMap<String, BTreeSet<Text>>,
    /// Labels that became free.
    freed: Vec<String>,
    /// Those for whom there was no room, in the order in which they came.
    waiting: BTreeMap<u64, Text>,
    count: u64,
    orders: VecDeque<Order>,
}

#[derive(Debug)]
struct Agent {
    entry: Entry,
    state: State,
}

#[derive(Debug)]
enum State {
    Announced { told: Told, shortened: bool },
    Waiting(u64),
    LeftOut(LeftOut),
}

/// What the network is to be told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Order {
    Announce(Told),
    /// That there is nobody of this label any more.
    Withdraw(String),
}

impl Announcer {
    pub(super) fn new(
        instance: InstanceId,
        service_type: Option<ServiceType>,
        most: usize,
        reach: Reach,
    ) -> Announcer {
        Announcer {
            instance,
            service_type,
            most,
            reach,
            agents: BTreeMap::new(),
            labels: HashMap::new(),
            lacking: HashMap::new(),
            freed: Vec::new(),
            waiting: BTreeMap::new(),
            count: 0,
            orders: VecDeque::new(),
        }
    }

    /// Announces an agent, or what has changed of it.
    pub(super) fn put(&mut self, entry: Entry) -> Result<(), LeftOut> {
        let name = entry.name.clone();
        match self.agents.get_mut(&name) {
            Some(agent) if agent.entry == entry => return self.result(&name),
            Some(agent) => agent.entry = entry,
            None => {
                let state = State::LeftOut(LeftOut::Scope);
                self.agents.insert(name.clone(), Agent { entry, state });
            }
        }
        self.settle(&name);
        self.move_up();
        self.result(&name)
    }

    /// Announces an agent no longer.
    pub(super) fn remove(&mut self, name: &str) {
        self.give_back(name);
        self.agents.remove(name);
        self.move_up();
    }

    /// Removes all agents but these.
    pub(super) fn retain(&mut self, stays: impl Fn(&str) -> bool) {
        let leaves = self.agents.keys().filter(|name| !stays(name));
        let leaves: Vec<_> = leaves.cloned().collect();
        for name in leaves {
            self.remove(&name);
        }
    }

    /// The addresses of this host are other ones now.
    pub(super) fn set_reach(&mut self, reach: Reach) {
        if reach == self.reach {
            return;
        }
        self.reach = reach;
        let names: Vec<_> = self.agents.keys().cloned().collect();
        for name in names {
            self.settle(&name);
        }
        self.move_up();
    }

    pub(super) fn report(&self) -> AgentsReport {
        let mut report = AgentsReport::default();
        for (name, agent) in &self.agents {
            match &agent.state {
                State::Announced { shortened, .. } => {
                    report.announced += 1;
                    report.shortened.extend(shortened.then(|| name.clone()));
                }
                State::Waiting(_) => report.waiting += 1,
                State::LeftOut(why) => report.left_out.push((name.clone(), why.clone())),
            }
        }
        report
    }

    /// What the network is to be told next.
    pub(super) fn poll_order(&mut self) -> Option<Order> {
        self.orders.pop_front()
    }

    fn result(&self, name: &str) -> Result<(), LeftOut> {
        match self.agents.get(name).map(|agent| &agent.state) {
            Some(State::LeftOut(why)) => Err(why.clone()),
            Some(State::Waiting(_)) => Err(LeftOut::Limit(self.most)),
            _ => Ok(()),
        }
    }

    /// Finds out what becomes of an agent, after something has changed.
    fn settle(&mut self, name: &Text) {
        let Some(agent) = self.agents.get(name) else {
            return;
        };
        let state = match (self.wanted(&agent.entry), &agent.state) {
            (Ok((wanted, _)), State::Announced { told, .. }) if wanted == *told => return,
            (Ok(_), State::Waiting(_)) => return,
            (Ok(_), State::LeftOut(_)) if self.labels.len() >= self.most => {
                self.count += 1;
                State::Waiting(self.count)
            }
            (Ok((told, shortened)), _) => State::Announced { told, shortened },
            (Err(why), _) => State::LeftOut(why),
        };
        if !matches!(state, State::Announced { .. }) || self.is_lacking(name) {
            self.give_back(name);
        }
        match &state {
            State::Announced { told, .. } => {
                self.labels.insert(key(&told.label), name.clone());
                self.orders.push_back(Order::Announce(told.clone()));
            }
            State::Waiting(number) => drop(self.waiting.insert(*number, name.clone())),
            State::LeftOut(LeftOut::NameTaken(_)) => {
                let key = key(&label(name).unwrap_or_default());
                self.lacking.entry(key).or_default().insert(name.clone());
            }
            State::LeftOut(_) => {}
        }
        if let Some(agent) = self.agents.get_mut(name) {
            agent.state = state;
        }
    }

    /// What is told of an agent, if it can be announced, and whether that is shortened.
    fn wanted(&self, entry: &Entry) -> Result<(Told, bool), LeftOut> {
        if self.service_type.is_none() {
            return Err(LeftOut::Scope);
        }
        let label = label(&entry.name).ok_or(LeftOut::NameLength(entry.name.len()))?;
        let holder = self.labels.get(&key(&label));
        if let Some(holder) = holder.filter(|holder| **holder != entry.name) {
            return Err(LeftOut::NameTaken(holder.clone()));
        }
        let mut usable = entry.clone();
        usable.locations = self.reach.locations(&entry.locations);
        if usable.locations.is_empty() {
            return Err(LeftOut::NoLocation);
        }
        let announcement = txt::write(&usable, self.instance).ok_or(LeftOut::TooLong)?;
        let strings = announcement.strings;
        Ok((Told { label, strings }, announcement.shortened))
    }

    fn is_lacking(&self, name: &str) -> bool {
        let state = self.agents.get(name).map(|agent| &agent.state);
        matches!(state, Some(State::LeftOut(LeftOut::NameTaken(_))))
    }

    /// Takes from an agent the label or the place in a queue that it has.
    fn give_back(&mut self, name: &str) {
        match self.agents.get(name).map(|agent| &agent.state) {
            Some(State::Announced { told, .. }) => {
                let key = key(&told.label);
                self.labels.remove(&key);
                self.freed.push(key);
                self.orders.push_back(Order::Withdraw(told.label.clone()));
            }
            Some(State::Waiting(number)) => drop(self.waiting.remove(number)),
            Some(State::LeftOut(LeftOut::NameTaken(_))) => {
                let key = key(&label(name).unwrap_or_default());
                if let Some(lacking) = self.lacking.get_mut(&key) {
                    lacking.remove(name);
                    if lacking.is_empty() {
                        self.lacking.remove(&key);
                    }
                }
            }
            _ => {}
        }
    }

    /// Gives a label or a place that became free to those who lack it. Looks at nobody else: of
    /// thousands of agents most may be left out.
    fn move_up(&mut self) {
        while let Some(key) = self.freed.pop() {
            let lacking = self.lacking.get(&key).cloned();
            for name in lacking.into_iter().flatten() {
                self.settle(&name);
            }
        }
        while self.labels.len() < self.most
            && let Some((_, name)) = self.waiting.pop_first()
        {
            if let Some(agent) = self.agents.get_mut(&name) {
                agent.state = State::LeftOut(LeftOut::Limit(self.most));
            }
            self.settle(&name);
        }
    }
}

#[cfg(test)]
mod tests;
