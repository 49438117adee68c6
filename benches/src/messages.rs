//! The message of fipa_acl's own benchmark (its `src/benchmark.cpp`), and an envelope around it.

use fipa_acl::{AgentId, Envelope, FipaTime, Message, Performative, Representation, Slots};

/// When the message wants its answer, and when the envelope was written.
const REPLY_BY: i64 = 1_293_105_637_980;
const DATE: i64 = 1_399_470_309_123;

/// The message, with so many octets of content.
pub fn message(octets: usize) -> Message {
    Message::new(Performative::Request)
        .from_agent("proxy")
        .to("crex_0")
        .reply_to("proxy")
        .protocol("RIMRES")
        .language("test language")
        .encoding("test encoding")
        .ontology("test ontology")
        .reply_with("test reply_with")
        .reply_by(FipaTime::from_unix_millis(REPLY_BY))
        .conversation_id("test conversationID")
        .content(content(octets))
}

/// Text of the characters `0` to `W`, the same in every run.
pub fn content(octets: usize) -> Vec<u8> {
    let mut state = 12_345_u32;
    let mut next = || {
        state = state.wrapping_mul(1_103_515_245).wrapping_add(12_345);
        b'0' + ((state >> 16 & 0x7fff) % 40) as u8
    };
    std::iter::repeat_with(&mut next).take(octets).collect()
}

/// The envelope that fipa_acl makes for the message in this representation, with so many octets.
pub fn envelope(representation: Representation, octets: usize) -> Envelope {
    Envelope::new(Slots {
        to: vec![AgentId::new("crex_0")],
        from: Some(AgentId::new("proxy")),
        intended_receiver: vec![AgentId::new("crex_0")],
        acl_representation: Some(representation),
        payload_length: Some(octets as u64),
        payload_encoding: Some("test encoding".into()),
        date: Some(FipaTime::from_unix_millis(DATE)),
        ..Slots::default()
    })
}
