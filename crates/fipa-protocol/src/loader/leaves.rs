use std::collections::HashMap;

use super::Loader;
use super::collect::{RawState, Tree};
use crate::diagnostic::{Code, Position};
use crate::protocol::StateId;
use crate::suggestion::suggestion;
use crate::xml::{Attribute, Element};

/// The states in which something can be, and how the file's names lead to them.
pub(super) struct Leaves<'a> {
    pub(super) tree: &'a Tree<'a>,
    pub(super) by_id: HashMap<&'a str, usize>,
    pub(super) ids: HashMap<usize, StateId>,
}

impl Loader<'_> {
    /// The state that an attribute names; if there is none, the one that was likely meant, so that what
    /// follows from the mistake is not told as well.
    pub(super) fn target(
        &mut self,
        leaves: &Leaves<'_>,
        attribute: &Attribute,
        what: &str,
    ) -> Option<StateId> {
        let name = attribute.value.trim();
        if let Some(raw) = leaves.by_id.get(name) {
            return self.entry(leaves, *raw, attribute.position);
        }
        let meant = suggestion(name, leaves.in_file());
        let advice = match meant {
            Some(id) => format!("did you mean {id}?"),
            None if name.contains(char::is_whitespace) => {
                "a conversation is in one state at a time".to_owned()
            }
            None => "declare it, or name a state that is there".to_owned(),
        };
        let message = format!("{what} {name:?} is no state of this file");
        self.report
            .error(attribute.position, Code::UndeclaredTarget, message, advice);
        let meant = meant.and_then(|id| leaves.by_id.get(id))?;
        self.entry(leaves, *meant, attribute.position)
    }

    /// The state that one is in after entering this one: of a compound state its initial one, and
    /// of its final one where its completion leads.
    pub(super) fn entry(
        &mut self,
        leaves: &Leaves<'_>,
        raw: usize,
        position: Position,
    ) -> Option<StateId> {
        let mut at = raw;
        for _ in 0..=2 * leaves.tree.states.len() {
            let state = leaves.raw(at);
            let next = match (state.children.first(), state.initial) {
                (None, _) => leaves.completion(at),
                (Some(first), None) => {
                    at = *first;
                    continue;
                }
                (Some(_), Some(initial)) => Some(initial),
            };
            let Some(next) = next else {
                return Some(leaves.id(at));
            };
            match leaves.by_id.get(next.value.trim()) {
                Some(raw) => at = *raw,
                None => return self.target(leaves, next, "the initial state"),
            }
        }
        self.report.syntax(
            position,
            "entering this state never ends",
            "the initial state of a compound state is one within it",
        );
        None
    }
}

impl<'a> Leaves<'a> {
    pub(super) fn new(tree: &'a Tree<'a>) -> Leaves<'a> {
        let mut by_id = HashMap::new();
        for (raw, state) in tree.states.iter().enumerate() {
            by_id.entry(state.id).or_insert(raw);
        }
        let mut leaves = Leaves {
            tree,
            by_id,
            ids: HashMap::new(),
        };
        let mut order: Vec<usize> = (0..tree.states.len()).collect();
        order.sort_by_key(|raw| leaves.raw(*raw).element.position);
        // One is never in what completes a compound state, but at once where that leads.
        order.retain(|raw| {
            leaves.raw(*raw).children.is_empty() && leaves.completion(*raw).is_none()
        });
        leaves.ids = order.into_iter().zip((0..u16::MAX).map(StateId)).collect();
        leaves
    }

    /// The states in which something can be, in the order of the file.
    pub(super) fn in_order(&self) -> Vec<(usize, StateId)> {
        let mut order: Vec<(usize, StateId)> =
            self.ids.iter().map(|(raw, id)| (*raw, *id)).collect();
        order.sort_by_key(|(_, id)| *id);
        order
    }

    /// The first of them.
    pub(super) fn first(&self) -> Option<StateId> {
        self.ids.values().min().copied()
    }

    /// The names of all states.
    fn in_file(&self) -> impl Iterator<Item = &'a str> {
        self.tree.states.iter().map(|state| state.id)
    }

    pub(super) fn raw(&self, at: usize) -> &RawState<'a> {
        &self.tree.states[at]
    }

    pub(super) fn id(&self, leaf: usize) -> StateId {
        self.ids.get(&leaf).copied().unwrap_or(StateId(0))
    }

    /// A state, and those that it is within, from the inside out.
    pub(super) fn with_ancestors(&self, at: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(at), |at| self.raw(*at).parent)
    }

    /// Where the completion of a compound state leads, asked of its final state.
    fn completion(&self, leaf: usize) -> Option<&'a Attribute> {
        let state = self.raw(leaf);
        let parent = self.raw(state.parent?);
        if state.element.name != "final" {
            return None;
        }
        let event = format!("done.state.{}", parent.id);
        let ancestors = self.with_ancestors(state.parent?);
        let mut transitions = ancestors.flat_map(|at| self.raw(at).transitions.iter().copied());
        let is_it = |element: &&Element| {
            element
                .attribute("event")
                .is_some_and(|e| e.value.trim() == event)
        };
        transitions.find(is_it)?.attribute("target")
    }
}

/// Whether a transition is taken when a compound state is complete, not for a message.
pub(super) fn is_completion(element: &Element) -> bool {
    let event = element.attribute("event");
    element.attribute("performative").is_none()
        && event.is_some_and(|event| event.value.trim_start().starts_with("done.state."))
}
