//! Recordings of fipa_acl and fipa_services in XML.

mod support;
mod xml_support;

use bytes::Bytes;
use fipa_acl::{
    AgentId, Envelope, FipaTime, Letter, Message, Performative, Received, Representation, Slots,
    Zone,
};
use fipa_codec::xml::{decode_envelope, decode_letter, decode_message, encode_letter};
use fipa_codec::{Fault, Limits, Output};
use support::{expected_message, expected_slots, fipa_acl, recording, string};
use xml_support::{read, read_letter, written};

/// What the encoder of the peer loses.
fn as_written(mut message: Message) -> Message {
    // It takes the content for a text that ends at the first zero octet.
    message.content = message.content.and_then(|content| {
        let end = content.iter().position(|octet| *octet == 0);
        Some(content.slice(..end.unwrap_or(content.len()))).filter(|content| !content.is_empty())
    });
    message
}

#[test]
fn recorded_messages_have_the_values_of_the_index() {
    let entries = fipa_acl("xml", "message");
    for (name, octets, entry) in &entries {
        let expected = as_written(expected_message(&entry["message"]));
        assert!(read(octets) == expected, "{name}: {expected:?}");
    }
    let lost: Vec<_> = entries
        .iter()
        .map(|(name, _, entry)| (name, expected_message(&entry["message"])))
        .filter(|(_, message)| as_written(message.clone()) != *message)
        .map(|(name, _)| name.as_str())
        .collect();
    let zero_octets = [
        "content_nul_small",
        "content_nul_only",
        "content_bin_255",
        "content_bin_300",
        "content_bin_65535",
        "content_bin_70k",
    ];
    assert_eq!(lost, zero_octets);
}

#[test]
fn recorded_messages_come_back_unchanged() {
    for (name, octets, _) in fipa_acl("xml", "message") {
        let mut message = read(octets);
        if let Some(FipaTime::Absolute { zone, .. }) = &mut message.reply_by {
            *zone = Zone::Utc;
        }
        assert!(read(written(&message)) == message, "{name}");
    }
}

/// What the encoder of the peer does not write.
fn without_behaviour(mut slots: Slots) -> Slots {
    slots.transport_behaviour = None;
    slots
}

#[test]
fn recorded_envelopes_have_the_layers_of_the_index() {
    for (name, octets, entry) in fipa_acl("xml", "envelope") {
        let envelope = &entry["envelope"];
        let extra = envelope["extra"].as_array().unwrap().iter();
        let expected = Envelope {
            base: without_behaviour(expected_slots(&envelope["base"])),
            overlays: extra.map(expected_slots).map(without_behaviour).collect(),
        };
        let letter = read_letter(octets);
        assert_eq!(letter.envelope, expected, "{name}");
        let flattened = without_behaviour(Slots {
            received: None,
            ..expected_slots(&envelope["flattened"])
        });
        assert_eq!(letter.envelope.flattened(), flattened, "{name}");
    }
}

#[test]
fn payloads_of_recorded_envelopes_are_the_recorded_ones() {
    for (name, octets, entry) in fipa_acl("xml", "envelope") {
        let payload = read_letter(octets).payload;
        let file = string(&entry["payload_file"]);
        assert_eq!(payload, recording(&format!("fipa_acl/{file}")), "{name}");
        if entry["message_representation"] == "xml" {
            let expected = as_written(expected_message(&entry["message"]));
            assert_eq!(read(payload), expected, "{name}");
        }
    }
}

#[test]
fn recorded_envelopes_come_back_unchanged() {
    for (name, octets, _) in fipa_acl("xml", "envelope") {
        let mut letter = read_letter(octets);
        let mut out = Output::new();
        encode_letter(&letter, &mut out).unwrap_or_else(|error| panic!("{name}: {error}"));
        in_utc(&mut letter.envelope);
        assert_eq!(read_letter(out.take_bytes()), letter, "{name}");
    }
}

fn in_utc(envelope: &mut Envelope) {
    for slots in std::iter::once(&mut envelope.base).chain(&mut envelope.overlays) {
        let stamp = slots.received.as_mut().map(|received| &mut received.date);
        for date in slots.date.iter_mut().chain(stamp) {
            if let FipaTime::Absolute { zone, .. } = date {
                *zone = Zone::Utc;
            }
        }
    }
}

#[test]
fn hand_written_messages_mean_what_the_standard_says() {
    for (name, octets, _) in fipa_acl("xml", "decode-only-message") {
        let expected = match name.as_str() {
            // What is unknown is ignored.
            "dec_xml_unknown_elem" => Ok(Message::new(Performative::Inform)),
            // A message without an act says nothing.
            "dec_xml_no_act" => Err(Fault::Violation),
            "dec_xml_garbage" => Err(Fault::Malformed),
            _ => panic!("{name} is not in the table"),
        };
        let decoded = decode_message(&octets, &Limits::default());
        assert_eq!(decoded.map_err(|error| error.fault), expected, "{name}");
    }
}

fn local(unix_millis: i64) -> FipaTime {
    FipaTime::Absolute {
        unix_millis,
        zone: Zone::Unspecified,
    }
}

fn stamp(by: &str, id: Option<&str>) -> Option<Received> {
    Some(Received {
        by: by.into(),
        from: None,
        date: local(957_760_011_481),
        id: id.map(Into::into),
        via: None,
        user_defined: Vec::new(),
    })
}

#[test]
fn hand_written_envelopes_mean_what_the_standard_says() {
    for (name, octets, _) in fipa_acl("xml", "decode-only-envelope") {
        let expected = match name.as_str() {
            "decenv_spec_example" => Slots {
                to: vec![AgentId::new("receiver@foo.com").address("http://foo.com/acc")],
                from: Some(AgentId::new("sender@bar.com")),
                acl_representation: Some(Representation::Xml),
                date: Some(local(957_760_011_481)),
                received: stamp("http://foo.com/acc", Some("123456789")),
                ..Slots::default()
            },
            // Only the order of the numbers counts. What is unknown is ignored.
            "decenv_xml_index2first" | "decenv_xml_unknown_elem" => Slots::default(),
            "decenv_xml_received_url" => Slots {
                received: stamp("http://a", None),
                ..Slots::default()
            },
            "decenv_xml_date_Z" => Slots {
                date: Some(local(957_760_011_481)),
                ..Slots::default()
            },
            _ => panic!("{name} is not in the table"),
        };
        let letter = Letter {
            envelope: Envelope::new(expected),
            payload: Bytes::from_static(b"PAY"),
        };
        assert_eq!(
            decode_letter(&octets, &Limits::default()),
            Ok(letter),
            "{name}"
        );
    }
}

#[test]
fn a_letter_adapted_to_jade_is_read() {
    let letter = read_letter(recording("fipa_acl/env_jade_adapted.xml.bin"));
    assert_eq!(
        letter.envelope.acl_representation(),
        Some(&Representation::String)
    );
    assert_eq!(
        letter.envelope.payload_length(),
        Some(letter.payload.len() as u64)
    );
    assert_eq!(letter.envelope.overlays.len(), 3);
}

#[test]
fn a_payload_begins_behind_the_first_end_tag() {
    let octets = recording("fipa_acl/env_payload_contains_endtag_msg_string.xml.bin");
    let (_, begin) = decode_envelope(&octets, &Limits::default()).unwrap();
    assert!(octets[..begin].ends_with(b"</params></envelope>"));
    assert!(octets[begin..].starts_with(b"(inform:sender"));
}
