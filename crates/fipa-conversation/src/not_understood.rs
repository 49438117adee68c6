use fipa_acl::{Message, Performative};

use crate::Violation;

/// The answer of an agent that does not take messages that violate the protocol: what it did not
/// understand, and why (FIPA SC00037J, `unexpected-act`).
///
/// There is none to a message without a sender, and none to `not-understood` or `failure`: two such
/// agents would answer each other for ever.
pub fn not_understood_reply(message: &Message, violation: &Violation) -> Option<Message> {
    let act = &message.performative;
    let is_answered = !matches!(act, Performative::NotUnderstood | Performative::Failure);
    message.sender.as_ref().filter(|_| is_answered)?;
    let text = violation.text.replace('\\', "\\\\").replace('"', "\\\"");
    let mut reply = message.reply(Performative::NotUnderstood);
    // The content is of no language that the two have agreed on.
    reply.language = None;
    reply.encoding = None;
    Some(reply.content(format!("((unexpected-act {act}) \"{text}\")")))
}
