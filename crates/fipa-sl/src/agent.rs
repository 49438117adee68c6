use fipa_acl::{AgentId, Expression, Text, UserDefined};

use crate::{FrameError, Functional, Term};

const AGENT: &str = "agent-identifier";

/// Resolvers within resolvers that are followed.
const MAX_RESOLVERS: usize = 16;

/// The agent identifier that a term is (FIPA SC00023K, agent-identifier).
///
/// What is neither of the standard nor marked by `X-` is passed over.
///
/// ```
/// use fipa_sl::{Term, agent_id};
///
/// let term: Term = "(agent-identifier :name a@r1 :addresses (sequence http://r1:7778/acc))"
///     .parse()
///     .unwrap();
/// let agent = agent_id(&term).unwrap();
/// assert_eq!(agent.addresses, ["http://r1:7778/acc"]);
/// assert_eq!(Term::from(&agent), term);
/// ```
pub fn agent_id(term: &Term) -> Result<AgentId, FrameError> {
    agent_at(term, 0)
}

fn agent_at(term: &Term, level: usize) -> Result<AgentId, FrameError> {
    let frame = term
        .functional(AGENT)
        .ok_or(FrameError::NotA { object: AGENT })?;
    let name = frame.parameter("name").ok_or(FrameError::Missing {
        object: AGENT,
        parameter: "name",
    })?;
    let mut agent = AgentId::new(text_of("name", name)?);
    if let Some(addresses) = frame.parameter("addresses") {
        let items = items_of("addresses", addresses)?.iter();
        agent.addresses = items
            .map(|address| text_of("addresses", address))
            .collect::<Result<_, _>>()?;
    }
    if let Some(resolvers) = frame.parameter("resolvers") {
        if level == MAX_RESOLVERS {
            return Err(wrong("resolvers", resolvers));
        }
        let items = items_of("resolvers", resolvers)?.iter();
        agent.resolvers = items
            .map(|resolver| agent_at(resolver, level + 1))
            .collect::<Result<_, _>>()?;
    }
    let user_defined = frame.parameters().iter().filter(|(name, _)| is_user(name));
    agent.user_defined = user_defined
        .map(|(name, value)| UserDefined::new(name, expression(value)))
        .collect();
    Ok(agent)
}

fn is_user(name: &str) -> bool {
    name.get(..2)
        .is_some_and(|prefix| prefix.eq_ignore_ascii_case("x-"))
}

fn text_of(parameter: &'static str, value: &Term) -> Result<Text, FrameError> {
    let text = value.as_text().filter(|text| !text.is_empty());
    text.ok_or_else(|| wrong(parameter, value))
}

fn items_of<'a>(parameter: &'static str, value: &'a Term) -> Result<&'a [Term], FrameError> {
    value.items().ok_or_else(|| wrong(parameter, value))
}

fn wrong(parameter: &'static str, value: &Term) -> FrameError {
    FrameError::Value {
        object: AGENT,
        parameter,
        value: Text::from(value.to_string()),
    }
}

impl From<&AgentId> for Term {
    /// The agent identifier as a term; empty lists are left out.
    fn from(agent: &AgentId) -> Term {
        let mut frame = Functional::object(Text::from_static(AGENT)).with("name", &agent.name);
        if !agent.addresses.is_empty() {
            let addresses = agent.addresses.iter().map(Term::from);
            frame = frame.with("addresses", Term::sequence(addresses));
        }
        if !agent.resolvers.is_empty() {
            let resolvers = agent.resolvers.iter().map(Term::from);
            frame = frame.with("resolvers", Term::sequence(resolvers));
        }
        for parameter in &agent.user_defined {
            frame = frame.with(format!("X-{}", parameter.name), term(&parameter.value));
        }
        frame.into()
    }
}

/// An expression of a message as a term: a list, which need not begin with a symbol, as its text.
fn term(expression: &Expression) -> Term {
    match expression {
        Expression::Number(number) => Term::Number(number.clone()),
        Expression::Word(text) | Expression::String(text) => Term::Text(text.clone()),
        Expression::List(_) => Term::text(expression.to_string()),
    }
}

fn expression(term: &Term) -> Expression {
    match term {
        Term::Number(number) => Expression::Number(number.clone()),
        Term::Text(text) => Expression::String(text.clone()),
        other => Expression::from(other.to_string()),
    }
}
