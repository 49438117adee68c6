use fipa_acl::Text;
use fipa_protocol::Outcome;

/// Something that happened to a conversation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Its id.
    pub conversation: Text,
    /// What happened.
    pub kind: EventKind,
}

/// What happened to a conversation.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum EventKind {
    /// Its first message was taken.
    Started {
        /// The name of its protocol.
        protocol: Text,
        /// Who opened it.
        initiator: Text,
    },
    /// It moved on, by a message or by time.
    Updated {
        /// The state after it.
        state: Text,
    },
    /// Nothing follows.
    Ended {
        /// How it ended: done if it is done with any participant.
        outcome: Outcome,
    },
}
