use fipa_acl::Text;
use fipa_sl::{Functional, Term};

use super::{ams_description, df_description};
use crate::Reason;

/// The parameters that the ontology knows of each object.
const KNOWN: &[(&str, &[&str])] = &[
    (
        df_description::OBJECT,
        &[
            "name",
            "services",
            "protocols",
            "ontologies",
            "languages",
            "lease-time",
            "scope",
        ],
    ),
    (
        df_description::SERVICE,
        &[
            "name",
            "type",
            "ownership",
            "protocols",
            "ontologies",
            "languages",
            "properties",
        ],
    ),
    (df_description::PROPERTY, &["name", "value"]),
    (ams_description::OBJECT, &["name", "ownership", "state"]),
    ("agent-identifier", &["name", "addresses", "resolvers"]),
];

/// Why a description is refused: it has a parameter that the ontology does not know and that is
/// not marked as foreign to it by `X-`.
pub(crate) fn unexpected_parameter(term: &Term) -> Option<Reason> {
    let functional = term.as_functional()?;
    let known = KNOWN.iter().find(|(object, _)| functional.is(object));
    if let Some((object, parameters)) = known
        && let Some(parameter) = unknown(functional, parameters)
    {
        return Some(Reason::UnexpectedParameter {
            object: Text::from_static(object),
            parameter,
        });
    }
    // The value of a property is anybody's.
    if functional.is(df_description::PROPERTY) {
        return None;
    }
    let named = functional.parameters().iter().map(|(_, value)| value);
    let mut inner = functional.positional().iter().chain(named);
    inner.find_map(unexpected_parameter)
}

fn unknown(functional: &Functional, known: &[&str]) -> Option<Text> {
    let mut names = functional.parameters().iter().map(|(name, _)| name);
    let unknown = names.find(|name| {
        let is_known = known.iter().any(|known| name.eq_ignore_ascii_case(known));
        let is_foreign = name.get(..2).is_some_and(|x| x.eq_ignore_ascii_case("x-"));
        !is_known && !is_foreign
    });
    unknown.cloned()
}
