//! Agents whose future is the same are made equal, so that the search through all orders of events
//! need not follow both.
//!
//! Clocks count by their distance only, Lamport's and the real ones alike; conversations by being
//! equal or not; numbers of grants by their distance to the last one.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fipa_acl::{Message, Text};

use super::LockAgent;
use crate::watch::Watch;
use crate::wire;

/// How the values of a state are renamed.
#[derive(Default)]
pub(crate) struct Renaming {
    conversations: BTreeMap<Text, Text>,
    /// How many conversations each agent has opened that are still known.
    opened: BTreeMap<Text, u64>,
    lowest_clock: u64,
    last_number: u64,
}

/// Where the times of a renamed agent are counted from, and how far back they are told apart.
const EPOCH: Duration = Duration::from_secs(100);
const PAST: Duration = Duration::from_secs(12);
/// The number of the last grant of a renamed state.
const LAST_NUMBER: u64 = 100;

impl Renaming {
    pub(crate) fn new(
        agents: &mut [LockAgent],
        messages: &[Message],
        last_number: u64,
    ) -> Renaming {
        let mut known = BTreeSet::new();
        let mut clocks = Vec::new();
        for agent in agents {
            clocks.push(agent.clock);
            clocks.extend(agent.stamps().map(|stamp| *stamp));
            agent.each_conversation(&mut |id| {
                known.insert((number_of(id), id.clone()));
            });
        }
        for message in messages {
            let id = Text::from(wire::conversation(message).unwrap_or_default());
            known.insert((number_of(&id), id));
            if let Some(id) = wire::parameter(message, wire::CONVERSATION).map(Text::from) {
                known.insert((number_of(&id), id));
            }
            clocks.extend(wire::stamped(message).map(|(clock, _)| clock));
        }
        let mut renaming = Renaming {
            lowest_clock: clocks.into_iter().min().unwrap_or_default(),
            last_number,
            ..Renaming::default()
        };
        for (_, id) in known {
            let Some((name, _)) = id.rsplit_once('_') else {
                continue;
            };
            let opened = renaming.opened.entry(Text::from(name)).or_default();
            let new = Text::from(format!("{name}_{opened}"));
            *opened += 1;
            renaming.conversations.insert(id, new);
        }
        renaming
    }

    fn conversation(&self, id: &Text) -> Text {
        self.conversations.get(id).unwrap_or(id).clone()
    }

    fn number(&self, number: u64) -> u64 {
        match number {
            0 => 0,
            _ => LAST_NUMBER + number - self.last_number,
        }
    }

    pub(crate) fn message(&self, message: &mut Message) {
        if let Some(id) = wire::conversation(message).map(Text::from) {
            message.conversation_id = Some(self.conversation(&id).into());
        }
        if let Some((clock, resource)) = wire::stamped(message) {
            let content = format!("{}\n{resource}", clock - self.lowest_clock);
            message.content = Some(content.into());
        }
        for parameter in &mut message.user_defined {
            let value = Text::from(parameter.value.as_str().unwrap_or_default());
            match &*parameter.name {
                wire::FENCING => {
                    let number = value.parse().unwrap_or_default();
                    parameter.value = self.number(number).to_string().into();
                }
                wire::CONVERSATION => parameter.value = self.conversation(&value).into(),
                _ => {}
            }
        }
    }

    pub(crate) fn agent(&self, now: Duration, agent: &mut LockAgent) {
        agent.each_conversation(&mut |id| *id = self.conversation(id));
        agent.clock -= self.lowest_clock;
        agent.stamps().for_each(|stamp| *stamp -= self.lowest_clock);
        let opened = self.opened.get(&agent.config.name).copied();
        agent.post.set_counter(opened.unwrap_or_default());
        agent.each_number(&mut |number| *number = self.number(*number));
        agent.each_time(&mut |time| *time = (EPOCH + *time).saturating_sub(now).max(EPOCH - PAST));
    }
}

fn number_of(id: &str) -> u64 {
    let number = id.rsplit_once('_').map(|(_, number)| number);
    number
        .and_then(|number| number.parse().ok())
        .unwrap_or_default()
}

impl LockAgent {
    fn stamps(&mut self) -> impl Iterator<Item = &mut u64> {
        let stamped = self.requests.values_mut();
        let stamped = stamped.filter(|request| {
            !request.algorithm.has_token() && request.phase != crate::request::Phase::Discovering
        });
        stamped.map(|request| &mut request.stamp)
    }

    fn each_watch(&mut self, f: &mut dyn FnMut(&mut Watch)) {
        for request in self.requests.values_mut() {
            request.watches.values_mut().for_each(&mut *f);
        }
        for owned in self.owned.values_mut() {
            owned
                .holding
                .iter_mut()
                .for_each(|holding| f(&mut holding.watch));
        }
    }

    fn each_conversation(&mut self, f: &mut dyn FnMut(&mut Text)) {
        self.each_watch(&mut |watch| {
            watch
                .open
                .iter_mut()
                .for_each(|probe| f(&mut probe.conversation));
        });
        for request in self.requests.values_mut() {
            f(&mut request.conversation);
            request.deferred.values_mut().for_each(&mut *f);
        }
        for owned in self.owned.values_mut() {
            let held = owned.holding.iter_mut().map(|holding| &mut holding.claim);
            let claims = owned.claims.iter_mut().chain(held);
            claims.for_each(|claim| f(&mut claim.conversation));
            owned.ended.values_mut().for_each(&mut *f);
        }
        for chain in self.chains.values_mut() {
            chain.heard.values_mut().for_each(|(_, id)| f(id));
        }
    }

    fn each_number(&mut self, f: &mut dyn FnMut(&mut u64)) {
        self.each_watch(&mut |watch| {
            let probes = watch.open.iter_mut();
            probes
                .filter_map(|probe| probe.fencing.as_mut())
                .for_each(&mut *f);
        });
        let requests = self.requests.values_mut();
        requests
            .filter_map(|request| request.fencing.as_mut())
            .for_each(&mut *f);
        for owned in self.owned.values_mut() {
            f(&mut owned.fencing);
            let holding = owned.holding.iter_mut();
            holding
                .filter_map(|holding| holding.fencing.as_mut())
                .for_each(&mut *f);
        }
    }

    fn each_time(&mut self, f: &mut dyn FnMut(&mut Duration)) {
        self.each_watch(&mut |watch| {
            f(&mut watch.heard);
            f(&mut watch.next);
            watch.open.iter_mut().for_each(|probe| f(&mut probe.sent));
        });
        for request in self.requests.values_mut() {
            f(&mut request.since);
            f(&mut request.repeat);
            request.renewed.iter_mut().for_each(&mut *f);
        }
        for owned in self.owned.values_mut() {
            owned.quarantine.iter_mut().for_each(&mut *f);
            owned.waiting.values_mut().for_each(&mut *f);
        }
    }
}
