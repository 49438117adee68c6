use fipa_acl::Text;

use crate::Term;

/// What stands in parentheses: a symbol and its arguments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Functional {
    /// The function, predicate, operator or kind of object.
    pub symbol: Text,
    /// What it is applied to.
    pub arguments: Arguments,
}

/// The arguments of a functional term: all by position, or all by name. None at all is equal in
/// both.
#[derive(Clone, Debug)]
pub enum Arguments {
    /// One behind the other.
    Positional(Vec<Term>),
    /// Parameters, by their names without the colon.
    Named(Vec<(Text, Term)>),
}

impl Functional {
    /// A functional term with arguments by position.
    pub fn new(symbol: impl Into<Text>, arguments: impl IntoIterator<Item = Term>) -> Functional {
        Functional {
            symbol: symbol.into(),
            arguments: Arguments::Positional(arguments.into_iter().collect()),
        }
    }

    /// An object: a functional term with parameters, none of them yet.
    pub fn object(symbol: impl Into<Text>) -> Functional {
        Functional {
            symbol: symbol.into(),
            arguments: Arguments::Named(Vec::new()),
        }
    }

    /// The action expression that `agent` does what `act` describes.
    pub fn action(agent: Term, act: Term) -> Functional {
        Functional::new("action", [agent, act])
    }

    /// Adds a parameter. A term with arguments by position has no room for it: they are dropped.
    #[must_use]
    pub fn with(mut self, name: impl Into<Text>, value: impl Into<Term>) -> Functional {
        if !matches!(self.arguments, Arguments::Named(_)) {
            self.arguments = Arguments::Named(Vec::new());
        }
        if let Arguments::Named(parameters) = &mut self.arguments {
            parameters.push((name.into(), value.into()));
        }
        self
    }

    /// Adds a parameter if there is a value.
    #[must_use]
    pub fn with_some(self, name: &'static str, value: Option<impl Into<Term>>) -> Functional {
        match value {
            Some(value) => self.with(Text::from_static(name), value),
            None => self,
        }
    }

    /// Whether it has this symbol, in any case.
    pub fn is(&self, symbol: &str) -> bool {
        self.symbol.eq_ignore_ascii_case(symbol)
    }

    /// The arguments by position; empty where they are by name.
    pub fn positional(&self) -> &[Term] {
        self.all_positional().unwrap_or_default()
    }

    /// The arguments if none is by name.
    pub(crate) fn all_positional(&self) -> Option<&[Term]> {
        match &self.arguments {
            Arguments::Positional(terms) => Some(terms),
            Arguments::Named(parameters) => parameters.is_empty().then_some(&[]),
        }
    }

    /// The parameters in the order in which they stand there; empty where the arguments are by
    /// position.
    pub fn parameters(&self) -> &[(Text, Term)] {
        match &self.arguments {
            Arguments::Positional(_) => &[],
            Arguments::Named(parameters) => parameters,
        }
    }

    /// The value of a parameter, by its name in any case; of two the last one counts.
    pub fn parameter(&self, name: &str) -> Option<&Term> {
        let mut parameters = self.parameters().iter().rev();
        let (_, value) = parameters.find(|(known, _)| known.eq_ignore_ascii_case(name))?;
        Some(value)
    }
}

impl Arguments {
    fn is_empty(&self) -> bool {
        match self {
            Arguments::Positional(terms) => terms.is_empty(),
            Arguments::Named(parameters) => parameters.is_empty(),
        }
    }
}

impl PartialEq for Arguments {
    fn eq(&self, other: &Arguments) -> bool {
        match (self, other) {
            (Arguments::Positional(a), Arguments::Positional(b)) => a == b,
            (Arguments::Named(a), Arguments::Named(b)) => a == b,
            (a, b) => a.is_empty() && b.is_empty(),
        }
    }
}

impl Eq for Arguments {}
