use std::fmt;

/// What one message says.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Content {
    /// An action is to be done.
    Do(Action),
    /// Which actions there are, or whether there is this one.
    AskActions(Option<Name>),
    /// How all tasks stand, or this one.
    AskStatus(Option<u32>),
    /// The actions that there are.
    Actions(Vec<Signature>),
    /// How tasks stand.
    Status(Vec<Task>),
}

/// An action with its arguments, in the order in which they were given.
#[derive(Clone, Debug, PartialEq)]
pub struct Action {
    /// What is done.
    pub name: Name,
    /// With what; no name stands twice.
    pub arguments: Vec<(Name, Value)>,
}

/// An action that a robot has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    /// What it is called.
    pub name: Name,
    /// What must be said about it; no name stands twice.
    pub parameters: Vec<(Name, Kind)>,
    /// What it does, for people; may be empty.
    pub description: String,
}

/// An action that a robot was told to do.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// Its number at this robot.
    pub number: u32,
    /// How it stands.
    pub state: TaskState,
    /// How much of it is done, in percent; 100 at most.
    pub percent: Option<u8>,
    /// What is done.
    pub action: Action,
}

/// How a task stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TaskState {
    /// It has not begun.
    Waiting,
    /// It is being done.
    Running,
    /// It was done.
    Done,
    /// It could not be done.
    Failed,
    /// It was broken off.
    Cancelled,
}

/// What kind of value a parameter takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A number.
    Number,
    /// A name or any other text.
    Text,
    /// True or false.
    Truth,
}

/// The value of an argument.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A number, in units that the action defines.
    Number(Number),
    /// A name or any other text.
    Text(String),
    /// True or false.
    Truth(bool),
}

/// A name: an ASCII letter, then letters, digits and `- _ . @`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Name(String);

/// A number that is finite.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Number(f64);

/// A text that is no name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no name: an ASCII letter, then letters, digits and - _ . @")]
pub struct NotName(pub String);

/// A number that is infinite, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the number is not finite")]
pub struct NotFinite;

/// How an action differs from what a robot has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Mismatch {
    /// It is another action.
    #[error("{0} is another action")]
    Action(Name),
    /// An argument is missing.
    #[error("{0} is missing")]
    Missing(Name),
    /// There is no such parameter.
    #[error("there is no {0}")]
    Unknown(Name),
    /// An argument is of another kind.
    #[error("{name} is not a {kind}")]
    Kind {
        /// The parameter.
        name: Name,
        /// The kind that it takes.
        kind: Kind,
    },
}

impl Name {
    /// Takes a text that is a name.
    ///
    /// # Errors
    /// It is none.
    pub fn new(text: impl Into<String>) -> Result<Name, NotName> {
        let text = text.into();
        let begins = text.starts_with(|c: char| c.is_ascii_alphabetic());
        match begins && text.chars().all(is_of_name) {
            true => Ok(Name(text)),
            false => Err(NotName(text)),
        }
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Whether a character can stand within a name.
pub(crate) fn is_of_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | '@')
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl Number {
    /// Takes a number that is finite.
    ///
    /// # Errors
    /// It is infinite, or none.
    pub fn new(number: f64) -> Result<Number, NotFinite> {
        match number.is_finite() {
            true => Ok(Number(number)),
            false => Err(NotFinite),
        }
    }

    /// The number.
    pub fn get(self) -> f64 {
        self.0
    }
}

impl Value {
    /// What kind of value it is.
    pub fn kind(&self) -> Kind {
        match self {
            Value::Number(_) => Kind::Number,
            Value::Text(_) => Kind::Text,
            Value::Truth(_) => Kind::Truth,
        }
    }
}

impl Action {
    /// The argument of this name.
    pub fn argument(&self, name: &str) -> Option<&Value> {
        let mut arguments = self.arguments.iter();
        arguments
            .find(|(known, _)| known.as_str() == name)
            .map(|(_, value)| value)
    }
}

impl Signature {
    /// Checks that an action is this one, with all its arguments and no others.
    ///
    /// # Errors
    /// The first difference.
    pub fn check(&self, action: &Action) -> Result<(), Mismatch> {
        if action.name != self.name {
            return Err(Mismatch::Action(action.name.clone()));
        }
        for (name, kind) in &self.parameters {
            match action.argument(name.as_str()) {
                None => return Err(Mismatch::Missing(name.clone())),
                Some(value) if value.kind() != *kind => {
                    let (name, kind) = (name.clone(), *kind);
                    return Err(Mismatch::Kind { name, kind });
                }
                Some(_) => {}
            }
        }
        let is_known = |name: &Name| self.parameters.iter().any(|(known, _)| known == name);
        match action.arguments.iter().find(|(name, _)| !is_known(name)) {
            Some((name, _)) => Err(Mismatch::Unknown(name.clone())),
            None => Ok(()),
        }
    }
}

impl Kind {
    pub(crate) const ALL: [Kind; 3] = [Kind::Number, Kind::Text, Kind::Truth];

    /// The word for it.
    pub fn as_str(self) -> &'static str {
        match self {
            Kind::Number => "number",
            Kind::Text => "text",
            Kind::Truth => "truth",
        }
    }
}

impl TaskState {
    pub(crate) const ALL: [TaskState; 5] = [
        TaskState::Waiting,
        TaskState::Running,
        TaskState::Done,
        TaskState::Failed,
        TaskState::Cancelled,
    ];

    /// The word for it.
    pub fn as_str(self) -> &'static str {
        match self {
            TaskState::Waiting => "waiting",
            TaskState::Running => "running",
            TaskState::Done => "done",
            TaskState::Failed => "failed",
            TaskState::Cancelled => "cancelled",
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl fmt::Display for TaskState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}
