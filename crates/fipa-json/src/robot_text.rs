use robot_text::{Kind, Message, Unreadable};
use serde_json::{Map, Value, json};

use crate::JsonError;
use crate::reader::{Fields, object};
use crate::values::{hexadecimal, text, whole_number};

const KEYS: [&str; 9] = [
    "origin",
    "destination",
    "reference",
    "urgency",
    "action",
    "question",
    "answer",
    "status",
    "other",
];

/// The JSON form of a message in the text format of small robots.
pub fn text_to_json(message: &Message) -> Value {
    let mut map = Map::new();
    let names = [
        ("origin", &message.origin),
        ("destination", &message.destination),
        ("reference", &message.reference),
    ];
    for (key, value) in names {
        if let Some(value) = value {
            map.insert(key.to_owned(), value.as_str().into());
        }
    }
    if let Some(urgency) = message.urgency {
        map.insert("urgency".to_owned(), urgency.into());
    }
    map.insert(key_of(message.kind()).to_owned(), message.text().into());
    if !message.other.is_empty() {
        map.insert("other".to_owned(), json!(message.other));
    }
    Value::Object(map)
}

/// What stands in the place of a message that cannot be read.
pub fn unreadable_text_to_json(unreadable: &Unreadable) -> Value {
    json!({
        "error": unreadable.fault.word(),
        "octets": hexadecimal(&unreadable.octets),
    })
}

/// Reads the JSON form of a message in the text format of small robots.
///
/// # Errors
/// The place of the first value that is not of the form. Whether the texts can be written is told
/// by [`Message::to_text`].
pub fn text_from_json(value: &Value) -> Result<Message, JsonError> {
    let fields = Fields::new(value, &KEYS)?;
    let owned = |value| text(value).map(|text| text.to_string());
    let mut bodies = Vec::new();
    for kind in Kind::ALL {
        if let Some(text) = fields.optional(key_of(kind), owned)? {
            bodies.push((kind, text));
        }
    }
    let Ok([body]) = <[_; 1]>::try_from(bodies) else {
        let needed = "exactly one of action, question, answer and status is needed";
        return Err(JsonError::new(needed));
    };
    let other = fields.optional("other", |value| {
        object(value)?
            .iter()
            .map(|(key, value)| Ok((key.clone(), owned(value).map_err(|e| e.under(key))?)))
            .collect()
    })?;
    Ok(Message {
        origin: fields.optional("origin", owned)?,
        destination: fields.optional("destination", owned)?,
        reference: fields.optional("reference", owned)?,
        urgency: fields.optional("urgency", digit)?,
        body,
        other: other.unwrap_or_default(),
    })
}

fn key_of(kind: Kind) -> &'static str {
    match kind {
        Kind::Action => "action",
        Kind::Question => "question",
        Kind::Answer => "answer",
        Kind::Status => "status",
    }
}

fn digit(value: &Value) -> Result<u8, JsonError> {
    match whole_number(value)? {
        digit @ 0..=9 => Ok(digit as u8),
        _ => Err(JsonError::expected("a number from 0 to 9")),
    }
}
