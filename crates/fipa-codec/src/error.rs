use std::fmt;

/// Why bytes could not be read: where, what, and whose fault it is.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("octet {offset}: {what} ({fault})")]
pub struct DecodeError {
    /// Octets of the input in front of what is wrong.
    pub offset: usize,
    /// Whose fault it is.
    pub fault: Fault,
    /// What is wrong there, in a few words.
    pub what: &'static str,
}

/// Whose fault it is that bytes could not be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// They end too soon or are not of the grammar.
    Malformed,
    /// They can be read, but say what the standard does not allow.
    Violation,
    /// They are legal, but this decoder does not do that.
    Unsupported,
    /// They exceed the decoder's limits.
    Limit,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Fault::Malformed => "malformed",
            Fault::Violation => "violates the standard",
            Fault::Unsupported => "unsupported",
            Fault::Limit => "beyond the limit",
        })
    }
}

/// Why a message or envelope cannot be written in a representation.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{parameter}: {what}")]
pub struct EncodeError {
    /// The parameter or slot that cannot be written.
    pub parameter: &'static str,
    /// Why not.
    pub what: &'static str,
}
