//! What is to be drawn of a protocol: states, and between two of them one arrow with all that it
//! takes.

use crate::protocol::{Outcome, Party, Protocol, Rules, State, StateId};

pub(super) struct Graph {
    pub(super) nodes: Vec<Node>,
    pub(super) edges: Vec<Edge>,
    pub(super) initial: usize,
}

pub(super) struct Node {
    pub(super) id: String,
    /// What takes place in the state, a line each.
    pub(super) notes: Vec<String>,
    pub(super) is_final: bool,
    pub(super) outcome: Option<Outcome>,
}

pub(super) struct Edge {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) says: Vec<Saying>,
}

/// Acts, and between whom.
pub(super) struct Saying {
    pub(super) acts: String,
    pub(super) parties: String,
}

impl Graph {
    pub(super) fn of(protocol: &Protocol) -> Graph {
        let declared = |id: StateId| protocol.state(id).is_declared();
        // Default states stand behind all others.
        let place = |id: StateId| usize::from(id.0);
        let states = protocol.states().filter(|(id, _)| declared(*id));
        let nodes = states
            .clone()
            .map(|(_, state)| node(protocol, state))
            .collect();
        let mut edges: Vec<Edge> = Vec::new();
        for (id, state) in states {
            for t in state.transitions.iter().filter(|t| t.is_declared()) {
                let parties = format!("{} → {}", party(protocol, t.from), party(protocol, t.to));
                add(
                    &mut edges,
                    (place(id), place(t.target)),
                    &t.performatives.to_string(),
                    parties,
                );
            }
            if let Some(next) = state.on_timeout {
                let when = state
                    .timeout
                    .map_or_else(|| "reply-by".to_owned(), |span| format!("{span:?}"));
                add(&mut edges, (place(id), place(next)), "time-out", when);
            }
        }
        Graph {
            nodes,
            edges,
            initial: place(protocol.initial),
        }
    }
}

fn node(protocol: &Protocol, state: &State) -> Node {
    let subs = state
        .subprotocols
        .iter()
        .map(|sub| match sub.expression.as_str() {
            ".*" => format!("sub-protocols of {}", party(protocol, sub.from)),
            name => format!("{name} of {}", party(protocol, sub.from)),
        });
    let timeout = state.timeout.filter(|_| state.on_timeout.is_none());
    let timeout = timeout.map(|span| format!("for {span:?} at most"));
    let mut notes: Vec<String> = subs.chain(timeout).collect();
    notes.dedup();
    Node {
        id: state.id.to_string(),
        notes,
        is_final: state.is_final,
        outcome: state.outcome,
    }
}

fn party(protocol: &Protocol, party: Party) -> &str {
    match protocol.party_name(party) {
        ".*" => "anybody",
        name => name,
    }
}

const OR: &str = " or ";

/// Adds to the arrow between two states, and to what is said between the same two there.
fn add(edges: &mut Vec<Edge>, (from, to): (usize, usize), acts: &str, parties: String) {
    let known = edges
        .iter_mut()
        .find(|edge| (edge.from, edge.to) == (from, to));
    let says = match known {
        Some(edge) => &mut edge.says,
        None => {
            edges.push(Edge {
                from,
                to,
                says: Vec::new(),
            });
            match edges.last_mut() {
                Some(edge) => &mut edge.says,
                None => return,
            }
        }
    };
    match says.iter_mut().find(|saying| saying.parties == parties) {
        Some(saying) => {
            // A state within another one may take itself what the outer one takes as well.
            let said = saying.acts.clone();
            let is_new = |act: &&str| said.split(OR).all(|known| known != *act);
            for act in acts.split(OR).filter(is_new) {
                saying.acts.push_str(OR);
                saying.acts.push_str(act);
            }
        }
        None => says.push(Saying {
            acts: acts.to_owned(),
            parties,
        }),
    }
}

/// What is not drawn.
pub(super) fn footnote(protocol: &Protocol) -> String {
    match protocol.rules {
        Rules::Fipa => format!(
            "Not drawn: cancel by {}, not-understood and failure, in every state that goes on.",
            party(protocol, protocol.initiator())
        ),
        Rules::FipaAcl => "Not drawn: the default transitions of fipa_acl.".to_owned(),
    }
}
