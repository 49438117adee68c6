//! What stands in the messages: protocols, parameters, contents.

use std::time::Duration;

use fipa_acl::{Message, Text};

pub(crate) const DISCOVER: &str = "dlm_discover";
pub(crate) const PROBE: &str = "dlm_probe";
pub(crate) const TOKEN_LANGUAGE: &str = "suzuki_kasami::Token";

// User-defined parameters, without their `X-`. The C++ library ignores them.
/// The number of a grant; 0 where one is asked for, or where there is no grant.
pub(crate) const FENCING: &str = "Fencing";
/// Who holds the resource, as its owner says.
pub(crate) const HOLDER: &str = "Holder";
/// The resource because of which an agent is probed.
pub(crate) const RESOURCE: &str = "Resource";
/// The conversation of the grant because of which a holder is probed.
pub(crate) const CONVERSATION: &str = "Conversation";
/// The heartbeat by which a lease is measured, in milliseconds.
pub(crate) const HEARTBEAT: &str = "Heartbeat";

/// What [`HOLDER`] says when there is none: no name of an agent begins so.
pub(crate) const NOBODY: &str = "-";

pub(crate) fn parameter<'a>(message: &'a Message, name: &str) -> Option<&'a str> {
    let mut found = message.user_defined.iter();
    let found = found.find(|parameter| parameter.name.eq_ignore_ascii_case(name))?;
    found.value.as_str()
}

pub(crate) fn number(message: &Message, name: &str) -> Option<u64> {
    parameter(message, name)?.parse().ok()
}

pub(crate) fn heartbeat(message: &Message) -> Option<Duration> {
    let millis = number(message, HEARTBEAT).filter(|millis| *millis > 0)?;
    Some(Duration::from_millis(millis))
}

pub(crate) fn conversation(message: &Message) -> Option<&str> {
    message.conversation_id.as_ref()?.as_str()
}

/// Whether this can be the name of a resource: some messages hold two lines.
pub(crate) fn is_resource(name: &str) -> bool {
    !name.is_empty() && !name.contains('\n')
}

/// The content of discovery, of `confirm` and of `disconfirm`.
pub(crate) fn resource(message: &Message) -> Option<Text> {
    let name = message.content_str().filter(|name| is_resource(name))?;
    Some(Text::from(name))
}

/// `LAMPORT\nRESOURCE`
pub(crate) fn stamped(message: &Message) -> Option<(u64, Text)> {
    let (clock, resource) = message.content_str()?.split_once('\n')?;
    let clock = clock.parse().ok()?;
    is_resource(resource).then(|| (clock, Text::from(resource)))
}

/// `RESOURCE\nSEQUENCE`
pub(crate) fn numbered(message: &Message) -> Option<(Text, u64)> {
    let (resource, sequence) = message.content_str()?.split_once('\n')?;
    let sequence = sequence.parse().ok()?;
    is_resource(resource).then(|| (Text::from(resource), sequence))
}
