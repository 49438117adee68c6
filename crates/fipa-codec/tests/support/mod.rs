//! Recordings and their indexes as data.

// Not every test uses everything.
#![allow(dead_code)]

use std::path::PathBuf;

use bytes::Bytes;
use fipa_acl::{
    AgentId, Expression, FipaTime, Letter, Message, Performative, Received, Representation, Slots,
    Text, UserDefined, Zone,
};
use fipa_codec::Limits;
use fipa_codec::bit_efficient::{decode_letter, decode_message};
use serde_json::Value;

pub(crate) fn path(file: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/vectors")
        .join(file)
}

pub(crate) fn recording(file: &str) -> Bytes {
    let path = path(file);
    std::fs::read(&path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        .into()
}

/// The entries of an index, an array of objects.
pub(crate) fn index(file: &str) -> Vec<Value> {
    serde_json::from_slice(&recording(file)).unwrap()
}

/// The entries of fipa_acl in this representation and of this kind: name, octets, entry.
pub(crate) fn fipa_acl(representation: &str, kind: &str) -> Vec<(String, Bytes, Value)> {
    let entries: Vec<_> = index("fipa_acl/index.json")
        .into_iter()
        .filter(|entry| entry["kind"] == kind && entry["representation"] == representation)
        .map(|entry| {
            let octets = recording(&format!("fipa_acl/{}", string(&entry["file"])));
            (string(&entry["name"]), octets, entry)
        })
        .collect();
    assert!(!entries.is_empty(), "no recording of kind {kind}");
    entries
}

pub(crate) fn message(octets: impl Into<Bytes>) -> Message {
    let octets = octets.into();
    decode_message(&octets, &Limits::default())
        .unwrap_or_else(|error| panic!("{error}: {octets:?}"))
}

pub(crate) fn letter(octets: impl Into<Bytes>) -> Letter {
    let octets = octets.into();
    decode_letter(&octets, &Limits::default()).unwrap_or_else(|error| panic!("{error}: {octets:?}"))
}

/// The octets that these hexadecimal digits stand for; anything else is skipped.
pub(crate) fn hex(digits: &str) -> Bytes {
    let digits: Vec<u8> = digits
        .chars()
        .filter_map(|digit| digit.to_digit(16))
        .map(|digit| digit as u8)
        .collect();
    assert_eq!(digits.len() % 2, 0, "half an octet");
    digits
        .chunks(2)
        .map(|pair| pair[0] << 4 | pair[1])
        .collect()
}

/// The message that an entry of the index of fipa_acl describes.
pub(crate) fn expected_message(value: &Value) -> Message {
    let mut message = Message::new(Performative::from(text(&value["performative"])));
    message.sender = Some(agent(&value["sender"])).filter(|a| a.name != *"agent_id:undefined");
    message.receiver = agents(&value["receivers"]);
    message.reply_to = agents(&value["reply_to"]);
    message.content = content(value);
    message.language = expression(&value["language"]);
    message.encoding = expression(&value["encoding"]);
    message.ontology = expression(&value["ontology"]);
    message.protocol = optional_text(&value["protocol"]);
    message.conversation_id = expression(&value["conversation_id"]);
    message.reply_with = expression(&value["reply_with"]);
    message.in_reply_to = expression(&value["in_reply_to"]);
    message.reply_by = time(&value["reply_by_us"]);
    message.user_defined = user_defined(&value["user_params"]);
    message
}

/// Empty contents were not written.
fn content(value: &Value) -> Option<Bytes> {
    if value["content_len"] == 0 {
        None
    } else if value["content_file"].is_string() {
        let file = string(&value["content_file"]);
        Some(recording(&format!("fipa_acl/{file}")))
    } else {
        Some(hex(&string(&value["content_hex"])))
    }
}

/// The layer that an entry of the index of fipa_acl describes; an empty text is an absent one.
pub(crate) fn expected_slots(value: &Value) -> Slots {
    let behaviour = optional_text(&value["transport_behaviour"]);
    Slots {
        to: agents(&value["to"]),
        from: value.get("from").map(agent),
        comments: optional_text(&value["comments"]),
        acl_representation: optional_text(&value["acl_representation"]).map(Representation::from),
        payload_length: value["payload_length"].as_u64(),
        payload_encoding: optional_text(&value["payload_encoding"]),
        date: time(&value["date_us"]),
        intended_receiver: agents(&value["intended_receivers"]),
        received: value.get("received").map(received),
        transport_behaviour: behaviour.map(Text::into_bytes),
        user_defined: user_texts(&value["user_params"]),
    }
}

fn received(value: &Value) -> Received {
    Received {
        by: text(&value["by"]),
        from: optional_text(&value["from"]),
        date: time(&value["date_us"]).unwrap(),
        id: optional_text(&value["id"]),
        via: optional_text(&value["via"]),
        user_defined: user_texts(&value["user_params"]),
    }
}

pub(crate) fn agent(value: &Value) -> AgentId {
    AgentId {
        name: text(&value["name"]),
        addresses: list(&value["addresses"]).map(text).collect(),
        resolvers: agents(&value["resolvers"]),
        user_defined: user_defined(&value["user_params"]),
    }
}

fn agents(value: &Value) -> Vec<AgentId> {
    list(value).map(agent).collect()
}

fn user_defined(value: &Value) -> Vec<UserDefined> {
    list(value)
        .map(|parameter| {
            let value = Expression::String(text(&parameter["value"]));
            UserDefined::new(text(&parameter["name"]), value)
        })
        .collect()
}

fn user_texts(value: &Value) -> Vec<(Text, Text)> {
    list(value)
        .map(|parameter| (text(&parameter["name"]), text(&parameter["value"])))
        .collect()
}

/// The machine of the recordings was in UTC and wrote no zone.
fn time(microseconds: &Value) -> Option<FipaTime> {
    microseconds
        .as_i64()
        .map(|microseconds| FipaTime::Absolute {
            unix_millis: microseconds / 1000,
            zone: Zone::Unspecified,
        })
}

fn expression(value: &Value) -> Option<Expression> {
    value.as_str().map(|text| Expression::String(text.into()))
}

fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

fn optional_text(value: &Value) -> Option<Text> {
    value
        .as_str()
        .filter(|text| !text.is_empty())
        .map(Text::from)
}

fn text(value: &Value) -> Text {
    Text::from(string(value))
}

pub(crate) fn string(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}
