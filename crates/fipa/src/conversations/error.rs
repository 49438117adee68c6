use std::time::Duration;

use fipa_acl::{Message, Text};
use fipa_link::{Outcome, ReceiverOutcome};

/// Why a conversation did not end as it was meant to.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConversationError {
    /// A message did not reach its receiver.
    #[error("{to}: {outcome}: {reason}")]
    Undelivered {
        /// The receiver.
        to: String,
        /// What became of the message.
        outcome: Outcome,
        /// Why.
        reason: String,
    },
    /// The other one will not: `refuse`, or `reject-proposal`.
    #[error("{}", said("refused", .0))]
    Refused(Box<Message>),
    /// The other one could not: `failure`.
    #[error("{}", said("failed", .0))]
    Failed(Box<Message>),
    /// The other one did not understand.
    #[error("{}", said("not understood", .0))]
    NotUnderstood(Box<Message>),
    /// No answer came in time.
    #[error("no answer came within {0:?}")]
    NoAnswer(Duration),
    /// The other agent is gone, as the directory says.
    #[error("{0} is gone")]
    PeerLost(Text),
    /// The platform has ended.
    #[error("the platform has ended")]
    Ended,
}

impl ConversationError {
    /// The first failure among the outcomes.
    pub(crate) fn undelivered(outcomes: &[ReceiverOutcome]) -> Option<ConversationError> {
        let failed = outcomes.iter().find(|o| !o.outcome.is_success())?;
        Some(ConversationError::Undelivered {
            to: failed.to.to_string(),
            outcome: failed.outcome,
            reason: failed.reason.to_string(),
        })
    }
}

fn said(what: &str, message: &Message) -> String {
    let sender = message.sender.as_ref();
    let sender = sender.map_or("somebody", |sender| sender.name.as_str());
    match message.content_str() {
        Some(content) => format!("{what} by {sender}: {content}"),
        None => format!("{what} by {sender}"),
    }
}
