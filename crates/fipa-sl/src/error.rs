use fipa_acl::Text;

/// Why octets are no SL: where, and what was expected there.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{line}:{column} (octet {offset}): {kind}")]
pub struct ParseError {
    /// Octets in front of what is wrong.
    pub offset: usize,
    /// The line, counted from 1.
    pub line: usize,
    /// The character of the line, counted from 1.
    pub column: usize,
    /// What is wrong there.
    pub kind: ParseErrorKind,
}

/// What is wrong with octets that are no SL.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseErrorKind {
    /// Something else stands there than the grammar allows.
    #[error("expected {expected}, found {found}")]
    Expected {
        /// What may stand there.
        expected: &'static str,
        /// What does, shortened.
        found: String,
    },
    /// Outside `#n"` only UTF-8 is read.
    #[error("not UTF-8")]
    NotUtf8,
    /// It exceeds the limits of the reader.
    #[error("{0}")]
    Limit(&'static str),
}

/// Why a term is not the object it should be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// It is another term altogether.
    #[error("expected ({object} …)")]
    NotA {
        /// The symbol that it should have.
        object: &'static str,
    },
    /// A parameter is missing that it must have.
    #[error("{object} needs a parameter :{parameter}")]
    Missing {
        /// The symbol of the object.
        object: &'static str,
        /// The parameter.
        parameter: &'static str,
    },
    /// A parameter holds what it cannot mean.
    #[error("{object} cannot have {value} as its :{parameter}")]
    Value {
        /// The symbol of the object.
        object: &'static str,
        /// The parameter.
        parameter: &'static str,
        /// What it holds, as SL.
        value: Text,
    },
}
