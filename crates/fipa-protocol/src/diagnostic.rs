use std::fmt;

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Position {
    /// From 1 on.
    pub line: usize,
    /// In characters, from 1 on.
    pub column: usize,
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.line, self.column)
    }
}

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// The file describes no protocol.
    Error,
    /// The file describes a protocol, but hardly the one that was meant.
    Warning,
}

impl Severity {
    /// `error` or `warning`.
    pub fn as_str(self) -> &'static str {
        match self {
            Severity::Error => "error",
            Severity::Warning => "warning",
        }
    }
}

/// What kind of mistake it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Code {
    /// A transition or an initial state names a state that is not there.
    UndeclaredTarget,
    /// No sequence of messages leads to the state.
    UnreachableState,
    /// From the state, which is not final, no sequence of messages leads to an end.
    DeadEnd,
    /// Two transitions of a state take the same message, and lead to different states.
    AmbiguousTransition,
    /// No transition is from or to the role.
    UnusedRole,
    /// The elements and attributes are not those of the schema.
    Syntax,
}

impl Code {
    /// The code as programs know it, such as `dead-end`.
    pub fn as_str(self) -> &'static str {
        match self {
            Code::UndeclaredTarget => "undeclared-target",
            Code::UnreachableState => "unreachable-state",
            Code::DeadEnd => "dead-end",
            Code::AmbiguousTransition => "ambiguous-transition",
            Code::UnusedRole => "unused-role",
            Code::Syntax => "syntax",
        }
    }
}

/// Something wrong in a file, where it stands, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// The element or attribute that is wrong.
    pub position: Position,
    /// How bad it is.
    pub severity: Severity,
    /// What kind of mistake it is.
    pub code: Code,
    /// What is wrong.
    pub message: String,
    /// What to do about it.
    pub advice: String,
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (severity, code) = (self.severity.as_str(), self.code.as_str());
        let Diagnostic {
            position,
            message,
            advice,
            ..
        } = self;
        write!(f, "{position}: {severity} [{code}]: {message}; {advice}")
    }
}

/// Why a file cannot be looked at: it is not well-formed XML, or beyond the limits.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{position}: {what}")]
pub struct LoadError {
    /// Where it is noticed.
    pub position: Position,
    /// What is wrong there.
    pub what: String,
}
