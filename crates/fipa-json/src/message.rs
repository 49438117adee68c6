use fipa_acl::{Message, Performative};
use serde_json::{Map, Value};

use crate::JsonError;
use crate::agent_id::{agent_id_from_json, agent_id_to_json, parameters};
use crate::agent_id::{put_agents, put_parameters};
use crate::reader::Fields;
use crate::values::{expression, octets, octets_to_json, text, time};

const KEYS: [&str; 14] = [
    "performative",
    "sender",
    "receiver",
    "reply-to",
    "content",
    "language",
    "encoding",
    "ontology",
    "protocol",
    "conversation-id",
    "reply-with",
    "in-reply-to",
    "reply-by",
    "user-defined",
];

/// A message as an object whose keys are FIPA's parameter names, in a fixed order.
///
/// Expressions stand as their text, nested ones in string notation; a date without a zone is
/// shown as UTC.
pub fn message_to_json(message: &Message) -> Value {
    let mut json = Map::new();
    json.insert("performative".into(), message.performative.as_str().into());
    if let Some(sender) = &message.sender {
        json.insert("sender".into(), agent_id_to_json(sender));
    }
    put_agents(&mut json, "receiver", &message.receiver);
    put_agents(&mut json, "reply-to", &message.reply_to);
    if let Some(content) = &message.content {
        json.insert("content".into(), octets_to_json(content));
    }
    put_shown(&mut json, "language", message.language.as_ref());
    put_shown(&mut json, "encoding", message.encoding.as_ref());
    put_shown(&mut json, "ontology", message.ontology.as_ref());
    put_shown(&mut json, "protocol", message.protocol.as_ref());
    put_shown(
        &mut json,
        "conversation-id",
        message.conversation_id.as_ref(),
    );
    put_shown(&mut json, "reply-with", message.reply_with.as_ref());
    put_shown(&mut json, "in-reply-to", message.in_reply_to.as_ref());
    put_shown(&mut json, "reply-by", message.reply_by.as_ref());
    put_parameters(&mut json, &message.user_defined);
    json.into()
}

/// Reads the form of [`message_to_json`].
///
/// What has another form on the wire but the same text reads as equal: `(a b)` is always a
/// nested expression, a date is always in UTC.
///
/// # Errors
/// A [`JsonError`] that names the key that is missing, unknown or of another type.
pub fn message_from_json(value: &Value) -> Result<Message, JsonError> {
    let fields = Fields::new(value, &KEYS)?;
    Ok(Message {
        performative: fields
            .required("performative", text)
            .map(Performative::from)?,
        sender: fields.optional("sender", agent_id_from_json)?,
        receiver: fields.list("receiver", agent_id_from_json)?,
        reply_to: fields.list("reply-to", agent_id_from_json)?,
        content: fields.optional("content", octets)?,
        language: fields.optional("language", expression)?,
        encoding: fields.optional("encoding", expression)?,
        ontology: fields.optional("ontology", expression)?,
        protocol: fields.optional("protocol", text)?,
        conversation_id: fields.optional("conversation-id", expression)?,
        reply_with: fields.optional("reply-with", expression)?,
        in_reply_to: fields.optional("in-reply-to", expression)?,
        reply_by: fields.optional("reply-by", time)?,
        user_defined: parameters(&fields)?,
    })
}

/// Sets `key` to the text of a value, if there is one.
pub(crate) fn put_shown<T: ToString>(json: &mut Map<String, Value>, key: &str, value: Option<&T>) {
    if let Some(value) = value {
        json.insert(key.into(), value.to_string().into());
    }
}
