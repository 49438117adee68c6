//! One interaction of the initiator with a participant, or with all of them where the protocol
//! keeps one state: which state it is in, who plays which role, and until when.

use std::time::Duration;

use fipa_acl::{Expression, Message, Text};
use fipa_directory::Now;
use fipa_protocol::{Outcome, Pattern, Protocol, RoleId, State, StateId};

use crate::machine::Machine;

/// Octets of the compiled form of a receiver that is an expression.
const MAX_PATTERN: usize = 1 << 16;

#[derive(Clone, Debug)]
pub(crate) struct Branch {
    pub(crate) state: StateId,
    pub(crate) phase: Phase,
    pub(crate) bindings: Vec<(RoleId, Agent)>,
    /// On [`Now::mono`].
    pub(crate) deadline: Option<Duration>,
    /// The outcome by the last act.
    pub(crate) outcome: Outcome,
    /// What the initiator, and what the other side, wants answers to be tagged with.
    pub(crate) tags: [Option<Expression>; 2],
    pub(crate) subs: Vec<Sub>,
    /// Answers that were passed on.
    pub(crate) replies: usize,
    /// A participant that is an expression stands for those that have not said anything yet.
    pub(crate) split: bool,
}

/// A conversation of another protocol within this one.
#[derive(Clone, Debug)]
pub(crate) struct Sub {
    pub(crate) machine: Machine,
    pub(crate) awaited: bool,
}

/// Beside which states there are default ones.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    Running,
    /// The initiator sent a cancel, whose answer is to be tagged like this.
    Cancelling(Option<Expression>),
    /// Nothing follows; what the state is called now.
    Over(Outcome, Text),
}

/// An agent that plays a role: its name, or an expression for names.
#[derive(Clone, Debug)]
pub(crate) struct Agent {
    pub(crate) name: Text,
    pub(crate) pattern: Option<Pattern>,
}

impl Agent {
    pub(crate) fn new(name: &Text) -> Agent {
        let pattern = Pattern::is_meant(name).then(|| Pattern::new(name, MAX_PATTERN).ok());
        Agent {
            // The message need not stay in memory for its name.
            name: name.detached(),
            pattern: pattern.flatten(),
        }
    }

    /// One that is meant by its name, whatever that looks like.
    pub(crate) fn named(name: &Text) -> Agent {
        Agent {
            name: name.detached(),
            pattern: None,
        }
    }

    #[inline]
    pub(crate) fn is(&self, name: &str) -> bool {
        self.name == *name
            || self
                .pattern
                .as_ref()
                .is_some_and(|pattern| pattern.matches(name))
    }
}

/// A number that differs for most names, so that those of many participants are compared without
/// looking at each.
pub(crate) fn mark(name: &str) -> u64 {
    let octets = name.as_bytes();
    let eight = |octets: &[u8]| {
        octets
            .iter()
            .fold(0, |sum: u64, octet| sum << 8 | u64::from(*octet))
    };
    let head = eight(octets.get(..8).unwrap_or(octets));
    let tail = eight(octets.last_chunk::<8>().map_or(octets, |tail| &tail[..]));
    let middle = octets.get(octets.len() / 2).copied().unwrap_or(0);
    head ^ tail.rotate_left(29) ^ (octets.len() as u64) << 56 ^ u64::from(middle) << 40
}

/// Where a branch is at some time: what has passed by then counts.
pub(crate) struct View<'a> {
    pub(crate) id: StateId,
    pub(crate) state: &'a State,
    pub(crate) phase: &'a Phase,
}

static TIMED_OUT: Phase = Phase::Over(Outcome::TimedOut, Text::from_static("timed-out"));
static RUNNING: Phase = Phase::Running;

impl Branch {
    pub(crate) fn new(state: StateId) -> Branch {
        Branch {
            state,
            phase: Phase::Running,
            bindings: Vec::new(),
            deadline: None,
            outcome: Outcome::Done,
            tags: [None, None],
            subs: Vec::new(),
            replies: 0,
            split: false,
        }
    }

    pub(crate) fn view<'a>(&'a self, protocol: &'a Protocol, now: Now) -> View<'a> {
        let state = protocol.state(self.state);
        let late = self.deadline.is_some_and(|deadline| deadline <= now.mono);
        let (id, phase) = match (late, &self.phase, state.on_timeout()) {
            (false, phase, _) | (_, phase @ Phase::Over(..), _) => (self.state, phase),
            (true, Phase::Running, Some(next)) => (next, &RUNNING),
            (true, ..) => (self.state, &TIMED_OUT),
        };
        View {
            id,
            state: protocol.state(id),
            phase,
        }
    }

    /// Enters what the deadline leads to; tells whether it has passed.
    pub(crate) fn expire(&mut self, protocol: &Protocol, now: Now) -> bool {
        if self.deadline.is_none_or(|deadline| deadline > now.mono) {
            return false;
        }
        let view = self.view(protocol, now);
        let (id, phase) = (view.id, view.phase.clone());
        self.deadline = None;
        match phase {
            Phase::Running => self.enter(protocol, now, id, None),
            phase => self.phase = phase,
        }
        true
    }

    /// Enters a state; the message that led to it may say until when it waits.
    pub(crate) fn enter(
        &mut self,
        protocol: &Protocol,
        now: Now,
        id: StateId,
        message: Option<&Message>,
    ) {
        self.state = id;
        let state = protocol.state(id);
        self.outcome = state.outcome().unwrap_or(self.outcome);
        let reply_by = message.and_then(|message| message.reply_by.as_ref());
        let reply_by = reply_by.map(|time| {
            let left = time
                .resolve(now.unix_millis)
                .saturating_sub(now.unix_millis);
            now.mono
                .saturating_add(Duration::from_millis(u64::try_from(left).unwrap_or(0)))
        });
        let timeout = state
            .timeout()
            .map(|timeout| now.mono.saturating_add(timeout));
        let deadline = reply_by.into_iter().chain(timeout).min();
        self.deadline = deadline.filter(|_| !state.transitions().is_empty());
    }

    pub(crate) fn end(&mut self, outcome: Outcome, label: &'static str) {
        self.phase = Phase::Over(outcome, Text::from_static(label));
        self.deadline = None;
    }

    /// Ends what nothing is heard of any more, or whose agent is gone. Where it may end, it ended
    /// as it was meant to.
    pub(crate) fn abandon(
        &mut self,
        protocol: &Protocol,
        announced: Option<usize>,
        outcome: Outcome,
    ) {
        let state = protocol.state(self.state);
        if matches!(self.phase, Phase::Over(..)) || self.is_closed(protocol, announced) {
            return;
        }
        self.deadline = None;
        self.phase = match self.is_complete(protocol, announced) {
            true => Phase::Over(self.outcome, state.id().clone()),
            false => Phase::Over(outcome, Text::from_static(outcome.as_str())),
        };
    }

    /// The mark of the only agent that is bound; none if there are others, or an expression.
    pub(crate) fn mark(&self) -> Option<u64> {
        match &self.bindings[..] {
            [(_, agent)] if agent.pattern.is_none() => Some(mark(&agent.name)),
            _ => None,
        }
    }

    /// Whether the agent plays a role here, that of the initiator aside.
    #[inline]
    pub(crate) fn involves(&self, name: &str) -> bool {
        self.bindings.iter().any(|(_, agent)| agent.is(name))
    }

    /// Whether it may end here: nothing must follow, in sub-conversations neither.
    pub(crate) fn is_complete(&self, protocol: &Protocol, announced: Option<usize>) -> bool {
        let state = protocol.state(self.state);
        match self.phase {
            Phase::Over(..) => true,
            Phase::Cancelling(_) => false,
            Phase::Running if !state.is_final() => false,
            Phase::Running if state.subprotocols().is_empty() => true,
            Phase::Running => {
                let proxied = state
                    .subprotocols()
                    .iter()
                    .any(|sub| sub.proxied_to().is_some());
                self.subs
                    .iter()
                    .all(|sub| !sub.awaited || sub.machine.is_complete(None))
                    && announced.is_none_or(|announced| self.subs.len() == announced)
                    && (!proxied || self.replies > 0 || !self.has_answers())
            }
        }
    }

    /// Whether nothing can follow.
    pub(crate) fn is_closed(&self, protocol: &Protocol, announced: Option<usize>) -> bool {
        let state = protocol.state(self.state);
        let goes_on = !state.transitions().is_empty() || !state.subprotocols().is_empty();
        match self.phase {
            Phase::Over(..) => true,
            _ => !goes_on && self.is_complete(protocol, announced),
        }
    }

    /// How it ended, if it may.
    pub(crate) fn ended(&self, protocol: &Protocol, announced: Option<usize>) -> Option<Outcome> {
        match self.phase {
            Phase::Over(outcome, _) => Some(outcome),
            _ => self
                .is_complete(protocol, announced)
                .then_some(self.outcome),
        }
    }

    /// Whether there is a sub-conversation whose answer can be passed on.
    pub(crate) fn has_answers(&self) -> bool {
        let mut subs = self.subs.iter();
        subs.any(|sub| fipa_protocol::canonical_name(sub.machine.protocol().name()) != "inform")
    }

    /// The name of the state, default ones included.
    pub(crate) fn label(&self, protocol: &Protocol) -> Text {
        match &self.phase {
            Phase::Running => protocol.state(self.state).id().clone(),
            Phase::Cancelling(_) => Text::from_static("cancelling"),
            Phase::Over(_, label) => label.clone(),
        }
    }
}
