//! What a message would do, found out without doing it.

use std::sync::Arc;

use fipa_acl::{AgentId, Performative, Text};
use fipa_protocol::{Keeping, Protocol, Rules, StateId, canonical_name};

use crate::branch::{Branch, mark};
use crate::machine::{Context, Machine, Said};
use crate::verdict::Rule;

/// Participants of one conversation, and sub-conversations of one of them.
pub(crate) const MAX_BRANCHES: usize = 10_000;

/// What is to be done for each branch that a message concerns.
#[derive(Debug)]
pub(crate) struct Plan<'a> {
    pub(crate) steps: Vec<Step<'a>>,
}

#[derive(Debug)]
pub(crate) struct Step<'a> {
    pub(crate) place: Place,
    /// Those of the receivers whom it concerns.
    pub(crate) receivers: &'a [AgentId],
    pub(crate) go: Go<'a>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Place {
    Branch(usize),
    /// A copy of this branch, for an agent that its expression takes.
    Split(usize),
    New,
}

#[derive(Debug)]
pub(crate) enum Go<'a> {
    /// Take the transition of this number out of this state.
    Take {
        from: StateId,
        transition: usize,
    },
    /// Count an answer that was passed on.
    Proxied,
    Cancel,
    Cancelled,
    CancelFailed,
    NotUnderstood,
    Failure,
    /// It concerns nobody in particular.
    Nothing,
    Sub(usize, Box<Plan<'a>>),
    OpenSub {
        protocol: Arc<Protocol>,
        transition: usize,
        awaited: bool,
    },
}

/// Why a message is none of the protocol.
#[derive(Debug)]
pub(crate) struct Wrong {
    pub(crate) rule: Rule,
    /// The branch that is nearest to it.
    pub(crate) branch: Option<usize>,
    /// The sub-conversation that it is about.
    pub(crate) sub: Option<(usize, Box<Wrong>)>,
    /// The receiver that is wrong.
    pub(crate) receiver: Option<Text>,
    /// Whether all sub-conversations that were announced have begun.
    pub(crate) too_many: bool,
}

/// No plan, and why.
pub(crate) enum NoPlan {
    Wrong(Wrong),
    /// The protocol that it bears is not known.
    Unknown,
}

impl Wrong {
    pub(crate) fn rule(rule: Rule) -> Wrong {
        Wrong {
            rule,
            branch: None,
            sub: None,
            receiver: None,
            too_many: false,
        }
    }

    pub(crate) fn at(mut self, branch: usize) -> Wrong {
        self.branch = Some(branch);
        self
    }

    /// How near it came to being right.
    pub(crate) fn nearness(&self) -> usize {
        match self.rule {
            Rule::Ended | Rule::Deadline => 0,
            Rule::Performative => 1,
            Rule::Sender => 2,
            Rule::Receiver => 3,
            _ => 4,
        }
    }
}

impl From<Wrong> for NoPlan {
    fn from(wrong: Wrong) -> NoPlan {
        NoPlan::Wrong(wrong)
    }
}

/// The transition that opens a conversation: of the first message, only the act is looked at.
pub(crate) fn opening(protocol: &Protocol, act: &Performative) -> Option<usize> {
    let transitions = protocol.state(protocol.initial()).transitions();
    transitions
        .iter()
        .position(|t| t.is_declared() && t.performatives().contains(act))
}

impl Machine {
    pub(crate) fn plan<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
    ) -> Result<Plan<'a>, NoPlan> {
        if said.foreign {
            return self.plan_foreign(context, said);
        }
        let all = &said.message.receiver[..];
        let steps = if self.protocol.keeping() == Keeping::ByConversation {
            vec![self.step(context, said, 0, all)?]
        } else if self.is_initiator(said.sender) {
            let mut steps = Vec::with_capacity(1);
            for receiver in self.relevant(context, said) {
                self.plan_receiver(context, said, receiver, &mut steps)?;
            }
            steps
        } else {
            vec![self.plan_sender(context, said, all)?]
        };
        Ok(Plan { steps })
    }

    fn step<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
        at: usize,
        receivers: &'a [AgentId],
    ) -> Result<Step<'a>, Wrong> {
        let branch = self
            .branches
            .get(at)
            .ok_or_else(|| Wrong::rule(Rule::Performative))?;
        let go = self
            .try_branch(context, said, branch, receivers)
            .map_err(|wrong| wrong.at(at))?;
        Ok(Step {
            place: Place::Branch(at),
            receivers,
            go,
        })
    }

    /// A message of the initiator concerns the branch of each receiver.
    fn plan_receiver<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
        receiver: &'a AgentId,
        steps: &mut Vec<Step<'a>>,
    ) -> Result<(), Wrong> {
        let receivers = std::slice::from_ref(receiver);
        let name = &receiver.name;
        match self.place_of(name) {
            Some(Place::Split(template)) if self.is_whole(template, name) => {
                // The expression again: all that came from it are meant.
                let mut wrong = None;
                let before = steps.len();
                for at in self.places_like(template) {
                    match self.step(context, said, at, receivers) {
                        Ok(step) => steps.push(step),
                        Err(error) => wrong = wrong.or(Some(error)),
                    }
                }
                match wrong {
                    Some(wrong) if steps.len() == before => Err(wrong),
                    _ => Ok(()),
                }
            }
            Some(place @ (Place::Split(at) | Place::Branch(at))) => {
                let step = self.step(context, said, at, receivers)?;
                steps.push(Step { place, ..step });
                Ok(())
            }
            Some(Place::New) | None => {
                steps.push(self.plan_newcomer(context, said, receivers)?);
                Ok(())
            }
        }
    }

    /// A receiver who has played no part yet: another role of the only branch, or one more
    /// participant.
    fn plan_newcomer<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
        receivers: &'a [AgentId],
    ) -> Result<Step<'a>, Wrong> {
        let first = self.step(context, said, 0, receivers);
        let wrong = match first {
            Ok(step) if self.branches.len() == 1 => return Ok(step),
            Ok(_) => Wrong::rule(Rule::Receiver).at(0),
            Err(wrong) => wrong,
        };
        match opening(&self.protocol, said.act()) {
            Some(transition) if self.widens && self.branches.len() < MAX_BRANCHES => {
                let from = self.protocol.initial();
                let go = Go::Take { from, transition };
                Ok(Step {
                    place: Place::New,
                    receivers,
                    go,
                })
            }
            _ => Err(wrong),
        }
    }

    /// A message of anybody else concerns the branch of its sender.
    fn plan_sender<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
        receivers: &'a [AgentId],
    ) -> Result<Step<'a>, Wrong> {
        if let Some(place @ (Place::Branch(at) | Place::Split(at))) = self.place_of(said.sender) {
            let step = self.step(context, said, at, receivers)?;
            return Ok(Step { place, ..step });
        }
        let mut nearest: Option<Wrong> = None;
        for at in 0..self.branches.len() {
            match self.step(context, said, at, receivers) {
                Ok(step) => return Ok(step),
                Err(wrong) => {
                    if nearest
                        .as_ref()
                        .is_none_or(|known| known.nearness() < wrong.nearness())
                    {
                        nearest = Some(wrong);
                    }
                }
            }
        }
        if self.is_failure_from_outside(said) {
            return Ok(Step {
                place: Place::Branch(0),
                receivers,
                go: Go::Nothing,
            });
        }
        Err(nearest.unwrap_or_else(|| Wrong::rule(Rule::Sender)))
    }

    /// A transport that could not deliver says so, and does not say to whom in a parameter.
    fn is_failure_from_outside(&self, said: Said<'_>) -> bool {
        let is_known = |name: &str| {
            self.branches
                .iter()
                .any(|branch| self.is_party(branch, name))
        };
        self.protocol.rules() == Rules::Fipa
            && *said.act() == Performative::Failure
            && said
                .message
                .receiver
                .iter()
                .all(|receiver| is_known(&receiver.name))
    }

    /// The branch in which an agent plays a part, of its own or by an expression.
    fn place_of(&self, name: &str) -> Option<Place> {
        let mut template = None;
        let mark = mark(name);
        let is_only = self.branches.len() == 1;
        for (at, branch) in self.branches.iter().enumerate() {
            let is_other = || {
                self.marks
                    .get(at)
                    .copied()
                    .flatten()
                    .is_some_and(|only| only != mark)
            };
            if !is_only && is_other() {
                continue;
            }
            for (_, agent) in &branch.bindings {
                if agent.pattern.is_none() && agent.name == *name {
                    return Some(Place::Branch(at));
                }
                if agent.is(name) || agent.name == *name {
                    template = template.or(Some(Place::Split(at)));
                }
            }
        }
        template
    }

    /// Whether the name is the expression itself by which the branch was opened.
    fn is_whole(&self, template: usize, name: &Text) -> bool {
        let branch = self.branches.get(template);
        branch.is_some_and(|branch| branch.bindings.iter().any(|(_, agent)| agent.name == *name))
    }

    /// A branch that an expression opened, and all that came from it.
    fn places_like(&self, template: usize) -> impl Iterator<Item = usize> {
        let patterns = self
            .branches
            .get(template)
            .map_or(&[][..], |branch| &branch.bindings);
        let is_like = move |branch: &Branch| {
            branch
                .bindings
                .iter()
                .any(|(_, agent)| patterns.iter().any(|(_, pattern)| pattern.is(&agent.name)))
        };
        let branches = self.branches.iter().enumerate();
        branches
            .filter(move |(at, branch)| *at == template || is_like(branch))
            .map(|(at, _)| at)
    }

    /// The name of the state that a plan leads to, of the first branch that it concerns.
    pub(crate) fn label_after(&self, context: Context<'_>, plan: &Plan<'_>) -> Text {
        let Some(step) = plan.steps.first() else {
            return self
                .played()
                .next()
                .map_or_else(Text::default, |branch| branch.label(&self.protocol));
        };
        let branch = match step.place {
            Place::Branch(at) | Place::Split(at) => self.branches.get(at),
            Place::New => None,
        };
        let stays = |id: StateId| self.protocol.state(id).id().clone();
        let id = branch.map_or(self.protocol.initial(), |branch| {
            branch.view(&self.protocol, context.now).id
        });
        match &step.go {
            Go::Take { from, transition } => {
                let taken = self.protocol.state(*from).transitions().get(*transition);
                taken.map_or_else(|| stays(id), |t| stays(t.target()))
            }
            Go::Proxied | Go::CancelFailed => stays(id),
            Go::Nothing => {
                let mut played = self.played();
                played
                    .next()
                    .map_or_else(|| stays(id), |branch| branch.label(&self.protocol))
            }
            Go::Cancel => Text::from_static("cancelling"),
            Go::Cancelled => Text::from_static("cancelled"),
            Go::NotUnderstood => Text::from_static("not-understood"),
            Go::Failure => Text::from_static("failed"),
            Go::Sub(number, inner) => match branch.and_then(|branch| branch.subs.get(*number)) {
                Some(sub) => {
                    let state = sub.machine.label_after(context, inner);
                    Text::from(format!("{}/{state}", sub.machine.protocol().name()))
                }
                None => stays(id),
            },
            Go::OpenSub {
                protocol,
                transition,
                ..
            } => {
                let first = protocol
                    .state(protocol.initial())
                    .transitions()
                    .get(*transition);
                let state = first.map(|t| protocol.state(t.target()).id().as_str());
                Text::from(format!("{}/{}", protocol.name(), state.unwrap_or_default()))
            }
        }
    }
}

/// Whether messages of a protocol may bear this name.
pub(crate) fn is_name_of(protocol: &Protocol, bears: &str) -> bool {
    if *protocol.name() == *bears {
        return true;
    }
    let bears = canonical_name(bears);
    let mut names = std::iter::once(protocol.name()).chain(protocol.aliases());
    names.any(|name| canonical_name(name) == bears)
}
