//! Messages and envelopes in XML, written and read.

// Not every test uses everything.
#![allow(dead_code)]

use bytes::Bytes;
use fipa_acl::{
    AgentId, Envelope, Expression, Message, Performative, Received, Representation, Slots, Text,
    UserDefined,
};
use fipa_codec::xml::{
    decode_envelope, decode_letter, decode_message, encode_envelope, encode_message,
};
use fipa_codec::{Fault, Limits, Output};

pub(crate) fn octets(text: impl AsRef<[u8]>) -> Bytes {
    Bytes::copy_from_slice(text.as_ref())
}

pub(crate) fn read(text: impl AsRef<[u8]>) -> Message {
    let octets = octets(text);
    decode_message(&octets, &Limits::default())
        .unwrap_or_else(|error| panic!("{error}: {octets:?}"))
}

pub(crate) fn read_envelope(text: impl AsRef<[u8]>) -> Envelope {
    let octets = octets(text);
    let (envelope, _) = decode_envelope(&octets, &Limits::default())
        .unwrap_or_else(|error| panic!("{error}: {octets:?}"));
    envelope
}

pub(crate) fn read_letter(text: impl AsRef<[u8]>) -> fipa_acl::Letter {
    let octets = octets(text);
    decode_letter(&octets, &Limits::default()).unwrap_or_else(|error| panic!("{error}: {octets:?}"))
}

/// Where a message is refused, and whose fault it is.
pub(crate) fn refused(text: impl AsRef<[u8]>) -> (usize, Fault) {
    match decode_message(&octets(text), &Limits::default()) {
        Err(error) => (error.offset, error.fault),
        Ok(message) => panic!("{message:?}"),
    }
}

/// Where an envelope is refused, and whose fault it is.
pub(crate) fn refused_envelope(text: impl AsRef<[u8]>) -> (usize, Fault) {
    match decode_envelope(&octets(text), &Limits::default()) {
        Err(error) => (error.offset, error.fault),
        Ok((envelope, _)) => panic!("{envelope:?}"),
    }
}

pub(crate) fn written(message: &Message) -> Bytes {
    let mut out = Output::new();
    encode_message(message, &mut out).unwrap_or_else(|error| panic!("{error}: {message:?}"));
    out.take_bytes()
}

pub(crate) fn written_envelope(envelope: &Envelope) -> Bytes {
    let mut out = Output::new();
    encode_envelope(envelope, &mut out).unwrap_or_else(|error| panic!("{error}: {envelope:?}"));
    out.take_bytes()
}

/// The message that XML can hold: its act is one of the standard, texts have no character that XML
/// does not allow. What XML cannot tell apart is made the same: an empty text and an absent one,
/// and a text and the expression that it stands for.
pub(crate) fn message_in_xml(mut message: Message) -> Message {
    if let Performative::Other(_) = message.performative {
        message.performative = Performative::Inform;
    }
    let agents = message.sender.iter_mut().chain(&mut message.receiver);
    agents.chain(&mut message.reply_to).for_each(agent_in_xml);
    message.content = message.content.filter(|content| !content.is_empty());
    for tag in [
        &mut message.language,
        &mut message.encoding,
        &mut message.ontology,
        &mut message.conversation_id,
        &mut message.reply_with,
        &mut message.in_reply_to,
    ] {
        *tag = tag
            .take()
            .map(expression_in_xml)
            .filter(|tag| tag.as_str() != Some(""));
    }
    message.user_defined.iter_mut().for_each(parameter_in_xml);
    message
}

fn agent_in_xml(agent: &mut AgentId) {
    agent.user_defined.iter_mut().for_each(parameter_in_xml);
    agent.resolvers.iter_mut().for_each(agent_in_xml);
}

fn parameter_in_xml(parameter: &mut UserDefined) {
    parameter.value = expression_in_xml(parameter.value.clone());
}

fn expression_in_xml(value: Expression) -> Expression {
    Expression::from(legal(&value.to_string()))
}

/// The envelope that XML can hold, likewise. A name of a representation has no white space at its
/// ends, and the transport behaviour is text.
pub(crate) fn envelope_in_xml(mut envelope: Envelope) -> Envelope {
    slots_in_xml(&mut envelope.base);
    envelope.overlays.iter_mut().for_each(slots_in_xml);
    envelope
}

fn slots_in_xml(slots: &mut Slots) {
    let agents = slots.to.iter_mut().chain(&mut slots.from);
    agents
        .chain(&mut slots.intended_receiver)
        .for_each(agent_in_xml);
    slots.comments = slots.comments.take().and_then(optional);
    slots.payload_encoding = slots.payload_encoding.take().and_then(optional);
    slots.acl_representation = slots.acl_representation.take().and_then(|name| {
        let name = Text::from(legal(name.as_str()).trim_matches([' ', '\t', '\r', '\n']));
        Some(Representation::from(name)).filter(|name| !name.as_str().is_empty())
    });
    slots.transport_behaviour = slots
        .transport_behaviour
        .take()
        .and_then(|behaviour| optional(Text::from_utf8_lossy(behaviour)).map(Text::into_bytes));
    slots.received = slots.received.take().and_then(stamp_in_xml);
    slots
        .user_defined
        .iter_mut()
        .for_each(|(_, value)| *value = legal(value));
}

/// A stamp that does not say by whom it is is none.
fn stamp_in_xml(stamp: Received) -> Option<Received> {
    let mut user_defined = stamp.user_defined;
    user_defined
        .iter_mut()
        .for_each(|(_, value)| *value = legal(value));
    Some(Received {
        by: optional(stamp.by)?,
        from: stamp.from.and_then(optional),
        date: stamp.date,
        id: stamp.id.and_then(optional),
        via: stamp.via.and_then(optional),
        user_defined,
    })
}

fn optional(text: Text) -> Option<Text> {
    Some(legal(&text)).filter(|text| !text.is_empty())
}

/// The text without the characters that XML 1.0 does not allow.
fn legal(text: &str) -> Text {
    let is_legal = |character: char| {
        !matches!(character, '\0'..='\u{1f}' | '\u{fffe}' | '\u{ffff}')
            || matches!(character, '\t' | '\r' | '\n')
    };
    Text::from(text.chars().filter(|c| is_legal(*c)).collect::<String>())
}
