//! The default transitions of fipa_acl, as its monitor generates them when it loads a file.

use std::collections::HashSet;

use fipa_acl::{Performative, Text};

use crate::performatives::Performatives;
use crate::protocol::{Outcome, Party, State, StateId, Transition};

/// Octets that the expressions below need at most when compiled.
const MAX_PATTERN: usize = 1 << 16;

/// The states that are added, by their distance from the first of them.
const ADDED: [(&str, Option<Outcome>); 5] = [
    ("not-understood", Some(Outcome::Failed)),
    ("cancelling", None),
    ("cancelled", Some(Outcome::Cancelled)),
    ("cancel-failed", Some(Outcome::Failed)),
    ("failed", Some(Outcome::Failed)),
];

/// Adds them to every state that is not final, or holds subprotocols: for each transition that the
/// file has, `not-understood` and `cancel` both ways and `failure` from anybody to the agent
/// itself. A transition that takes `not-understood` itself has none of the three; one that takes
/// `cancel` only the first.
pub(super) fn add(states: &mut Vec<State>) {
    let Ok(first) = u16::try_from(states.len()) else {
        return;
    };
    let id = |offset: u16| StateId(first.saturating_add(offset));
    for state in states.iter_mut() {
        if !state.is_final || !state.subprotocols.is_empty() {
            let added = defaults_of(&state.transitions, id);
            state.transitions.extend(added);
        }
    }
    for (name, outcome) in ADDED {
        states.push(State {
            id: Text::from_static(name),
            is_final: outcome.is_some(),
            outcome,
            timeout: None,
            on_timeout: None,
            transitions: Vec::new(),
            subprotocols: Vec::new(),
            position: None,
        });
    }
    if let Some(cancelling) = states.get_mut(usize::from(first) + 1) {
        let any = Party::Any;
        let ends = [(Performative::Inform, 2), (Performative::Failure, 3)];
        let ends = ends.map(|(act, target)| transition(&act, any, any, id(target)));
        cancelling.transitions.extend(ends.into_iter().flatten());
    }
}

fn defaults_of(declared: &[Transition], id: impl Fn(u16) -> StateId) -> Vec<Transition> {
    let mut wanted = Vec::new();
    for one in declared {
        let ways = [(one.from, one.to), (one.to, one.from)];
        if one.performatives.contains(&Performative::NotUnderstood) {
            continue;
        }
        wanted.extend(ways.map(|(from, to)| (Performative::NotUnderstood, from, to, 0)));
        if one.performatives.contains(&Performative::Cancel) {
            continue;
        }
        wanted.extend(ways.map(|(from, to)| (Performative::Cancel, from, to, 1)));
        if one.performatives.contains(&Performative::Failure) {
            continue;
        }
        wanted.push((Performative::Failure, Party::Any, Party::Own, 4));
    }
    // Many transitions of a state are between the same two roles.
    let mut seen = HashSet::new();
    wanted.retain(|one| seen.insert(one.clone()));
    let made = wanted
        .into_iter()
        .map(|(act, from, to, target)| transition(&act, from, to, id(target)));
    made.flatten().collect()
}

fn transition(act: &Performative, from: Party, to: Party, target: StateId) -> Option<Transition> {
    Some(Transition {
        performatives: Performatives::new(&[act.as_str()], MAX_PATTERN).ok()?,
        from,
        to,
        target,
        any_protocol: false,
        guarded: false,
        inherited: false,
        position: None,
    })
}
