use std::collections::BTreeMap;

/// The longest message, in octets with its braces.
pub const MAX_OCTETS: usize = 1024;

/// A message between the agents of a small robot.
///
/// All texts are printable ASCII without `{`, `}` and `;`, and have no blanks at their ends. What
/// is not is refused by [`to_text`](Message::to_text).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// `O`, the sender ("émetteur"). Only an action may be without.
    pub origin: Option<String>,
    /// `D`, the receiver ("destinataire"). A status has none, every other message has one.
    pub destination: Option<String>,
    /// `X`, the reference that ties an answer to its question.
    pub reference: Option<String>,
    /// `U`, the urgency from 0 to 9; absent counts as 0, the least.
    pub urgency: Option<u8>,
    /// What it is, and its text, which may be empty.
    pub body: (Kind, String),
    /// Keys that the format does not have, passed on as they came.
    pub other: BTreeMap<String, String>,
}

/// What a message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// `A`: something to be done; nobody acknowledges it.
    Action,
    /// `Q`: causes an answer.
    Question,
    /// `R`: the answer to a question ("réponse").
    Answer,
    /// `S`: an event or alarm for whoever subscribed to its sender.
    Status,
}

impl Kind {
    /// All of them, in the order of their definition.
    pub const ALL: [Kind; 4] = [Kind::Action, Kind::Question, Kind::Answer, Kind::Status];

    /// Its key in a message.
    pub fn key(self) -> &'static str {
        match self {
            Kind::Action => "A",
            Kind::Question => "Q",
            Kind::Answer => "R",
            Kind::Status => "S",
        }
    }
}

impl Message {
    /// A message with nothing but its kind and text.
    pub fn new(kind: Kind, text: impl Into<String>) -> Message {
        Message {
            origin: None,
            destination: None,
            reference: None,
            urgency: None,
            body: (kind, text.into()),
            other: BTreeMap::new(),
        }
    }

    /// With this sender.
    pub fn from(mut self, origin: impl Into<String>) -> Message {
        self.origin = Some(origin.into());
        self
    }

    /// With this receiver.
    pub fn to(mut self, destination: impl Into<String>) -> Message {
        self.destination = Some(destination.into());
        self
    }

    /// With this reference.
    pub fn reference(mut self, reference: impl Into<String>) -> Message {
        self.reference = Some(reference.into());
        self
    }

    /// The answer to this question: its sender and receiver exchanged, its reference kept.
    pub fn answer(&self, text: impl Into<String>) -> Message {
        Message {
            origin: self.destination.clone(),
            destination: self.origin.clone(),
            reference: self.reference.clone(),
            ..Message::new(Kind::Answer, text)
        }
    }

    /// What it is.
    pub fn kind(&self) -> Kind {
        self.body.0
    }

    /// The text of the action, question, answer or status.
    pub fn text(&self) -> &str {
        &self.body.1
    }
}
