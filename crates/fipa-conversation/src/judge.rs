//! What a message does in one branch: the transition that takes it, a default one, or why none
//! does.

use fipa_acl::{AgentId, Expression, Performative, Text};
use fipa_protocol::{Outcome, Party, Pattern, Rules};

use crate::branch::{Branch, Phase, View};
use crate::machine::{Context, Machine, Said};
use crate::plan::{Go, Wrong};
use crate::verdict::Rule;

impl Machine {
    /// What the message does in this branch.
    pub(crate) fn try_branch<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
        branch: &Branch,
        receivers: &'a [AgentId],
    ) -> Result<Go<'a>, Wrong> {
        let view = branch.view(&self.protocol, context.now);
        match view.phase {
            Phase::Over(Outcome::TimedOut, _) => return Err(Wrong::rule(Rule::Deadline)),
            Phase::Over(..) => return Err(Wrong::rule(Rule::Ended)),
            Phase::Cancelling(tag) => {
                if let Some(go) =
                    self.cancel_answer(context, said, branch, &view, receivers, tag.as_ref())
                {
                    return Ok(go);
                }
            }
            Phase::Running => {}
        }
        let wrong = match self.take(context, said, branch, &view, receivers, true) {
            Ok(go) => return Ok(go),
            Err(wrong) => wrong,
        };
        if !said.foreign {
            if self.is_proxied(context, said, branch, &view, receivers) {
                return Ok(Go::Proxied);
            }
            if let Some(go) = self.default_of(context, said, branch, &view, receivers) {
                return Ok(go);
            }
        }
        let is_closed = view.state.is_final() && view.state.transitions().is_empty();
        if is_closed && view.state.subprotocols().is_empty() {
            return Err(Wrong::rule(Rule::Ended));
        }
        Err(wrong)
    }

    /// The first transition that takes the message; else how near one came.
    fn take<'a>(
        &self,
        context: Context<'_>,
        said: Said<'_>,
        branch: &Branch,
        view: &View<'_>,
        receivers: &[AgentId],
        declared: bool,
    ) -> Result<Go<'a>, Wrong> {
        let mut nearest = Wrong::rule(Rule::Performative);
        for (at, t) in view.state.transitions().iter().enumerate() {
            if t.is_declared() != declared
                || said.foreign && !t.takes_any_protocol()
                || !t.performatives().contains(said.act())
            {
                continue;
            }
            let plays = |party, name: &Text| self.plays(context, branch, party, name);
            let stranger = receivers
                .iter()
                .find(|receiver| !plays(t.to(), &receiver.name));
            let wrong = match (plays(t.from(), said.sender), stranger) {
                (false, _) => Wrong::rule(Rule::Sender),
                (true, Some(stranger)) => Wrong {
                    receiver: Some(stranger.name.clone()),
                    ..Wrong::rule(Rule::Receiver)
                },
                (true, None) => match self.mismatch(said, branch) {
                    Some(rule) => Wrong::rule(rule),
                    None => {
                        return Ok(Go::Take {
                            from: view.id,
                            transition: at,
                        });
                    }
                },
            };
            if wrong.nearness() > nearest.nearness() {
                nearest = wrong;
            }
        }
        Err(nearest)
    }

    /// Whether an agent may speak or be spoken to as this party.
    pub(crate) fn plays(
        &self,
        context: Context<'_>,
        branch: &Branch,
        party: Party,
        name: &Text,
    ) -> bool {
        match party {
            Party::Any => self.protocol.rules() == Rules::FipaAcl || self.is_party(branch, name),
            Party::Own => match context.own {
                Some(own) => *name == *own,
                None => self.is_party(branch, name),
            },
            Party::Role(id) => {
                let Some(role) = self.protocol.role(id) else {
                    return false;
                };
                if role.is_open() {
                    return !self.is_party(branch, name);
                }
                if self.initiator_role == Some(id) {
                    return self.is_initiator(name) || role.takes(name);
                }
                let mut bound = branch
                    .bindings
                    .iter()
                    .filter(|(role, _)| *role == id)
                    .peekable();
                role.takes(name)
                    || bound.peek().is_none() && !Pattern::is_meant(role.name())
                    || bound.any(|(_, agent)| agent.is(name))
            }
        }
    }

    /// The rule of those that a protocol may opt in to that the message breaks.
    fn mismatch(&self, said: Said<'_>, branch: &Branch) -> Option<Rule> {
        let (matching, message) = (self.protocol.matching(), said.message);
        if matching.language && message.language != self.language {
            return Some(Rule::Language);
        }
        if matching.ontology && message.ontology != self.ontology {
            return Some(Rule::Ontology);
        }
        let other = usize::from(self.is_initiator(said.sender));
        let tag = branch.tags.get(other).and_then(Option::as_ref);
        let is_wrong = matching.in_reply_to
            && tag.is_some_and(|tag| message.in_reply_to.as_ref() != Some(tag));
        is_wrong.then_some(Rule::InReplyTo)
    }

    /// The answer to a cancel, told from one of the nominal flow by its tag if there is one.
    fn cancel_answer<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
        branch: &Branch,
        view: &View<'_>,
        receivers: &'a [AgentId],
        tag: Option<&Expression>,
    ) -> Option<Go<'a>> {
        let go = match said.act() {
            Performative::Inform => Go::Cancelled,
            Performative::Failure => Go::CancelFailed,
            _ => return None,
        };
        let to_initiator = receivers
            .iter()
            .all(|receiver| self.is_initiator(&receiver.name));
        if said.foreign || !branch.involves(said.sender) || !to_initiator {
            return None;
        }
        let is_tagged = tag.is_none() || said.message.in_reply_to.as_ref() == tag;
        let is_nominal = || {
            self.take(context, said, branch, view, receivers, true)
                .is_ok()
        };
        (is_tagged || !is_nominal()).then_some(go)
    }

    /// Whether it is an answer of a sub-conversation, passed on: one, of those that have answers.
    fn is_proxied(
        &self,
        context: Context<'_>,
        said: Said<'_>,
        branch: &Branch,
        view: &View<'_>,
        receivers: &[AgentId],
    ) -> bool {
        let plays = |party, name: &Text| self.plays(context, branch, party, name);
        let mut proxied = view
            .state
            .subprotocols()
            .iter()
            .filter_map(|sub| Some((sub.from(), sub.proxied_to()?)));
        branch.replies == 0
            && branch.has_answers()
            && proxied.any(|(from, to)| {
                plays(from, said.sender)
                    && receivers.iter().all(|receiver| plays(to, &receiver.name))
            })
    }

    fn default_of<'a>(
        &self,
        context: Context<'a>,
        said: Said<'a>,
        branch: &Branch,
        view: &View<'_>,
        receivers: &'a [AgentId],
    ) -> Option<Go<'a>> {
        if self.protocol.rules() == Rules::FipaAcl {
            return self
                .take(context, said, branch, view, receivers, false)
                .ok();
        }
        if view.state.is_final() && view.state.transitions().is_empty() {
            return None;
        }
        let from_party = self.is_party(branch, said.sender);
        if !receivers
            .iter()
            .all(|receiver| self.is_party(branch, &receiver.name))
        {
            return None;
        }
        match said.act() {
            Performative::NotUnderstood if from_party => Some(Go::NotUnderstood),
            Performative::Cancel if self.is_initiator(said.sender) => Some(Go::Cancel),
            // Of several, it is not known whom a transport could not reach.
            Performative::Failure if from_party || self.branches.len() == 1 => Some(Go::Failure),
            _ => None,
        }
    }
}
