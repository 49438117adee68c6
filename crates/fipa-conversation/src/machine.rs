//! A protocol as it is being played: the initiator, and a branch for each participant.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{AgentId, Expression, Message, Performative, Text};
use fipa_directory::Now;
use fipa_protocol::{Keeping, Library, Outcome, Party, Pattern, Protocol, RoleId};

use crate::branch::{Agent, Branch, Phase, Sub};
use crate::plan::{Go, MAX_BRANCHES, Place, Plan, Step};

/// Agents whose answers go to others are bound to their roles as well, up to so many.
const MAX_STAND_INS: usize = 8;

/// Receivers of one conversation that are read as expressions: each takes time to compile, and names
/// come from the network.
const MAX_EXPRESSIONS: usize = 32;

#[derive(Clone, Debug)]
pub(crate) struct Machine {
    pub(crate) protocol: Arc<Protocol>,
    /// By its name, whatever that looks like.
    pub(crate) initiator: Text,
    /// To whom answers for it go.
    pub(crate) stand_ins: Vec<Agent>,
    pub(crate) initiator_role: Option<RoleId>,
    pub(crate) language: Option<Expression>,
    pub(crate) ontology: Option<Expression>,
    pub(crate) branches: Vec<Branch>,
    /// Those of the branches, side by side: a branch is found without looking at the others.
    pub(crate) marks: Vec<Option<u64>>,
    /// How many agents are bound by an expression.
    pub(crate) expressions: usize,
    /// No deadline is sooner.
    pub(crate) soonest: Option<Duration>,
    /// How many sub-conversations there will be, if somebody said.
    pub(crate) announced: Option<usize>,
    /// Whether another opening message adds participants; else it begins another conversation.
    pub(crate) widens: bool,
}

/// What is known beside the message.
#[derive(Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) library: &'a Library,
    /// The agent whose monitor it is; none for one that watches others.
    pub(crate) own: Option<&'a str>,
    pub(crate) now: Now,
}

/// A message that says who sends it to whom.
#[derive(Clone, Copy)]
pub(crate) struct Said<'a> {
    pub(crate) message: &'a Message,
    pub(crate) sender: &'a Text,
    /// Whether it bears the name of another protocol.
    pub(crate) foreign: bool,
}

impl Said<'_> {
    pub(crate) fn act(&self) -> &Performative {
        &self.message.performative
    }
}

impl Machine {
    /// What the first message begins, by the transition that it takes.
    pub(crate) fn open(
        protocol: &Arc<Protocol>,
        context: Context<'_>,
        said: Said<'_>,
        transition: usize,
    ) -> Machine {
        let matching = protocol.matching();
        let message = said.message;
        let initiator_role = match protocol.initiator() {
            Party::Role(id)
                if !protocol
                    .role(id)
                    .is_some_and(|role| role.is_open() || role.takes("")) =>
            {
                Some(id)
            }
            _ => None,
        };
        let mut machine = Machine {
            protocol: Arc::clone(protocol),
            initiator: said.sender.detached(),
            stand_ins: Vec::new(),
            initiator_role,
            language: detached(message.language.as_ref().filter(|_| matching.language)),
            ontology: detached(message.ontology.as_ref().filter(|_| matching.ontology)),
            branches: Vec::new(),
            marks: Vec::new(),
            expressions: 0,
            soonest: None,
            announced: None,
            widens: true,
        };
        let from = protocol.initial();
        let step = |receivers| Step {
            place: Place::New,
            receivers,
            go: Go::Take { from, transition },
        };
        let steps = match protocol.keeping() {
            Keeping::ByConversation => vec![step(&message.receiver[..])],
            Keeping::ByParticipant => machine
                .relevant(context, said)
                .into_iter()
                .take(MAX_BRANCHES)
                .map(|r| step(std::slice::from_ref(r)))
                .collect(),
        };
        machine.apply(context, said, Plan { steps });
        machine
    }

    pub(crate) fn protocol(&self) -> &Arc<Protocol> {
        &self.protocol
    }

    #[inline]
    pub(crate) fn is_initiator(&self, name: &str) -> bool {
        self.initiator == *name || self.stand_ins.iter().any(|agent| agent.is(name))
    }

    /// Whether the agent plays any role in this branch.
    #[inline]
    pub(crate) fn is_party(&self, branch: &Branch, name: &str) -> bool {
        self.is_initiator(name) || branch.involves(name)
    }

    /// Does what was planned for this message.
    pub(crate) fn apply(&mut self, context: Context<'_>, said: Said<'_>, plan: Plan<'_>) {
        for step in plan.steps {
            let at = match step.place {
                Place::Branch(at) => at,
                Place::Split(at) => self.split(at, said, step.receivers),
                Place::New => {
                    self.branches.push(Branch::new(self.protocol.initial()));
                    self.branches.len() - 1
                }
            };
            self.go(context, said, at, step);
        }
    }

    fn go(&mut self, context: Context<'_>, said: Said<'_>, at: usize, step: Step<'_>) {
        let protocol = Arc::clone(&self.protocol);
        let Some(branch) = self.branches.get_mut(at) else {
            return;
        };
        branch.expire(&protocol, context.now);
        match step.go {
            Go::Take { from, transition } => {
                let state = protocol.state(from);
                // Several receivers may mean one branch, an expression and a name that it takes.
                let taken = state.transitions().get(transition);
                if let Some(t) = taken.filter(|_| branch.state == from) {
                    branch.outcome = outcome_of(said.act());
                    branch.enter(&protocol, context.now, t.target(), Some(said.message));
                    if protocol.state(t.target()).is_final() {
                        // There is nothing left to cancel.
                        branch.phase = Phase::Running;
                    }
                    self.bind(at, t.from(), said.sender);
                    for receiver in step.receivers {
                        self.bind(at, t.to(), &receiver.name);
                    }
                }
            }
            Go::Proxied => branch.replies += 1,
            Go::Cancel => {
                branch.phase = Phase::Cancelling(detached(said.message.reply_with.as_ref()));
            }
            Go::Cancelled => branch.end(Outcome::Cancelled, "cancelled"),
            Go::CancelFailed => branch.phase = Phase::Running,
            Go::NotUnderstood => branch.end(Outcome::Failed, "not-understood"),
            Go::Failure => branch.end(Outcome::Failed, "failed"),
            Go::Nothing => {}
            Go::Sub(sub, plan) => {
                if let Some(sub) = branch.subs.get_mut(sub) {
                    sub.machine.apply(
                        context,
                        Said {
                            foreign: false,
                            ..said
                        },
                        *plan,
                    );
                }
            }
            Go::OpenSub {
                protocol,
                transition,
                awaited,
            } => {
                let said = Said {
                    foreign: false,
                    ..said
                };
                let mut machine = Machine::open(&protocol, context, said, transition);
                machine.widens = false;
                branch.subs.push(Sub { machine, awaited });
            }
        }
        self.remember(at, said);
        self.remark(at);
    }

    /// Keeps what is looked at for all branches at once, after one has changed.
    fn remark(&mut self, at: usize) {
        let Some(branch) = self.branches.get(at) else {
            return;
        };
        if self.marks.len() <= at {
            self.marks.resize(at + 1, None);
        }
        if let Some(mark) = self.marks.get_mut(at) {
            *mark = branch.mark();
        }
        let subs = branch.subs.iter().filter_map(|sub| sub.machine.soonest);
        self.soonest = subs.chain(branch.deadline).chain(self.soonest).min();
    }

    /// A branch of its own for an agent that was addressed by an expression.
    fn split(&mut self, at: usize, said: Said<'_>, receivers: &[AgentId]) -> usize {
        let Some(template) = self.branches.get_mut(at) else {
            return at;
        };
        let mut branch = template.clone();
        template.split = true;
        branch.split = false;
        for (_, agent) in &mut branch.bindings {
            let names = std::iter::once(said.sender).chain(receivers.iter().map(|r| &r.name));
            let found = names
                .into_iter()
                .find(|name| agent.pattern.is_some() && agent.is(name));
            if let Some(name) = found {
                *agent = Agent::named(name);
            }
        }
        self.branches.push(branch);
        self.branches.len() - 1
    }

    /// Binds an agent to a role that is not bound to others.
    fn bind(&mut self, at: usize, party: Party, name: &Text) {
        let (Party::Role(id), Some(branch)) = (party, self.branches.get_mut(at)) else {
            return;
        };
        let Some(role) = self.protocol.role(id) else {
            return;
        };
        if self.initiator_role == Some(id) {
            return;
        }
        let mut bound = branch.bindings.iter().filter(|(bound, _)| *bound == id);
        let known = bound.any(|(_, agent)| agent.is(name));
        // An expression that takes any name is played by whoever comes; one that is a name, as each
        // role of fipa_acl is, is bound all the same.
        let is_wide = role.is_open() || Pattern::is_meant(role.name());
        if !known && !is_wide {
            let is_expression = Pattern::is_meant(name) && self.expressions < MAX_EXPRESSIONS;
            self.expressions += usize::from(is_expression);
            let agent = match is_expression {
                true => Agent::new(name),
                false => Agent::named(name),
            };
            branch.bindings.push((id, agent));
        }
    }

    /// What later messages are measured by: to whom answers go, and their tags.
    fn remember(&mut self, at: usize, said: Said<'_>) {
        let message = said.message;
        let by_initiator = self.is_initiator(said.sender);
        if by_initiator {
            for agent in &message.reply_to {
                if !self.is_initiator(&agent.name) && self.stand_ins.len() < MAX_STAND_INS {
                    self.stand_ins.push(Agent::named(&agent.name));
                }
            }
        }
        let Some(branch) = self.branches.get_mut(at) else {
            return;
        };
        if self.protocol.matching().in_reply_to
            && let Some(tag) = branch.tags.get_mut(usize::from(!by_initiator))
        {
            *tag = detached(message.reply_with.as_ref());
        }
        for agent in message.reply_to.iter().filter(|_| !by_initiator) {
            let mut bound = branch.bindings.iter();
            let role = bound.find(|(_, bound)| bound.is(said.sender));
            let role = role.map(|(role, _)| *role);
            if let Some(role) = role
                && !branch.involves(&agent.name)
                && branch.bindings.len() < MAX_STAND_INS
            {
                branch.bindings.push((role, Agent::named(&agent.name)));
            }
        }
    }

    /// The receivers that matter, each once: to an agent that was addressed together with others, it
    /// alone.
    pub(crate) fn relevant<'a>(&self, context: Context<'a>, said: Said<'a>) -> Vec<&'a AgentId> {
        let receivers = &said.message.receiver;
        if let [only] = &receivers[..] {
            return vec![only];
        }
        let mut seen = HashSet::new();
        let mut all: Vec<&AgentId> = receivers.iter().collect();
        all.retain(|receiver| seen.insert(receiver.name.as_str()));
        let Some(own) = context.own.filter(|own| *said.sender != **own) else {
            return all;
        };
        let mut expressions = 0;
        let mut is_own = |receiver: &&&AgentId| {
            let name = &receiver.name;
            expressions += usize::from(Pattern::is_meant(name));
            let is_read = Pattern::is_meant(name) && expressions <= MAX_EXPRESSIONS;
            *name == *own || is_read && Agent::new(name).is(own)
        };
        let found: Vec<&AgentId> = all.iter().filter(&mut is_own).copied().collect();
        if found.is_empty() { all } else { found }
    }

    /// The time has come: tells whether anything changed.
    pub(crate) fn expire(&mut self, now: Now) -> bool {
        let mut changed = false;
        for branch in &mut self.branches {
            changed |= branch.expire(&self.protocol, now);
            for sub in &mut branch.subs {
                changed |= sub.machine.expire(now);
            }
        }
        self.soonest = self.deadline();
        changed
    }

    /// When [`expire`](Self::expire) changes something.
    pub(crate) fn deadline(&self) -> Option<Duration> {
        let own = self.branches.iter().filter_map(|branch| branch.deadline);
        let subs = self
            .branches
            .iter()
            .flat_map(|branch| &branch.subs)
            .filter_map(|sub| sub.machine.deadline());
        own.chain(subs).min()
    }

    /// An agent is gone: tells whether anything changed.
    pub(crate) fn agent_gone(&mut self, name: &str) -> bool {
        let mut changed = false;
        if self.initiator == *name {
            for branch in &mut self.branches {
                branch.abandon(&self.protocol, self.announced, Outcome::PeerLost);
            }
            changed = true;
        }
        for branch in &mut self.branches {
            for sub in &mut branch.subs {
                changed |= sub.machine.agent_gone(name);
            }
            let bound = branch
                .bindings
                .iter()
                .filter(|(_, agent)| agent.name == *name);
            let roles: Vec<RoleId> = bound.map(|(role, _)| *role).collect();
            for role in roles {
                changed = true;
                // Where several play the role, the others go on.
                let others = branch
                    .bindings
                    .iter()
                    .filter(|(bound, agent)| *bound == role && agent.name != *name);
                if others.count() == 0 {
                    branch.abandon(&self.protocol, self.announced, Outcome::PeerLost);
                } else {
                    branch.bindings.retain(|(_, agent)| agent.name != *name);
                }
            }
        }
        for at in 0..self.branches.len() {
            self.remark(at);
        }
        changed
    }

    pub(crate) fn abandon(&mut self, outcome: Outcome) {
        for branch in &mut self.branches {
            branch.abandon(&self.protocol, self.announced, outcome);
        }
    }

    /// The branches that count: one that others came from does not.
    pub(crate) fn played(&self) -> impl Iterator<Item = &Branch> + Clone {
        self.branches.iter().filter(|branch| !branch.split)
    }

    pub(crate) fn is_complete(&self, announced: Option<usize>) -> bool {
        self.played()
            .all(|branch| branch.is_complete(&self.protocol, announced))
    }

    pub(crate) fn is_closed(&self) -> bool {
        // Until then, others of those whom an expression addressed may answer.
        self.branches.iter().all(|branch| match branch.split {
            true => branch.deadline.is_none(),
            false => branch.is_closed(&self.protocol, self.announced),
        })
    }

    /// How it ended, if it may: done if it was with any participant, else as with the worst.
    pub(crate) fn outcome(&self) -> Option<Outcome> {
        let ended = self
            .played()
            .map(|branch| branch.ended(&self.protocol, self.announced));
        let outcomes: Option<Vec<Outcome>> = ended.collect();
        let outcomes = outcomes?;
        if outcomes.contains(&Outcome::Done) {
            return Some(Outcome::Done);
        }
        let worst = [
            Outcome::PeerLost,
            Outcome::TimedOut,
            Outcome::Failed,
            Outcome::Cancelled,
            Outcome::Refused,
        ];
        worst.into_iter().find(|outcome| outcomes.contains(outcome))
    }
}

/// What an act that ends an interaction means, where the protocol does not say.
fn outcome_of(act: &Performative) -> Outcome {
    match act {
        Performative::Refuse | Performative::RejectProposal => Outcome::Refused,
        Performative::Failure | Performative::NotUnderstood => Outcome::Failed,
        Performative::Cancel => Outcome::Cancelled,
        _ => Outcome::Done,
    }
}

/// A copy that does not keep the buffer of the message alive.
fn detached(expression: Option<&Expression>) -> Option<Expression> {
    expression.map(|expression| match expression.as_str() {
        Some(text) => Expression::String(Text::from(text)),
        None => expression.clone(),
    })
}
