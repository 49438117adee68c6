use std::fmt;

use fipa_acl::Text;
use fipa_sl::{FrameError, Functional, Term};

/// Why a request was not understood, was refused or failed (FIPA SC00023K, exception
/// propositions).
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reason {
    /// Not understood: the act is none that the agent takes.
    UnsupportedAct(Text),
    /// Not understood: the agent cannot do with this value of a parameter of the message.
    UnsupportedValue(Text),
    /// Not understood: the value of this parameter of the message cannot be read.
    UnrecognisedValue(Text),
    /// Refused: the sender may not do that.
    Unauthorised,
    /// Refused: the agent has no such function.
    UnsupportedFunction(Text),
    /// Refused: an argument of the function is missing.
    MissingArgument(Text),
    /// Refused: the function has fewer arguments.
    UnexpectedArgumentCount,
    /// Refused: an object lacks a parameter that it must have.
    MissingParameter {
        /// The object.
        object: Text,
        /// The parameter.
        parameter: Text,
    },
    /// Refused: an object has a parameter that the ontology does not know.
    UnexpectedParameter {
        /// The object.
        object: Text,
        /// The parameter.
        parameter: Text,
    },
    /// Refused: a parameter of an object holds what it cannot mean.
    UnrecognisedParameterValue {
        /// The parameter.
        parameter: Text,
        /// What it holds.
        value: Text,
    },
    /// Failed: the agent is registered already.
    AlreadyRegistered,
    /// Failed: the agent is not registered.
    NotRegistered,
    /// Failed: for another reason, in words.
    InternalError(Text),
    /// Anything else that a peer says.
    Other(Term),
}

impl From<&Reason> for Term {
    fn from(reason: &Reason) -> Term {
        let term = |symbol: &'static str, arguments: &[&Text]| {
            let arguments = arguments.iter().map(|argument| Term::from(*argument));
            Functional::new(Text::from_static(symbol), arguments).into()
        };
        match reason {
            Reason::UnsupportedAct(act) => term("unsupported-act", &[act]),
            Reason::UnsupportedValue(name) => term("unsupported-value", &[name]),
            Reason::UnrecognisedValue(name) => term("unrecognised-value", &[name]),
            Reason::Unauthorised => Term::text("unauthorised"),
            Reason::UnsupportedFunction(name) => term("unsupported-function", &[name]),
            Reason::MissingArgument(name) => term("missing-argument", &[name]),
            Reason::UnexpectedArgumentCount => Term::text("unexpected-argument-count"),
            Reason::MissingParameter { object, parameter } => {
                term("missing-parameter", &[object, parameter])
            }
            Reason::UnexpectedParameter { object, parameter } => {
                term("unexpected-parameter", &[object, parameter])
            }
            Reason::UnrecognisedParameterValue { parameter, value } => {
                term("unrecognised-parameter-value", &[parameter, value])
            }
            Reason::AlreadyRegistered => Term::text("already-registered"),
            Reason::NotRegistered => Term::text("not-registered"),
            Reason::InternalError(text) => term("internal-error", &[text]),
            Reason::Other(term) => term.clone(),
        }
    }
}

impl From<&Term> for Reason {
    /// Reads a proposition; symbols in any case, and those without arguments with or without
    /// parentheses.
    fn from(term: &Term) -> Reason {
        Reason::read(term).unwrap_or_else(|| Reason::Other(term.clone()))
    }
}

impl Reason {
    fn read(term: &Term) -> Option<Reason> {
        let (symbol, arguments) = match term {
            // A message transport service wraps its reason: `(MTS-error RECEIVER REASON)`.
            Term::Functional(error) if error.is("mts-error") => {
                return error.positional().last().and_then(Reason::read);
            }
            Term::Functional(functional) => (functional.symbol.clone(), functional.positional()),
            term => (term.as_text()?, &[][..]),
        };
        let arguments: Option<Vec<Text>> = arguments.iter().map(Term::as_text).collect();
        let mut arguments = arguments?.into_iter();
        let (first, second) = (arguments.next(), arguments.next());
        let reason = match symbol.to_ascii_lowercase().as_str() {
            "unsupported-act" => Reason::UnsupportedAct(first?),
            "unsupported-value" => Reason::UnsupportedValue(first?),
            "unrecognised-value" => Reason::UnrecognisedValue(first?),
            "unauthorised" => Reason::Unauthorised,
            "unsupported-function" => Reason::UnsupportedFunction(first?),
            "missing-argument" => Reason::MissingArgument(first?),
            "unexpected-argument-count" => Reason::UnexpectedArgumentCount,
            "missing-parameter" => Reason::MissingParameter {
                object: first?,
                parameter: second?,
            },
            "unexpected-parameter" => Reason::UnexpectedParameter {
                object: first?,
                parameter: second?,
            },
            "unrecognised-parameter-value" => Reason::UnrecognisedParameterValue {
                parameter: first?,
                value: second?,
            },
            "already-registered" => Reason::AlreadyRegistered,
            "not-registered" => Reason::NotRegistered,
            "internal-error" => Reason::InternalError(first?),
            _ => return None,
        };
        Some(reason)
    }
}

impl From<FrameError> for Reason {
    /// Why a request with such an argument is refused.
    fn from(error: FrameError) -> Reason {
        match error {
            FrameError::NotA { object } => Reason::MissingArgument(Text::from_static(object)),
            FrameError::Missing { object, parameter } => Reason::MissingParameter {
                object: Text::from_static(object),
                parameter: Text::from_static(parameter),
            },
            FrameError::Value {
                parameter, value, ..
            } => Reason::UnrecognisedParameterValue {
                parameter: Text::from_static(parameter),
                value,
            },
            error => Reason::InternalError(Text::from(error.to_string())),
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reason::UnsupportedAct(act) => write!(f, "it takes no {act}"),
            Reason::UnsupportedValue(name) => write!(f, "it cannot do with this {name}"),
            Reason::UnrecognisedValue(name) => write!(f, "it cannot read the {name}"),
            Reason::Unauthorised => f.write_str("the sender may not do that"),
            Reason::UnsupportedFunction(name) => write!(f, "it has no function {name}"),
            Reason::MissingArgument(name) => write!(f, "the argument {name} is missing"),
            Reason::UnexpectedArgumentCount => f.write_str("there are too many arguments"),
            Reason::MissingParameter { object, parameter } => {
                write!(f, "the {object} needs a parameter :{parameter}")
            }
            Reason::UnexpectedParameter { object, parameter } => {
                write!(f, "no {object} has a parameter :{parameter}")
            }
            Reason::UnrecognisedParameterValue { parameter, value } => {
                write!(f, "the parameter :{parameter} cannot be {value}")
            }
            Reason::AlreadyRegistered => f.write_str("the agent is registered already"),
            Reason::NotRegistered => f.write_str("the agent is not registered"),
            Reason::InternalError(text) => f.write_str(text),
            Reason::Other(term) => write!(f, "{term}"),
        }
    }
}
