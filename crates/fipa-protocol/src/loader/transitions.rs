use fipa_acl::Text;

use super::leaves::Leaves;
use super::roles::Roles;
use super::{Loader, values};
use crate::diagnostic::Code;
use crate::pattern::Pattern;
use crate::performatives::Performatives;
use crate::protocol::{Party, StateId, Subprotocol, Transition};
use crate::suggestion::suggestion;
use crate::xml::{Attribute, Element};

/// Names of roles where a file gives none.
const INITIATOR: &str = "initiator";
const PARTICIPANT: &str = "participant";

impl Loader<'_> {
    pub(super) fn transition(
        &mut self,
        leaves: &Leaves<'_>,
        roles: &mut Roles,
        element: &Element,
        leaf: StateId,
        opens: bool,
    ) -> Option<Transition> {
        let dialect = element.attribute("performative");
        let performatives = self.performatives(element, dialect);
        let target = match element.attribute("target") {
            Some(attribute) => self.target(leaves, attribute, "the target"),
            None if dialect.is_some() => {
                self.missing(element, "target", "name the state to which it leads");
                None
            }
            // SCXML stays where it is then.
            None => Some(leaf),
        };
        let mut party = |name, opening: &str| match element.attribute(name) {
            Some(attribute) => self.party(roles, attribute),
            None if dialect.is_some() => {
                self.missing(element, name, "name the role, or .* for anybody");
                None
            }
            None if opens => roles.party(opening).ok(),
            None => Some(Party::Any),
        };
        let from = party("from", INITIATOR);
        let to = party("to", PARTICIPANT);
        Some(Transition {
            performatives: performatives?,
            from: from?,
            to: to?,
            target: target?,
            any_protocol: self.one_of(element, "protocol", &["any"]).is_some(),
            guarded: element.attribute("cond").is_some(),
            inherited: false,
            position: Some(element.position),
        })
    }

    fn performatives(
        &mut self,
        element: &Element,
        dialect: Option<&Attribute>,
    ) -> Option<Performatives> {
        let Some(attribute) = dialect.or(element.attribute("event")) else {
            self.missing(
                element,
                "performative",
                "say which acts it takes, such as inform or .*",
            );
            return None;
        };
        let value = attribute.value.trim();
        let max = self.limits.max_pattern;
        let read = match dialect {
            Some(_) => Performatives::new(&[value], max),
            None => values::event(value, max),
        };
        let performatives = match read {
            Ok(performatives) if !value.is_empty() => performatives,
            Ok(_) => {
                self.missing(
                    element,
                    &attribute.name,
                    "say which acts it takes, such as inform or .*",
                );
                return None;
            }
            Err(error) => {
                let advice = "name the acts it takes, joined by |, or .* for any";
                self.report
                    .syntax(attribute.position, error.to_string(), advice);
                return None;
            }
        };
        if performatives.is_of_no_standard_act() {
            let standard = fipa_acl::Performative::STANDARD;
            let advice = match suggestion(value, standard.iter().map(|act| act.as_str())) {
                Some(act) => format!("did you mean {act}?"),
                None => "only messages with just that act are taken".to_owned(),
            };
            let message = format!("{value:?} is none of the 22 acts of FIPA");
            self.report
                .warning(attribute.position, Code::Syntax, message, advice);
        }
        Some(performatives)
    }

    pub(super) fn subprotocol(
        &mut self,
        roles: &mut Roles,
        element: &Element,
    ) -> Option<Subprotocol> {
        let (name, position) = match element.attribute("name") {
            Some(attribute) => (attribute.value.trim(), attribute.position),
            None => (".*", element.position),
        };
        let pattern = Pattern::new(&format!("(?i){name}"), self.limits.max_pattern);
        let expression = Text::from(name);
        let name = match pattern {
            Ok(pattern) => pattern,
            Err(error) => {
                self.report.syntax(
                    position,
                    error.to_string(),
                    "name a protocol, or .* for any",
                );
                return None;
            }
        };
        let from = match element.attribute("from") {
            Some(attribute) => self.party(roles, attribute)?,
            None => Party::Any,
        };
        let proxied_to = match element.attribute("proxied_to") {
            Some(attribute) => Some(self.party(roles, attribute)?),
            None => None,
        };
        let awaited = self.boolean(element, "awaited").unwrap_or(true);
        Some(Subprotocol {
            name,
            expression,
            from,
            proxied_to,
            awaited,
        })
    }

    fn party(&mut self, roles: &mut Roles, attribute: &Attribute) -> Option<Party> {
        let name = attribute.value.trim();
        if name.is_empty() {
            let message = format!("{} names no role", attribute.name);
            self.report.syntax(
                attribute.position,
                message,
                "name the role, or .* for anybody",
            );
            return None;
        }
        match roles.party(name) {
            Ok(party) => Some(party),
            Err(why) => {
                self.report.syntax(
                    attribute.position,
                    why,
                    "name a role, or an expression for names of agents",
                );
                None
            }
        }
    }
}
