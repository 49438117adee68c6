use super::{Loader, is_ours_to_read};
use crate::NAMESPACE;
use crate::diagnostic::{Code, LoadError, Position};
use crate::suggestion::suggestion;
use crate::xml::{Attribute, Element, Space};

/// The states as they are nested in the file, in its order.
pub(super) struct Tree<'a> {
    pub(super) states: Vec<RawState<'a>>,
    /// The initial state of the whole, if the file says.
    pub(super) initial: Option<&'a Attribute>,
    pub(super) roles: Vec<&'a Element>,
}

pub(super) struct RawState<'a> {
    pub(super) element: &'a Element,
    pub(super) id: &'a str,
    pub(super) parent: Option<usize>,
    pub(super) children: Vec<usize>,
    pub(super) initial: Option<&'a Attribute>,
    pub(super) transitions: Vec<&'a Element>,
    pub(super) subprotocols: Vec<&'a Element>,
}

/// What SCXML has and a conversation has no use for.
#[rustfmt::skip]
const IRRELEVANT: [&str; 19] = [
    "datamodel", "data", "onentry", "onexit", "donedata", "invoke", "script", "log", "raise", "send", "cancel",
    "assign", "if", "else", "elseif", "foreach", "finalize", "content", "param",
];

/// Attributes that are known; those of SCXML without a meaning here are, so that nobody takes them
/// for misspelt.
#[rustfmt::skip]
const OUTERMOST: [&str; 10] = [
    "initial", "name", "version", "datamodel", "binding", "exmode", "aliases", "rules", "states", "match",
];
const STATE: [&str; 6] = ["id", "final", "initial", "outcome", "timeout", "on-timeout"];
#[rustfmt::skip]
const TRANSITION: [&str; 8] = [
    "performative", "event", "from", "to", "target", "cond", "type", "protocol",
];
#[rustfmt::skip]
const SUBPROTOCOL: [&str; 6] = ["name", "file", "from", "proxied_to", "multiple", "awaited"];

/// Those that mean something with our prefix only.
#[rustfmt::skip]
const PREFIXED: [&str; 8] = [
    "aliases", "rules", "states", "match", "outcome", "timeout", "on-timeout", "protocol",
];

const KNOWN: [&str; 6] = [
    "state",
    "final",
    "transition",
    "initial",
    "subprotocol",
    "role",
];

impl Loader<'_> {
    pub(super) fn collect<'a>(&mut self, root: &'a Element) -> Result<Tree<'a>, LoadError> {
        let mut tree = Tree {
            states: Vec::new(),
            initial: root.attribute("initial"),
            roles: Vec::new(),
        };
        // The children of each are taken up behind those of its elder siblings, so that nothing
        // here is recursive; the order of the file is kept by position.
        let mut waiting: Vec<(&'a Element, Option<usize>)> = vec![(root, None)];
        while let Some((parent, at)) = waiting.pop() {
            self.misspelt(parent);
            for child in parent
                .children
                .iter()
                .filter(|child| is_ours_to_read(child))
            {
                match child.name.as_str() {
                    "state" | "final" => {
                        let state = self.state(&mut tree, child, at)?;
                        waiting.push((child, Some(state)));
                    }
                    "role" => tree.roles.push(child),
                    "initial" => self.initial(&mut tree, child, at),
                    "transition" => match at.and_then(|at| tree.states.get_mut(at)) {
                        Some(state) => {
                            state.transitions.push(child);
                            self.misspelt(child);
                        }
                        None => self.misplaced(child),
                    },
                    "subprotocol" => match at.and_then(|at| tree.states.get_mut(at)) {
                        Some(state) => {
                            state.subprotocols.push(child);
                            self.misspelt(child);
                        }
                        None => self.misplaced(child),
                    },
                    name @ ("parallel" | "history") => {
                        self.report.syntax(
                            child.position,
                            format!("<{name}> has no meaning in a conversation"),
                            "use states one after the other; each participant has its own",
                        );
                        if name == "parallel" {
                            // Its states are there for those who name them.
                            waiting.push((child, at));
                        }
                    }
                    name if IRRELEVANT.contains(&name) => {}
                    name => self.unknown(child.position, name),
                }
            }
        }
        Ok(tree)
    }

    fn state<'a>(
        &mut self,
        tree: &mut Tree<'a>,
        element: &'a Element,
        parent: Option<usize>,
    ) -> Result<usize, LoadError> {
        let at = tree.states.len();
        if at >= self.limits.max_states {
            return Err(LoadError {
                position: element.position,
                what: format!("there are more than {} states", self.limits.max_states),
            });
        }
        let id = element.attribute("id").map_or("", |id| id.value.trim());
        if id.is_empty() {
            let message = format!("a <{}> has no id", element.name);
            self.report.syntax(
                element.position,
                message,
                "give it an id that no other state has",
            );
        } else if let Some(first) = tree.states.iter().find(|state| state.id == id) {
            let message = format!(
                "the id {id} is that of the state at {} as well",
                first.element.position
            );
            self.report.syntax(
                element.position,
                message,
                "give each state an id of its own",
            );
        }
        tree.states.push(RawState {
            element,
            id,
            parent,
            children: Vec::new(),
            initial: element.attribute("initial"),
            transitions: Vec::new(),
            subprotocols: Vec::new(),
        });
        if let Some(parent) = parent.and_then(|parent| tree.states.get_mut(parent)) {
            parent.children.push(at);
        }
        Ok(at)
    }

    /// `<initial><transition target="…"/></initial>`, of a state or of the whole.
    fn initial<'a>(&mut self, tree: &mut Tree<'a>, element: &'a Element, at: Option<usize>) {
        let transition = element
            .children
            .iter()
            .find(|child| child.name == "transition");
        let target = transition.and_then(|transition| transition.attribute("target"));
        if target.is_none() {
            self.report.syntax(
                element.position,
                "<initial> says no target",
                "write <initial><transition target=\"…\"/></initial>",
            );
        }
        let initial = match at {
            Some(at) => tree.states.get_mut(at).map(|state| &mut state.initial),
            None => Some(&mut tree.initial),
        };
        if let Some(initial) = initial {
            *initial = initial.or(target);
        }
    }

    /// Attributes that are like one that would mean something there.
    fn misspelt(&mut self, element: &Element) {
        let known = match element.name.as_str() {
            "state" | "final" => &STATE[..],
            "transition" => &TRANSITION,
            "subprotocol" => &SUBPROTOCOL,
            "parallel" => &[],
            _ => &OUTERMOST,
        };
        for attribute in &element.attributes {
            let name = attribute.name.as_str();
            let advice = match (attribute.space, known.contains(&name)) {
                (Space::Scxml, true) if PREFIXED.contains(&name) => {
                    format!("write fipa:{name}, with xmlns:fipa={NAMESPACE:?}; it is ignored")
                }
                (Space::Scxml | Space::Ours, false) => {
                    match suggestion(name, known.iter().copied()) {
                        Some(meant) => format!("did you mean {meant}? It is ignored"),
                        None => continue,
                    }
                }
                _ => continue,
            };
            let message = format!("{name} is no attribute of <{}>", element.name);
            self.report
                .warning(attribute.position, Code::Syntax, message, advice);
        }
    }

    fn misplaced(&mut self, element: &Element) {
        let message = format!("<{}> stands outside of a state", element.name);
        self.report.syntax(
            element.position,
            message,
            "put it into the state in which it holds",
        );
    }

    fn unknown(&mut self, position: Position, name: &str) {
        let advice = match suggestion(name, KNOWN) {
            Some(known) => format!("did you mean <{known}>? It is ignored"),
            None => "it is ignored; elements of other namespaces are without a warning".to_owned(),
        };
        self.report.warning(
            position,
            Code::Syntax,
            format!("<{name}> is not known"),
            advice,
        );
    }
}
