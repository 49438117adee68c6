use super::{Loader, is_ours_to_read};
use crate::diagnostic::{Code, LoadError, Position};
use crate::suggestion::suggestion;
use crate::xml::{Attribute, Element};

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
                        Some(state) => state.transitions.push(child),
                        None => self.misplaced(child),
                    },
                    "subprotocol" => match at.and_then(|at| tree.states.get_mut(at)) {
                        Some(state) => state.subprotocols.push(child),
                        None => self.misplaced(child),
                    },
                    "parallel" | "history" => self.report.syntax(
                        child.position,
                        format!("<{}> has no meaning in a conversation", child.name),
                        "use states one after the other; each participant has its own",
                    ),
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
