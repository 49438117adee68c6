//! What is accepted beyond the letter of the standards, and what is not.

mod support;

use bytes::Bytes;
use fipa_acl::{Envelope, FipaTime, Message, Performative, Received, Slots};
use fipa_codec::bit_efficient::{
    decode_letter, decode_letter_prefix, decode_message, decode_message_prefix, encode_envelope,
    encode_overlay,
};
use fipa_codec::{Fault, Form, Limits, Output, detect};
use support::{hex, letter, message};

/// An inform with this parameter.
fn with(parameter: &[u8]) -> Message {
    message([b"\xfa\x10\x08", parameter, b"\x01"].concat())
}

fn fault(octets: &[u8]) -> Fault {
    let octets = Bytes::copy_from_slice(octets);
    decode_message(&octets, &Limits::default())
        .unwrap_err()
        .fault
}

#[test]
fn text_in_literals_may_be_quoted_counted_or_bare() {
    for (literal, text) in [
        (&b"\"a b\""[..], "a b"),
        (b"\"say \\\"hi\\\" \\ \"", "say \"hi\" \\ "),
        (b"\"a\"b\\c\"", "a\"b\\c"),
        (b"\"", "\""),
        (b"\"\"", ""),
        (b"", ""),
        (b"a b", "a b"),
        (b"#3\"a b", "a b"),
        (b"#4\"a\0 b", "a\0 b"),
        (b"#99\"a b", "a b"),
        (b"#1\"a b", "a b"),
        (b"#99999999999999999999999999\"a b", "a b"),
        (b"#\"a", "#\"a"),
        (b"#a\"", "#a\""),
        (b"gr\xfc\xdf", "gr\u{fffd}\u{fffd}"),
    ] {
        let parameter = [b"\x09\x14", literal, b"\0"].concat();
        assert_eq!(with(&parameter).language.unwrap().as_str(), Some(text));
    }
}

#[test]
fn content_may_stand_in_any_form_of_an_expression() {
    for (octets, content) in [
        (&b"\x10word\0"[..], "word"),
        (b"\x12\x53\x00", "42"),
        (b"\x14bare text\0", "bare text"),
        (b"\xff\x14\"quoted\"\0", "quoted"),
        (b"\xff\x16\x02hi", "hi"),
        (b"\x19\x00\x00\x00\x02hi", "hi"),
        (b"\x70a\0\x10b\0\x40", "(a b)"),
    ] {
        let parameter = [b"\x04", octets].concat();
        assert_eq!(with(&parameter).content.unwrap(), content);
    }
}

#[test]
fn contents_share_the_buffer_of_the_input() {
    let octets = hex("fa 10 08 09 10 73 6c 00 04 16 02 68 69 01");
    let message = decode_message(&octets, &Limits::default()).unwrap();
    assert_eq!(message.content.unwrap().as_ptr(), octets[11..].as_ptr());
    let octets = support::recording("mts/sent_00_to_agent-b.bin");
    let payload = letter(octets.clone()).payload;
    assert_eq!(payload.as_ptr_range().end, octets.as_ptr_range().end);
}

#[test]
fn the_last_of_a_repeated_parameter_counts_and_prefixes_are_taken_off() {
    let parameters = b"\x09\x10a\0\x03\x02\x10a\0\x01\x01\x09\x10b\0\x03\x02\x10b\0\x01\x01\
        \x00\x10X-x-n\0\x10v\0";
    let expected = Message::new(Performative::Inform)
        .to("b")
        .language("b")
        .user_defined("n", "v");
    assert_eq!(with(parameters), expected);
}

#[test]
fn versions_1_are_read_and_others_unsupported() {
    for version in [0x10, 0x11, 0x01] {
        message(vec![0xfa, version, 0x08, 0x01]);
    }
    assert_eq!(fault(&[0xfa, 0x20, 0x08, 0x01]), Fault::Unsupported);
}

#[test]
fn only_line_ends_may_follow_a_message() {
    message(&b"\xfa\x10\x08\x01\r\n"[..]);
    assert_eq!(
        fault(b"\xfa\x10\x08\x01\n\xfa\x10\x08\x01"),
        Fault::Malformed
    );
    let two = Bytes::from_static(b"\xfa\x10\x08\x01\xfa\x10\x08\x01");
    let (_, used) = decode_message_prefix(&two, &Limits::default()).unwrap();
    assert_eq!(used, 4);
}

#[test]
fn what_is_no_message_is_refused_where_it_goes_wrong() {
    for (octets, offset, expected) in [
        (&b"\xfa\x10\x17\x01"[..], 2, Fault::Malformed),
        (b"\xfa\x10\x08\x0e\x01", 3, Fault::Malformed),
        (b"\xfa\x10\x08\x09\x61\x01", 4, Fault::Malformed),
        (b"\xfa\x10\x08\x09\x11\x00\x01", 5, Fault::Unsupported),
        (b"\xfa\x10\x08\x09\x12\x2b\x01", 5, Fault::Malformed),
        (b"\xfa\x10\x08\x09\x12\x00\x01", 5, Fault::Malformed),
        (b"\xfa\x10\x08\x06\x23", 4, Fault::Malformed),
        (
            b"\xfa\x10\x08\x06\x20\x31\x37\x24\x13\x14\x15\x16\x78\x90\x01",
            5,
            Fault::Violation,
        ),
        (
            b"\xfa\x10\x08\x06\x20\x31\x37\x00\x13\x14\x15\x16\x78\x90\x01",
            5,
            Fault::Malformed,
        ),
        (b"\xfa\x10\x08\x0d\x14abc", 5, Fault::Malformed),
    ] {
        let input = Bytes::copy_from_slice(octets);
        let error = decode_message(&input, &Limits::default()).unwrap_err();
        assert_eq!(
            (error.offset, error.fault),
            (offset, expected),
            "{octets:x?}"
        );
    }
}

const HEAD: &[u8] = b"\x10\x20\x31\x25\x16\x18\x24\x56\x1a\x12\x34";

/// A base envelope with its true length and no payload.
fn base_with(parameters: &[u8]) -> Slots {
    let len = u8::try_from(3 + HEAD.len() + parameters.len() + 1).unwrap();
    let octets = [b"\xfe\x00", &[len][..], HEAD, parameters, b"\x01"].concat();
    letter(octets).envelope.base
}

#[test]
fn both_codes_of_user_defined_parameters_of_agents_are_read_in_envelopes() {
    let parameters = b"\x03\x02a\0\x04#3\"X-p\0v\0\x05q\0\x14\"w\"\0\x05r\0\x16\x02zz\x01";
    let from = base_with(parameters).from.unwrap();
    let values: Vec<_> = from
        .user_defined
        .iter()
        .map(|parameter| (&*parameter.name, parameter.value.as_str().unwrap()))
        .collect();
    assert_eq!(values, [("p", "v"), ("q", "w"), ("r", "zz")]);
}

#[test]
fn both_forms_of_the_payload_length_are_read() {
    assert_eq!(base_with(b"\x06\x23\x40").payload_length, Some(123));
    assert_eq!(base_with(b"\x06\x12\x23\x40").payload_length, Some(123));
    assert_eq!(base_with(b"\x06\x13\x37\x00").payload_length, Some(26));
}

#[test]
fn a_removed_parameter_is_skipped_if_the_length_is_true() {
    let base = base_with(b"\x05note\0\x08anything");
    assert_eq!(base.comments.unwrap(), *"note");
    let octets = [b"\xfe\x00\x40", HEAD, b"\x08anything\x01"].concat();
    let error = decode_letter(&octets.into(), &Limits::default()).unwrap_err();
    assert_eq!((error.fault, error.offset), (Fault::Malformed, 14));
}

#[test]
fn a_payload_ends_at_its_announced_length_if_that_fits() {
    for (announced, payload) in [(b"\x40", "PAY"), (b"\xa0", "PAYLOAD")] {
        let octets: Bytes = [b"\xfe\x00\x11", HEAD, b"\x06", announced, b"\x01PAYLOAD"]
            .concat()
            .into();
        let (letter, used) = decode_letter_prefix(&octets, &Limits::default()).unwrap();
        assert_eq!(letter.payload, payload);
        assert_eq!(used, 17 + payload.len());
        assert_eq!(support::letter(octets).payload, "PAYLOAD");
    }
}

/// An overlay whose stamp is by this, with its true length or another.
fn overlay(by: &str, is_true: bool) -> Vec<u8> {
    let slots = Slots {
        received: Some(Received {
            by: by.into(),
            from: None,
            date: FipaTime::from_unix_millis(0),
            id: None,
            via: None,
            user_defined: Vec::new(),
        }),
        ..Slots::default()
    };
    let mut out = Output::new();
    encode_overlay(&slots, &mut out).unwrap();
    let mut octets = out.take_bytes().to_vec();
    if !is_true {
        octets[2] = 5;
    }
    octets
}

/// The stamps in the order of travel of overlays that stand in this order; those in capitals have
/// true lengths.
fn order(overlays: &str) -> String {
    let mut octets: Vec<u8> = overlays
        .chars()
        .flat_map(|by| overlay(&by.to_string(), by.is_uppercase()))
        .collect();
    octets.extend(b"\xfe\x00\x0f");
    octets.extend(HEAD);
    octets.push(1);
    let envelope: Envelope = letter(octets).envelope;
    envelope
        .stamps()
        .map(|stamp| stamp.by.to_string())
        .collect()
}

#[test]
fn overlays_are_ordered_by_who_wrote_them() {
    assert_eq!(order("ABC"), "CBA");
    assert_eq!(order("abc"), "abc");
    assert_eq!(order("ABcd"), "cdBA");
    assert_eq!(order("abCD"), "abCD");
    assert_eq!(order("AbcD"), "bcDA");
    assert_eq!(order("aBc"), "acB");
}

#[test]
fn an_empty_stamp_is_none_and_a_repeated_one_is_one() {
    let time = b"\x20\x2a\x81\x12\x12\x11\x11\x11\x11\x11";
    let empty = [b"\xfd\x00\x15#0\"\0", &time[..], b"\x01\x05note\0\x01"].concat();
    let stamp = [
        b"\xfd\x00\x15#1\"m\0",
        &time[..],
        b"\x01\x0a#1\"m\0",
        time,
        b"\x031\0\x01\x01",
    ];
    let base = [b"\xfe\x00\x0f", HEAD, b"\x01"].concat();
    let letter = letter([empty, stamp.concat(), base].concat());
    assert_eq!(letter.envelope.overlays[0].received, None);
    let stamps: Vec<_> = letter.envelope.stamps().collect();
    assert_eq!(stamps.len(), 1);
    assert_eq!(stamps[0].id.as_ref().unwrap(), "1");
}

#[test]
fn a_long_envelope_has_a_long_length() {
    for (len, prefix) in [
        (65_000, &b"\xfe\xfe"[..]),
        (65_536, b"\xfe\x00\x00\x00\x01\x00"),
    ] {
        let envelope = Envelope::new(Slots {
            comments: Some("c".repeat(len).into()),
            ..base_with(b"\x05note\0")
        });
        let mut out = Output::new();
        encode_envelope(&envelope, &mut out).unwrap();
        let octets = out.take_bytes();
        assert_eq!(&octets[..prefix.len()], prefix);
        let read = letter(octets).envelope;
        assert_eq!(read.base.comments, envelope.base.comments);
    }
}

#[test]
fn the_first_octets_tell_the_form() {
    for (octets, form) in [
        (&b"\xfa\x10"[..], Form::BitEfficientMessage),
        (b"\xfb", Form::BitEfficientMessage),
        (b"\xfc", Form::BitEfficientMessage),
        (b"\xfd\x00", Form::BitEfficientEnvelope),
        (b"\xfe\xff\x00", Form::BitEfficientEnvelope),
        (b"\xfe\xff\x00<\x00?", Form::Xml),
        (b"\xef\xbb\xbf<?xml", Form::Xml),
        (b"\r\n <fipa-message", Form::Xml),
        (b"(inform)", Form::String),
        (b"", Form::Unknown),
        (b"inform", Form::Unknown),
    ] {
        assert_eq!(detect(octets), form, "{octets:x?}");
    }
}
