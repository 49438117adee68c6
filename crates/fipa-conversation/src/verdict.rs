use std::fmt;

use fipa_acl::Text;

/// What a message is by the protocol of its conversation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The protocol has it.
    Accepted {
        /// The state after it: of the conversation, or of the participant with whom it was exchanged;
        /// in a sub-conversation with the name of its protocol, as `fipa-request/agreed`.
        state: Text,
    },
    /// The protocol does not have it; nothing changed.
    Violation(Box<Violation>),
    /// It belongs to no conversation, or its protocol is not known.
    NotMonitored,
}

/// Why a message is against the protocol, and what would not have been.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text}")]
pub struct Violation {
    /// The rule that it breaks.
    pub rule: Rule,
    /// The state that the conversation, or the participant, is in.
    pub state: Text,
    /// All of this for people.
    pub text: String,
    /// What the nominal flow has in that state. Default transitions (`cancel`, `not-understood`,
    /// `failure`) are not listed.
    pub expected: Vec<Expected>,
}

/// A message that would have been legal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Expected {
    /// The act; `.*` for any, or the expression of a protocol for acts outside the standard.
    pub performative: Text,
    /// The role of its sender.
    pub from: Text,
    /// The role of its receivers.
    pub to: Text,
}

/// What a message can be measured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Rule {
    /// A conversation begins with an opening act of its protocol.
    Opening,
    /// The act is one that leads out of the state.
    Performative,
    /// The sender plays the role that sends it.
    Sender,
    /// Every receiver plays the role that receives it, and there is one.
    Receiver,
    /// The conversation-id stays the same.
    ConversationId,
    /// The protocol stays the same, but for sub-protocols where there may be some.
    Protocol,
    /// A sub-conversation is begun by the right role, and no more often than announced.
    SubProtocol,
    /// An answer comes by the `reply-by` of what it answers, or before the state times out.
    Deadline,
    /// After the end nothing follows.
    Ended,
    /// An answer's in-reply-to is the reply-with of what it answers.
    InReplyTo,
    /// The language stays the same.
    Language,
    /// The ontology stays the same.
    Ontology,
}

impl Rule {
    /// The rule as programs know it, such as `in-reply-to`.
    pub fn as_str(self) -> &'static str {
        match self {
            Rule::Opening => "opening",
            Rule::Performative => "performative",
            Rule::Sender => "sender",
            Rule::Receiver => "receiver",
            Rule::ConversationId => "conversation-id",
            Rule::Protocol => "protocol",
            Rule::SubProtocol => "sub-protocol",
            Rule::Deadline => "deadline",
            Rule::Ended => "ended",
            Rule::InReplyTo => "in-reply-to",
            Rule::Language => "language",
            Rule::Ontology => "ontology",
        }
    }
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}
