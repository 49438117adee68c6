//! What a protocol should be beyond its form: every state can be reached and left, every message
//! leads to one state, every role has something to say.

use std::collections::HashSet;

use crate::diagnostic::Code;
use crate::loader::{Parts, Report};
use crate::pattern::Pattern;
use crate::protocol::{Party, Protocol, State, StateId, Transition};
use crate::suggestion::suggestion;

pub(crate) fn check(parts: &Parts, report: &mut Report) {
    let protocol = &parts.protocol;
    let reached = reached_from(protocol, protocol.initial());
    unreachable_states(protocol, &reached, report);
    dead_ends(parts, &reached, report);
    for (_, state) in protocol.states() {
        ambiguous_transitions(protocol, state, report);
    }
    unused_roles(parts, report);
    misspelt_roles(protocol, report);
}

fn unreachable_states(protocol: &Protocol, reached: &HashSet<StateId>, report: &mut Report) {
    for (id, state) in protocol.states() {
        let Some(position) = state.position else {
            continue;
        };
        // One without an id cannot be named, which is told already.
        if !reached.contains(&id) && !state.id.is_empty() {
            report.warning(
                position,
                Code::UnreachableState,
                format!("no message leads to the state {}", state.id),
                "add a transition to it, or take it out",
            );
        }
    }
}

/// A state that nothing leads out of is an error. One from which only circles lead on is a warning:
/// a subscription, say, may go on until it is cancelled.
fn dead_ends(parts: &Parts, reached: &HashSet<StateId>, report: &mut Report) {
    let protocol = &parts.protocol;
    let is_stuck =
        |state: &State| !state.is_final && state.transitions.iter().all(|t| !t.is_declared());
    let is_broken = |id| parts.broken.contains(&id);
    for (_, state) in protocol.states().filter(|(id, _)| !is_broken(*id)) {
        let position = state
            .position
            .filter(|_| is_stuck(state) && state.on_timeout.is_none());
        if let Some(position) = position {
            report.error(
                position,
                Code::DeadEnd,
                format!(
                    "the state {} is not final, and no message leads out of it",
                    state.id
                ),
                "declare it final, or add a transition",
            );
        }
    }
    let ends = protocol.states().filter(|(id, state)| {
        is_broken(*id) || state.is_declared() && (state.is_final || is_stuck(state))
    });
    let ends: HashSet<StateId> = ends.map(|(id, _)| id).collect();
    if ends.is_empty() {
        report.warning(
            parts.root,
            Code::DeadEnd,
            "no state is final",
            "declare final=\"yes\" where a conversation may end",
        );
        return;
    }
    for (id, state) in protocol.states().filter(|(id, _)| reached.contains(id)) {
        let Some(position) = state.position else {
            continue;
        };
        if reached_from(protocol, id).is_disjoint(&ends) {
            report.warning(
                position,
                Code::DeadEnd,
                format!(
                    "no messages lead from the state {} to a final one",
                    state.id
                ),
                "add a transition, or declare it final if a conversation may end there",
            );
        }
    }
}

fn ambiguous_transitions(protocol: &Protocol, state: &State, report: &mut Report) {
    let own: Vec<&Transition> = state
        .transitions
        .iter()
        .filter(|t| t.is_declared() && !t.inherited)
        .collect();
    for (place, later) in own.iter().enumerate() {
        let earlier = own
            .iter()
            .take(place)
            .find(|earlier| is_ambiguous(protocol, earlier, later));
        let (Some(earlier), Some(position)) = (earlier, later.position) else {
            continue;
        };
        let target = |t: &Transition| protocol.state(t.target).id.clone();
        let guarded = earlier.guarded || later.guarded;
        let advice = match guarded {
            true => "conditions are not evaluated, and the first one is taken",
            false => "the first one is taken; let the acts or the roles differ",
        };
        let at = earlier
            .position
            .map_or_else(String::new, |at| format!(" at {at}"));
        let message = format!(
            "in the state {}, {} leads to {} here, and to {} by the transition{at}",
            state.id,
            later.performatives,
            target(later),
            target(earlier),
        );
        report.warning(position, Code::AmbiguousTransition, message, advice);
    }
}

/// Whether both take the same message. What is taken by its name first and by a wider expression
/// afterwards is meant like that.
fn is_ambiguous(protocol: &Protocol, earlier: &Transition, later: &Transition) -> bool {
    let meet = |a, b| parties_meet(protocol, a, b);
    earlier.target != later.target
        && earlier.performatives.overlaps(&later.performatives)
        && !earlier.performatives.is_within_more(&later.performatives)
        && meet(earlier.from, later.from)
        && meet(earlier.to, later.to)
}

fn parties_meet(protocol: &Protocol, a: Party, b: Party) -> bool {
    let is_wide = |party| match party {
        Party::Any => true,
        Party::Own => false,
        Party::Role(id) => protocol
            .role(id)
            .is_some_and(|role| role.open || role.takes("")),
    };
    a == b || is_wide(a) || is_wide(b)
}

fn unused_roles(parts: &Parts, report: &mut Report) {
    let protocol = &parts.protocol;
    let transitions = protocol.states.iter().flat_map(|state| &state.transitions);
    let used: HashSet<Party> = transitions.flat_map(|t| [t.from, t.to]).collect();
    let mut told = HashSet::new();
    for (name, position) in &parts.mentioned {
        let place = protocol
            .roles
            .iter()
            .position(|role| role.name == *name.as_str());
        let is_used = used
            .iter()
            .any(|party| matches!(party, Party::Role(id) if Some(usize::from(id.0)) == place));
        // It is played by whoever has such a name.
        let needs_none = Pattern::is_meant(name);
        if !is_used && !needs_none && place.is_some() && told.insert(name) {
            report.warning(
                *position,
                Code::UnusedRole,
                format!("no transition is from or to the role {name}"),
                "use it, take it out, or name the role that is meant",
            );
        }
    }
}

/// A role of a single transition whose name is almost that of another one.
fn misspelt_roles(protocol: &Protocol, report: &mut Report) {
    let states = protocol.states.iter();
    let own = states.flat_map(|state| state.transitions.iter().filter(|t| !t.inherited));
    let declared: Vec<&Transition> = own.filter(|t| t.is_declared()).collect();
    for (at, role) in protocol.roles.iter().enumerate() {
        let is_it = |party| matches!(party, Party::Role(id) if usize::from(id.0) == at);
        let mut uses = declared.iter().filter(|t| is_it(t.from) || is_it(t.to));
        let (Some(only), None) = (uses.next(), uses.next()) else {
            continue;
        };
        let name = role.name.as_str();
        let others = protocol.roles.iter().map(|other| other.name.as_str());
        // Roles that are numbered are meant to be alike.
        let is_other = |other: &&str| *other != name && letters(other) != letters(name);
        if let (Some(meant), Some(position)) =
            (suggestion(name, others.filter(is_other)), only.position)
            && name.chars().count() > 3
        {
            report.warning(
                position,
                Code::UnusedRole,
                format!("only this transition is from or to the role {name}"),
                format!("did you mean {meant}?"),
            );
        }
    }
}

fn letters(name: &str) -> String {
    name.chars().filter(|letter| !letter.is_numeric()).collect()
}

/// The states that messages or time-outs lead to, this one included.
fn reached_from(protocol: &Protocol, start: StateId) -> HashSet<StateId> {
    let mut reached = HashSet::from([start]);
    let mut waiting = vec![start];
    while let Some(id) = waiting.pop() {
        let state = protocol.state(id);
        let next = state
            .transitions
            .iter()
            .filter(|t| t.is_declared())
            .map(|t| t.target);
        for next in next.chain(state.on_timeout) {
            if reached.insert(next) {
                waiting.push(next);
            }
        }
    }
    reached
}
