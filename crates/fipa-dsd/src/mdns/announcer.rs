//! The announcements of the own agents in the way of `fipa_services`: which of them stand, and
//! what the library has to be told for it.
use std::collections::{BTreeMap, HashMap};
use std::time::{Duration, Instant};

use fipa_acl::Text;
use fipa_directory::{Entry, InstanceId};
use mdns_sd::{IfKind, IfPredicate, ServiceInfo, TxtProperty};

use crate::interface::Rule;
use crate::service_directory::reach::Reach;
use crate::service_directory::{ServiceType, key, label, txt};
use crate::{AgentsReport, LeftOut};

/// A goodbye is sent a second time after 120 ms, and would undo what is announced before that.
const AFTER_GOODBYE: Duration = Duration::from_millis(250);
/// An announcement is sent twice, a little more than a second apart. The library does not find a
/// name again that holds a capital letter, so its second announcement is ours to make.
const SECOND_TIME: Duration = Duration::from_millis(1150);

/// The agents of this daemon.
#[derive(Debug)]
pub(super) struct Announcer {
    instance: InstanceId,
    service_type: Option<ServiceType>,
    most: usize,
    rule: Rule,
    reach: Reach,
    agents: BTreeMap<Text, Agent>,
    /// Whose labels are announced, by what makes them the same.
    labels: HashMap<String, Text>,
    /// Those for whom there was no room, in the order in which they came.
    waiting: BTreeMap<u64, Text>,
    /// When names that said goodbye may be announced again.
    free_from: HashMap<String, Instant>,
    count: u64,
    commands: BTreeMap<(Instant, u64), Command>,
}

#[derive(Debug)]
struct Agent {
    entry: Entry,
    state: State,
}

#[derive(Debug)]
enum State {
    Announced { service: Service, shortened: bool },
    Waiting(u64),
    LeftOut(LeftOut),
}

/// A service as it is announced.
#[derive(Clone, Debug)]
struct Service {
    label: String,
    host: String,
    strings: Vec<txt::TxtString>,
}

/// What the library is to be told.
#[derive(Clone, Debug)]
enum Command {
    Register { name: Text, again: bool },
    Unregister(String),
}

/// A command for the library.
pub(super) enum Order {
    Register(Box<ServiceInfo>),
    Unregister(String),
}

impl Announcer {
    pub(super) fn new(
        instance: InstanceId,
        service_type: Option<ServiceType>,
        most: usize,
        rule: Rule,
        reach: Reach,
    ) -> Announcer {
        Announcer {
            instance,
            service_type,
            most,
            rule,
            reach,
            agents: BTreeMap::new(),
            labels: HashMap::new(),
            waiting: BTreeMap::new(),
            free_from: HashMap::new(),
            count: 0,
            commands: BTreeMap::new(),
        }
    }

    /// Announces an agent, or what has changed of it.
    pub(super) fn put(&mut self, now: Instant, entry: Entry) -> Result<(), LeftOut> {
        let name = entry.name.clone();
        match self.agents.get_mut(&name) {
            Some(agent) if agent.entry == entry => return self.result(&name),
            Some(agent) => agent.entry = entry,
            None => {
                let state = State::LeftOut(LeftOut::Scope);
                self.agents.insert(name.clone(), Agent { entry, state });
            }
        }
        self.settle(now, &name);
        self.move_up(now);
        self.result(&name)
    }

    /// Announces an agent no longer.
    pub(super) fn remove(&mut self, now: Instant, name: &str) {
        self.withdraw(now, name);
        self.agents.remove(name);
        self.move_up(now);
    }

    /// Removes all agents but these.
    pub(super) fn retain(&mut self, now: Instant, stays: impl Fn(&str) -> bool) {
        let leaves = self.agents.keys().filter(|name| !stays(name));
        let leaves: Vec<_> = leaves.cloned().collect();
        for name in leaves {
            self.remove(now, &name);
        }
    }

    /// The addresses of this host are other ones now.
    pub(super) fn set_reach(&mut self, now: Instant, reach: Reach) {
        if reach == self.reach {
            return;
        }
        self.reach = reach;
        let names: Vec<_> = self.agents.keys().cloned().collect();
        for name in names {
            self.settle(now, &name);
        }
        self.move_up(now);
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

    /// When there is something for the library.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let ((at, _), _) = self.commands.first_key_value()?;
        Some(*at)
    }

    /// What the library is to be told now; [`done`](Announcer::done) when it has taken it.
    pub(super) fn order(&mut self, now: Instant) -> Option<Order> {
        loop {
            let ((at, _), command) = self.commands.first_key_value()?;
            if *at > now {
                return None;
            }
            match command {
                Command::Unregister(fullname) => {
                    return Some(Order::Unregister(fullname.clone()));
                }
                Command::Register { name, .. } => {
                    let free = self.free_from(name).filter(|free| *free > now);
                    match (free, self.service_info(name)) {
                        (None, Some(service)) => return Some(Order::Register(Box::new(service))),
                        (Some(free), Some(_)) => self.postpone(free),
                        // Withdrawn in the meantime.
                        (_, None) => drop(self.commands.pop_first()),
                    }
                }
            }
        }
    }

    /// The library has taken the order.
    pub(super) fn done(&mut self, now: Instant) {
        match self.commands.pop_first() {
            Some((_, Command::Register { name, again: false })) => {
                let label = label(&name).unwrap_or_default();
                if key(&label) != label {
                    let again = true;
                    self.command(now + SECOND_TIME, Command::Register { name, again });
                }
            }
            Some((_, Command::Unregister(fullname))) => {
                self.free_from.retain(|_, free| *free > now);
                self.free_from.insert(key(&fullname), now + AFTER_GOODBYE);
            }
            _ => {}
        }
    }

    /// The goodbyes of all agents.
    pub(super) fn fullnames(&self) -> Vec<String> {
        let labels = self.agents.values().filter_map(|agent| match &agent.state {
            State::Announced { service, .. } => Some(&service.label),
            _ => None,
        });
        labels.filter_map(|label| self.fullname(label)).collect()
    }

    fn result(&self, name: &str) -> Result<(), LeftOut> {
        match self.agents.get(name).map(|agent| &agent.state) {
            Some(State::LeftOut(why)) => Err(why.clone()),
            Some(State::Waiting(_)) => Err(LeftOut::Limit(self.most)),
            _ => Ok(()),
        }
    }

    /// Finds out what becomes of an agent, after something has changed.
    fn settle(&mut self, now: Instant, name: &Text) {
        let Some(agent) = self.agents.get(name) else {
            return;
        };
        let wanted = self.wanted(&agent.entry);
        let state = match (wanted, &agent.state) {
            (Ok((wanted, _)), State::Announced { service, .. }) if wanted == service.strings => {
                return;
            }
            (Ok((strings, shortened)), State::Announced { service, .. }) => {
                let service = Service {
                    strings,
                    ..service.clone()
                };
                State::Announced { service, shortened }
            }
            (Ok(_), State::Waiting(_)) => return,
            (Ok(_), State::LeftOut(_)) if self.labels.len() >= self.most => {
                self.count += 1;
                self.waiting.insert(self.count, name.clone());
                State::Waiting(self.count)
            }
            (Ok((strings, shortened)), State::LeftOut(_)) => {
                let service = self.new_service(name, strings);
                State::Announced { service, shortened }
            }
            (Err(why), _) => {
                self.withdraw(now, name);
                State::LeftOut(why)
            }
        };
        if matches!(state, State::Announced { .. }) {
            let (name, again) = (name.clone(), false);
            self.command(now, Command::Register { name, again });
        }
        if let Some(agent) = self.agents.get_mut(name) {
            agent.state = state;
        }
    }

    /// The strings of an agent, if it can be announced.
    fn wanted(&self, entry: &Entry) -> Result<(Vec<txt::TxtString>, bool), LeftOut> {
        if self.service_type.is_none() {
            return Err(LeftOut::Scope);
        }
        let label = label(&entry.name).ok_or(LeftOut::NameLength(entry.name.len()))?;
        let holder = self.labels.get(&key(&label));
        if let Some(holder) = holder.filter(|holder| **holder != entry.name) {
            return Err(LeftOut::NameTaken(holder.clone()));
        }
        let mut told = entry.clone();
        told.locations = self.reach.locations(&entry.locations);
        if told.locations.is_empty() {
            return Err(LeftOut::NoLocation);
        }
        let announcement = txt::write(&told, self.instance).ok_or(LeftOut::TooLong)?;
        Ok((announcement.strings, announcement.shortened))
    }

    fn new_service(&mut self, name: &Text, strings: Vec<txt::TxtString>) -> Service {
        let label = label(name).unwrap_or_default();
        self.labels.insert(key(&label), name.clone());
        self.count += 1;
        // The goodbye of a service is one of its host name, too: each has its own, lest the others
        // go with it.
        let host = format!(
            "fipa-{}-{}.local.",
            &self.instance.to_string()[..16],
            self.count
        );
        Service {
            label,
            host,
            strings,
        }
    }

    fn withdraw(&mut self, now: Instant, name: &str) {
        match self.agents.get(name).map(|agent| &agent.state) {
            Some(State::Announced { service, .. }) => {
                self.labels.remove(&key(&service.label));
                let fullname = self.fullname(&service.label);
                if let Some(fullname) = fullname {
                    self.command(now, Command::Unregister(fullname));
                }
            }
            Some(State::Waiting(number)) => {
                self.waiting.remove(number);
            }
            _ => {}
        }
    }

    /// Gives a label or a place that became free to those who lack it.
    fn move_up(&mut self, now: Instant) {
        if self.agents.len() == self.labels.len() {
            return;
        }
        let lacking = |agent: &Agent| matches!(agent.state, State::LeftOut(LeftOut::NameTaken(_)));
        let lacking = self.agents.iter().filter(|(_, agent)| lacking(agent));
        let lacking: Vec<_> = lacking.map(|(name, _)| name.clone()).collect();
        for name in lacking {
            self.settle(now, &name);
        }
        while self.labels.len() < self.most
            && let Some((_, name)) = self.waiting.pop_first()
        {
            if let Some(agent) = self.agents.get_mut(&name) {
                agent.state = State::LeftOut(LeftOut::Limit(self.most));
            }
            self.settle(now, &name);
        }
    }

    fn command(&mut self, at: Instant, command: Command) {
        self.count += 1;
        self.commands.insert((at, self.count), command);
    }

    /// Carries out the first command later.
    fn postpone(&mut self, at: Instant) {
        if let Some((_, command)) = self.commands.pop_first() {
            self.command(at, command);
        }
    }

    /// Since when an agent may be announced for whose label a goodbye was sent.
    fn free_from(&self, name: &str) -> Option<Instant> {
        let fullname = self.fullname(&label(name)?)?;
        self.free_from.get(&key(&fullname)).copied()
    }

    fn fullname(&self, label: &str) -> Option<String> {
        let domain = self.service_type.as_ref()?.domain();
        // The library knows its services by their escaped names.
        let escaped = label.replace('\\', "\\\\");
        Some(format!("{escaped}.{domain}"))
    }

    /// The service of an agent as the library takes it.
    fn service_info(&self, name: &Text) -> Option<ServiceInfo> {
        let State::Announced { service, .. } = &self.agents.get(name)?.state else {
            return None;
        };
        let strings = service.strings.iter();
        let strings: Vec<TxtProperty> = strings
            .map(|(key, value)| TxtProperty::from((key, value)))
            .collect();
        let info = ServiceInfo::new(
            &self.service_type.as_ref()?.domain(),
            &service.label,
            &service.host,
            self.rule.explicit_addresses().as_slice(),
            0,
            strings,
        );
        let mut info = info.ok()?.enable_addr_auto();
        // A name that others have as well is told to people, not changed behind their backs.
        info.set_requires_probe(false);
        let rule = self.rule.clone();
        let announced = IfPredicate::new(move |interface| rule.announces(interface));
        info.set_interfaces(vec![IfKind::Predicate(announced)]);
        Some(info)
    }
}

#[cfg(test)]
mod tests;
