//! Violations in words: what was wrong, and what would have been right.

use std::fmt::Write;

use fipa_acl::Text;
use fipa_protocol::{Party, Protocol, State, Transition};

use crate::branch::{Branch, Phase};
use crate::machine::{Context, Machine, Said};
use crate::plan::Wrong;
use crate::verdict::{Expected, Rule, Violation};

/// A message that begins no conversation of this protocol.
pub(crate) fn no_opening(protocol: &Protocol, said: Said<'_>) -> Violation {
    let state = protocol.state(protocol.initial());
    let expected = expected_of(protocol, state);
    let mut text = format!(
        "{} begins no conversation of {}",
        said.act(),
        protocol.name()
    );
    add_expected(&mut text, &expected, &|role| role.to_owned());
    Violation {
        rule: Rule::Opening,
        state: state.id().clone(),
        text,
        expected,
    }
}

/// A message without a sender, or without receivers.
pub(crate) fn incomplete(rule: Rule, state: Text) -> Violation {
    let text = match rule {
        Rule::Sender => "the message says no sender",
        _ => "the message has no receiver",
    };
    Violation {
        rule,
        state,
        text: text.to_owned(),
        expected: Vec::new(),
    }
}

/// A message with another value of what stays the same in a conversation.
pub(crate) fn other(
    rule: Rule,
    state: Text,
    found: Option<&str>,
    known: Option<&str>,
) -> Violation {
    let shown =
        |value: Option<&str>| value.map_or_else(|| "none".to_owned(), |value| format!("{value:?}"));
    let text = format!(
        "the {rule} is {}, that of this conversation is {}",
        shown(found),
        shown(known)
    );
    Violation {
        rule,
        state,
        text,
        expected: Vec::new(),
    }
}

impl Machine {
    pub(crate) fn explain(&self, context: Context<'_>, said: Said<'_>, wrong: &Wrong) -> Violation {
        let at = wrong.branch.unwrap_or(0);
        let Some(branch) = self.branches.get(at) else {
            return no_opening(&self.protocol, said);
        };
        if let Some((number, inner)) = &wrong.sub
            && let Some(sub) = branch.subs.get(*number)
        {
            return sub.machine.explain(
                context,
                Said {
                    foreign: false,
                    ..said
                },
                inner,
            );
        }
        let view = branch.view(&self.protocol, context.now);
        let is_over = matches!(view.phase, Phase::Over(..));
        let expected = match is_over {
            true => Vec::new(),
            false => expected_of(&self.protocol, view.state),
        };
        let label = match view.phase {
            Phase::Running => view.state.id().clone(),
            Phase::Over(_, label) => label.clone(),
            Phase::Cancelling(_) => branch.label(&self.protocol),
        };
        let mut text = self.sentence(said, branch, view.state, &label, wrong);
        add_expected(&mut text, &expected, &|role| self.with_agents(branch, role));
        Violation {
            rule: wrong.rule,
            state: label,
            text,
            expected,
        }
    }

    fn sentence(
        &self,
        said: Said<'_>,
        branch: &Branch,
        state: &State,
        label: &str,
        wrong: &Wrong,
    ) -> String {
        let (sender, act) = (said.sender, said.act());
        let place = format!("in the state {label} of {}", self.protocol.name());
        let transition = state
            .transitions()
            .iter()
            .find(|t| t.performatives().contains(act));
        let role = |party: fn(&Transition) -> Party| match transition {
            Some(t) => self.with_agents(branch, self.protocol.party_name(party(t))),
            None => "a party of this conversation".to_owned(),
        };
        match wrong.rule {
            Rule::Sender => format!(
                "{sender} may not send {act} {place}: it is not {}",
                role(Transition::from)
            ),
            Rule::Receiver => {
                let receiver = wrong
                    .receiver
                    .as_ref()
                    .map_or("nobody", |receiver| receiver.as_str());
                format!(
                    "{act} may not go to {receiver} {place}: it is not {}",
                    role(Transition::to)
                )
            }
            Rule::Protocol => {
                let bears = said
                    .message
                    .protocol
                    .as_ref()
                    .map_or("none", |name| name.as_str());
                format!("the protocol {bears} has no place {place}")
            }
            Rule::SubProtocol => {
                let bears = said
                    .message
                    .protocol
                    .as_ref()
                    .map_or("none", |name| name.as_str());
                match wrong.too_many {
                    true => format!(
                        "{sender} may not begin another conversation of {bears} {place}: all that were announced have begun"
                    ),
                    false => format!(
                        "{sender} may not begin a conversation of {bears} with {act} {place}"
                    ),
                }
            }
            Rule::Deadline => {
                format!("{act} of {sender} came too late: the time to answer has passed {place}")
            }
            Rule::Ended => format!("{act} of {sender} came after the end {place}"),
            Rule::InReplyTo => {
                let tag = branch
                    .tags
                    .get(usize::from(self.is_initiator(sender)))
                    .and_then(Option::as_ref);
                let tag = tag.map_or_else(String::new, ToString::to_string);
                format!("{act} of {sender} is not in reply to {tag:?} {place}")
            }
            Rule::Language => {
                format!("{act} of {sender} is in another language than the first message, {place}")
            }
            Rule::Ontology => {
                format!("{act} of {sender} is of another ontology than the first message, {place}")
            }
            _ => format!("{sender} may not send {act} {place}"),
        }
    }

    /// A role, and who plays it.
    fn with_agents(&self, branch: &Branch, role: &str) -> String {
        let place = self
            .protocol
            .roles()
            .iter()
            .position(|known| *known.name() == *role);
        let is_initiator = place.is_some() && place == self.initiator_role.map(|id| id.index());
        let bound = branch
            .bindings
            .iter()
            .filter(|(id, _)| Some(id.index()) == place)
            .map(|(_, agent)| &agent.name);
        let opened = std::iter::once(&self.initiator);
        let opened = opened.chain(self.stand_ins.iter().map(|agent| &agent.name));
        let agents = opened.filter(|_| is_initiator).chain(bound);
        let mut names: Vec<&str> = agents.map(Text::as_str).take(MANY + 1).collect();
        match names.len() {
            0 if role == ".*" => "anybody".to_owned(),
            0 => role.to_owned(),
            1 if names == [role] => role.to_owned(),
            shown => {
                if shown > MANY {
                    names.truncate(MANY);
                    names.push("…");
                }
                format!("{role} ({})", names.join(", "))
            }
        }
    }
}

/// Names of agents that are listed.
const MANY: usize = 4;

/// What the nominal flow has in a state.
fn expected_of(protocol: &Protocol, state: &State) -> Vec<Expected> {
    let role = |party| match party {
        Party::Role(id) => protocol.role(id).map(|role| role.name().clone()),
        _ => None,
    };
    let name = |party| role(party).unwrap_or_else(|| Text::from(protocol.party_name(party)));
    let mut expected = Vec::new();
    for t in state.transitions().iter().filter(|t| t.is_declared()) {
        for performative in t.performatives().names() {
            let one = Expected {
                performative: performative.clone(),
                from: name(t.from()),
                to: name(t.to()),
            };
            if !expected.contains(&one) {
                expected.push(one);
            }
        }
    }
    expected
}

/// `; expected: agree, refuse or inform from B (b@r2) to A (a@r1)`, or that nothing is.
fn add_expected(text: &mut String, expected: &[Expected], role: &dyn Fn(&str) -> String) {
    let mut groups: Vec<(&Text, &Text, Vec<&str>)> = Vec::new();
    for one in expected {
        let act = match one.performative.as_str() {
            ".*" => "any act",
            act => act,
        };
        match groups.last_mut() {
            Some((from, to, acts)) if *from == &one.from && *to == &one.to => acts.push(act),
            _ => groups.push((&one.from, &one.to, vec![act])),
        }
    }
    text.push_str("; expected: ");
    if groups.is_empty() {
        text.push_str("nothing more");
    }
    for (place, (from, to, acts)) in groups.iter().enumerate() {
        let between = if place > 0 { "; " } else { "" };
        let (from, to) = (role(from), role(to));
        // Writing to a string cannot fail.
        let _ = write!(text, "{between}{} from {from} to {to}", listed(acts));
    }
}

fn listed(acts: &[&str]) -> String {
    match acts.split_last() {
        Some((last, [])) => (*last).to_owned(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    }
}
