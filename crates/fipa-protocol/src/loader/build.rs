use std::collections::HashSet;

use fipa_acl::Text;

use super::collect::Tree;
use super::leaves::{Leaves, is_completion};
use super::roles::Roles;
use super::{Head, Loader, Parts, defaults, values};
use crate::diagnostic::{LoadError, Position};
use crate::protocol::{Outcome, Protocol, Rules, State, StateId, Transition};
use crate::xml::Element;

impl Loader<'_> {
    pub(super) fn build(
        &mut self,
        root: &Element,
        head: Head,
        tree: &Tree<'_>,
    ) -> Result<Option<Parts>, LoadError> {
        let leaves = Leaves::new(tree);
        let mut roles = Roles {
            found: Vec::new(),
            rules: head.rules,
            max_pattern: self.limits.max_pattern,
        };
        let initial = match tree.initial {
            Some(attribute) => self.target(&leaves, attribute, "the initial state"),
            None => self.entry(&leaves, 0, root.position),
        };
        // What was wrong is told; the rest is looked at all the same.
        let Some(initial) = initial.or(leaves.first()) else {
            return Ok(None);
        };
        let (mut states, broken) = self.states(&leaves, &mut roles, initial)?;
        let mentioned = self.mentioned(tree, &mut roles);
        if head.rules == Rules::FipaAcl {
            defaults::add(&mut states);
        }
        let protocol = Protocol {
            name: head.name,
            aliases: head.aliases,
            roles: roles.found,
            states,
            initial,
            rules: head.rules,
            keeping: head.keeping,
            matching: head.matching,
        };
        Ok(Some(Parts {
            protocol,
            root: root.position,
            mentioned,
            broken,
        }))
    }

    /// The states with the transitions that lead somewhere, and those of which one does not.
    fn states(
        &mut self,
        leaves: &Leaves<'_>,
        roles: &mut Roles,
        initial: StateId,
    ) -> Result<(Vec<State>, HashSet<StateId>), LoadError> {
        let mut left = self.limits.max_transitions;
        let mut states = Vec::new();
        let mut broken = HashSet::new();
        for (raw, id) in leaves.in_order() {
            let (state, is_whole) = self.leaf(leaves, roles, raw, initial == id);
            if !is_whole {
                broken.insert(id);
            }
            left = left
                .checked_sub(state.transitions.len())
                .ok_or_else(|| LoadError {
                    position: leaves.raw(raw).element.position,
                    what: format!(
                        "there are more than {} transitions",
                        self.limits.max_transitions
                    ),
                })?;
            states.push(state);
        }
        Ok((states, broken))
    }

    /// A state, and whether all that leads out of it was understood.
    fn leaf(
        &mut self,
        leaves: &Leaves<'_>,
        roles: &mut Roles,
        raw: usize,
        opens: bool,
    ) -> (State, bool) {
        let own = leaves.raw(raw);
        let element = own.element;
        let mut state = State {
            id: Text::from(own.id),
            is_final: self.is_final(element),
            outcome: self.outcome(element),
            timeout: self.timeout(element),
            on_timeout: None,
            transitions: Vec::new(),
            subprotocols: Vec::new(),
            position: Some(element.position),
        };
        let mut is_whole = true;
        if let Some(attribute) = element.extension("on-timeout") {
            state.on_timeout = self.target(leaves, attribute, "the state after the time-out");
        }
        for (level, at) in leaves.with_ancestors(raw).enumerate() {
            let holder = leaves.raw(at);
            for element in holder.transitions.iter().filter(|t| !is_completion(t)) {
                let transition = self.transition(leaves, roles, element, leaves.id(raw), opens);
                is_whole &= transition.is_some();
                let transition = transition.map(|transition| Transition {
                    inherited: level > 0,
                    ..transition
                });
                state.transitions.extend(transition);
            }
            for element in &holder.subprotocols {
                state.subprotocols.extend(self.subprotocol(roles, element));
            }
        }
        (state, is_whole)
    }

    fn is_final(&mut self, element: &Element) -> bool {
        let is_final = self.boolean(element, "final");
        is_final.unwrap_or(element.name == "final")
    }

    pub(super) fn boolean(&mut self, element: &Element, name: &str) -> Option<bool> {
        let attribute = element.attribute(name)?;
        let value = values::boolean(&attribute.value);
        if value.is_none() {
            let message = format!("{name}={:?} has no meaning", attribute.value);
            self.report.syntax(
                attribute.position,
                message,
                "it is yes, true, 1, no, false or 0",
            );
        }
        value
    }

    fn outcome(&mut self, element: &Element) -> Option<Outcome> {
        let attribute = element.extension("outcome")?;
        let outcome = Outcome::named(attribute.value.trim());
        if outcome.is_none() {
            let message = format!("outcome={:?} has no meaning", attribute.value);
            let advice = "it is done, refused, failed, cancelled, timed-out or peer-lost";
            self.report.syntax(attribute.position, message, advice);
        }
        outcome
    }

    fn timeout(&mut self, element: &Element) -> Option<std::time::Duration> {
        let attribute = element.extension("timeout")?;
        let span = values::duration(&attribute.value);
        if span.is_none() {
            let message = format!("{:?} is no time", attribute.value);
            self.report.syntax(
                attribute.position,
                message,
                "write it like 500ms, 30s, 2min or 1h",
            );
        }
        span
    }

    pub(super) fn missing(&mut self, element: &Element, name: &str, advice: &str) {
        let message = format!("a <{}> without {name}", element.name);
        self.report.syntax(element.position, message, advice);
    }

    /// The roles that are declared or named by a `subprotocol`, which need not be used.
    fn mentioned(&mut self, tree: &Tree<'_>, roles: &mut Roles) -> Vec<(String, Position)> {
        let mut mentioned = Vec::new();
        for element in &tree.roles {
            let Some(name) = element.attribute("name").or(element.attribute("id")) else {
                self.missing(element, "name", "name the role");
                continue;
            };
            let open = self.boolean(element, "open").unwrap_or(false);
            roles.declare(name.value.trim(), open);
            mentioned.push((name.value.trim().to_owned(), element.position));
        }
        let subprotocols = tree.states.iter().flat_map(|state| &state.subprotocols);
        for element in subprotocols {
            let names = ["from", "proxied_to"].map(|name| element.attribute(name));
            let names = names.into_iter().flatten();
            mentioned.extend(names.map(|a| (a.value.trim().to_owned(), a.position)));
        }
        mentioned
    }
}
