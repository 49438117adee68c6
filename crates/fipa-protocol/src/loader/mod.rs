//! From elements to a protocol: what stands in the file, then what it means.

mod build;
mod collect;
mod defaults;
mod leaves;
mod roles;
mod transitions;
mod values;

use std::collections::HashSet;

use fipa_acl::Text;

use crate::diagnostic::{Code, Diagnostic, LoadError, Position, Severity};
use crate::protocol::{Keeping, Matching, Protocol, Rules, StateId};
use crate::xml::{self, Element, Space};
use crate::{Limits, check};

/// What a file holds.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The protocol; there if and only if no diagnostic is an error.
    pub protocol: Option<Protocol>,
    /// What is wrong, in the order of the file.
    pub diagnostics: Vec<Diagnostic>,
}

/// Loads a protocol from a file of this name; a name that the file itself does not say is that of
/// the file without its ending.
///
/// # Errors
/// The octets are not well-formed XML, or beyond the limits. Everything else is a diagnostic.
pub fn load(file: &str, bytes: &[u8], limits: &Limits) -> Result<Loaded, LoadError> {
    let root = xml::read(bytes, limits)?;
    let mut report = Report::default();
    let protocol = Loader {
        limits,
        report: &mut report,
    }
    .load(file, &root)?;
    if let Some(protocol) = &protocol {
        check::check(protocol, &mut report);
    }
    let mut diagnostics = report.0;
    diagnostics.sort_by_key(|diagnostic| (diagnostic.position, diagnostic.code));
    // What an outer state has is looked at for each of its inner ones.
    diagnostics.dedup();
    let wrong = |diagnostic: &Diagnostic| diagnostic.severity == Severity::Error;
    let protocol = protocol.map(|parts| parts.protocol);
    Ok(Loaded {
        protocol: protocol.filter(|_| !diagnostics.iter().any(wrong)),
        diagnostics,
    })
}

/// What was found wrong so far.
#[derive(Default)]
pub(crate) struct Report(Vec<Diagnostic>);

impl Report {
    pub(crate) fn error(
        &mut self,
        position: Position,
        code: Code,
        message: impl Into<String>,
        advice: impl Into<String>,
    ) {
        self.add(
            position,
            Severity::Error,
            code,
            message.into(),
            advice.into(),
        );
    }

    pub(crate) fn warning(
        &mut self,
        position: Position,
        code: Code,
        message: impl Into<String>,
        advice: impl Into<String>,
    ) {
        self.add(
            position,
            Severity::Warning,
            code,
            message.into(),
            advice.into(),
        );
    }

    /// An element or attribute that is not of the schema.
    pub(crate) fn syntax(
        &mut self,
        position: Position,
        message: impl Into<String>,
        advice: impl Into<String>,
    ) {
        self.error(position, Code::Syntax, message, advice);
    }

    fn add(
        &mut self,
        position: Position,
        severity: Severity,
        code: Code,
        message: String,
        advice: String,
    ) {
        self.0.push(Diagnostic {
            position,
            severity,
            code,
            message,
            advice,
        });
    }
}

/// A protocol with what only the checks need to know of it.
pub(crate) struct Parts {
    pub(crate) protocol: Protocol,
    /// The first element.
    pub(crate) root: Position,
    /// Roles that are declared, or named by a `subprotocol`, and where.
    pub(crate) mentioned: Vec<(String, Position)>,
    /// States of which a transition was not understood.
    pub(crate) broken: HashSet<StateId>,
}

struct Loader<'a> {
    limits: &'a Limits,
    report: &'a mut Report,
}

/// What the outermost element says of the whole.
struct Head {
    name: Text,
    aliases: Vec<Text>,
    rules: Rules,
    keeping: Keeping,
    matching: Matching,
}

impl Loader<'_> {
    fn load(&mut self, file: &str, root: &Element) -> Result<Option<Parts>, LoadError> {
        let head = self.head(file, root);
        let tree = self.collect(root)?;
        if tree.states.is_empty() {
            let message = format!("<{}> holds no state", root.name);
            self.report.syntax(
                root.position,
                message,
                "a protocol has <state> and <final> elements",
            );
            return Ok(None);
        }
        self.build(root, head, &tree)
    }

    fn head(&mut self, file: &str, root: &Element) -> Head {
        let words = |value: &str| value.split_whitespace().map(Text::from).collect();
        let rules = match self.one_of(root, "rules", &["fipa", "fipa-acl"]) {
            Some("fipa-acl") => Rules::FipaAcl,
            _ => Rules::Fipa,
        };
        let keeping = match self.one_of(root, "states", &["participant", "conversation"]) {
            Some("conversation") => Keeping::ByConversation,
            None if rules == Rules::FipaAcl => Keeping::ByConversation,
            _ => Keeping::ByParticipant,
        };
        let name = root
            .attribute("name")
            .map(|attribute| attribute.value.trim());
        let name = name
            .filter(|name| !name.is_empty())
            .unwrap_or_else(|| stem(file));
        Head {
            name: Text::from(name),
            aliases: root
                .extension("aliases")
                .map_or_else(Vec::new, |a| words(&a.value)),
            rules,
            keeping,
            matching: self.matching(root),
        }
    }

    fn matching(&mut self, root: &Element) -> Matching {
        let mut matching = Matching::default();
        let Some(attribute) = root.extension("match") else {
            return matching;
        };
        for word in attribute.value.split_whitespace() {
            match word {
                "in-reply-to" => matching.in_reply_to = true,
                "language" => matching.language = true,
                "ontology" => matching.ontology = true,
                other => self.report.syntax(
                    attribute.position,
                    format!("{other:?} cannot be matched"),
                    "in-reply-to, language and ontology can",
                ),
            }
        }
        matching
    }

    /// The value of an attribute of ours, which is one of these.
    fn one_of(
        &mut self,
        element: &Element,
        name: &str,
        values: &[&'static str],
    ) -> Option<&'static str> {
        let attribute = element.extension(name)?;
        let found = values
            .iter()
            .find(|value| **value == attribute.value.trim());
        if found.is_none() {
            let message = format!("{name}={:?} has no meaning", attribute.value);
            let advice = format!("it is one of {}", values.join(", "));
            self.report.syntax(attribute.position, message, advice);
        }
        found.copied()
    }
}

/// The name of a file without folders and ending.
fn stem(file: &str) -> &str {
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    match name.rsplit_once('.') {
        Some((stem, _)) if !stem.is_empty() => stem,
        _ => name,
    }
}

/// Whether an element is of SCXML or of the dialect.
fn is_ours_to_read(element: &Element) -> bool {
    element.space != Space::Foreign
}
