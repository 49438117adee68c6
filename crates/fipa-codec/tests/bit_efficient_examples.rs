//! Worked examples, octet by octet.

mod support;

use bytes::Bytes;
use fipa_acl::{
    AgentId, Envelope, Expression, FipaTime, Letter, Message, Performative, Received,
    Representation, Slots,
};
use fipa_codec::Limits;
use fipa_codec::Output;
use fipa_codec::bit_efficient::{decode_envelope, encode_letter, encode_message, encode_overlay};
use support::{hex, letter, message};

fn encoded(message: &Message) -> Bytes {
    let mut out = Output::new();
    encode_message(message, &mut out).unwrap();
    out.take_bytes()
}

fn time(text: &str) -> FipaTime {
    text.parse().unwrap()
}

const MINIMAL: &str = "fa 10 08 02 02 10 61 40 68 00 01 03 02 10 62 40 68 00 01 01
    04 16 02 68 69 01";

fn minimal() -> Message {
    Message::new(Performative::Inform)
        .from_agent("a@h")
        .to("b@h")
        .content("hi")
}

#[test]
fn a_minimal_message_is_read_and_written() {
    assert_eq!(message(hex(MINIMAL)), minimal());
    assert_eq!(encoded(&minimal()), hex(MINIMAL));
}

fn with_most_parameters() -> Message {
    Message::new(Performative::Request)
        .from_agent(AgentId::new("i@p").address("http://p:80/acc"))
        .to("j@q")
        .language("fipa-sl0")
        .protocol("fipa-request")
        .conversation_id("c 1")
        .reply_with("r1")
        .reply_by(time("2026-01-02T03:04:05.678Z"))
        .user_defined("n", Expression::Number("42".into()))
        .content("((action j@q (open)))")
}

#[test]
fn a_message_with_most_parameters_is_read() {
    let octets = "fa 10 13
        02 02 10 69 40 70 00 02 10 68 74 74 70 3a 2f 2f 70 3a 38 30 2f 61 63 63 00 01 01
        03 02 10 6a 40 71 00 01 01
        09 10 66 69 70 61 2d 73 6c 30 00
        0c 10 66 69 70 61 2d 72 65 71 75 65 73 74 00
        0d 14 22 63 20 31 22 00
        05 10 72 31 00
        06 24 31 37 12 13 14 15 16 78 90 5a
        00 10 58 2d 6e 00 12 53 00
        04 16 15 28 28 61 63 74 69 6f 6e 20 6a 40 71 20 28 6f 70 65 6e 29 29 29
        01";
    assert_eq!(message(hex(octets)), with_most_parameters());
}

#[test]
fn parameters_are_written_in_the_order_of_fipa_acl_and_numbers_as_strings() {
    let octets = "fa 10 13
        02 02 10 69 40 70 00 02 10 68 74 74 70 3a 2f 2f 70 3a 38 30 2f 61 63 63 00 01 01
        03 02 10 6a 40 71 00 01 01
        05 10 72 31 00
        06 24 31 37 12 13 14 15 16 78 90 5a
        09 10 66 69 70 61 2d 73 6c 30 00
        0c 10 66 69 70 61 2d 72 65 71 75 65 73 74 00
        0d 14 22 63 20 31 22 00
        00 10 58 2d 6e 00 14 22 34 32 22 00
        04 16 15 28 28 61 63 74 69 6f 6e 20 6a 40 71 20 28 6f 70 65 6e 29 29 29
        01";
    assert_eq!(encoded(&with_most_parameters()), hex(octets));
}

#[test]
fn a_nested_expression_is_read_with_fused_tokens_and_written_without() {
    let value = Message::new(Performative::Inform).reply_with("(a \"b c\" (1))");
    let fused = "fa 10 08 05 70 61 00 14 22 62 20 63 22 00 72 20 40 40 01";
    assert_eq!(message(hex(fused)), value);
    let bare = "fa 10 08 05 60 10 61 00 14 22 62 20 63 22 00 60 12 20 40 40 01";
    assert_eq!(message(hex(bare)), value);
    assert_eq!(encoded(&value), hex(bare));
}

#[test]
fn tokens_fused_to_closing_parentheses_follow_the_list() {
    // ((a) b) and (plus 1 x) y
    let inner = "fa 10 08 05 60 70 61 00 50 62 00 40 01";
    let value = message(hex(inner)).reply_with.unwrap();
    assert_eq!(value, Expression::from("((a) b)"));
    let behind = "fa 10 08 05 70 70 6c 75 73 00 12 20 10 78 00 50 79 00 01";
    let value = message(hex(behind)).reply_with.unwrap();
    assert_eq!(value.as_str(), Some("(plus 1 x) y"));
}

#[test]
fn lengths_fused_to_parentheses_have_their_own_codes() {
    // ("a") "b": 78 and 58 have 32 bits.
    let octets = "fa 10 08 05 60 78 00 00 00 01 61 58 00 00 00 01 62 40 01";
    let value = message(hex(octets)).reply_with.unwrap();
    assert_eq!(value, Expression::from("((\"a\") \"b\")"));
}

#[test]
fn numbers_are_written_in_nibbles_within_lists() {
    for (number, digits) in [
        ("0", "10"),
        ("7", "80"),
        ("42", "53 00"),
        ("255", "36 60"),
        ("-1.5E3", "e2 f6 d4 00"),
    ] {
        let value = Expression::List(vec![Expression::Number(number.into())]);
        let value = Message::new(Performative::Inform).reply_with(value);
        let octets = hex(&format!("fa 10 08 05 60 12 {digits} 40 01"));
        assert_eq!(encoded(&value), octets, "{number}");
        assert_eq!(message(octets), value, "{number}");
    }
}

#[test]
fn a_relative_date_is_written_as_fields() {
    let value = Message::new(Performative::Inform).reply_by(time("+PT5M"));
    let octets = hex("fa 10 08 06 21 11 11 11 11 11 16 11 11 10 01");
    assert_eq!(encoded(&value), octets);
    assert_eq!(message(octets), value);
}

#[test]
fn zone_letters_are_converted() {
    for (letter, hour) in [
        (b'A', "02"),
        (b'I', "18"),
        (b'K', "17"),
        (b'M', "15"),
        (b'N', "04"),
    ] {
        let mut octets = hex("fa 10 08 06 24 31 37 12 13 14 15 16 78 90 5a 01").to_vec();
        octets[14] = letter;
        let time = message(octets).reply_by.unwrap().to_string();
        assert_eq!(&time[11..13], hour, "{}", char::from(letter));
    }
}

#[test]
fn an_envelope_in_xml_form_with_a_stamp_is_read() {
    let octets = hex("
        fe 00 8a 12 20 31 11 16 19 15 37 62 59 20 02 02
        72 65 63 65 69 76 65 72 40 66 6f 6f 2e 63 6f 6d
        00 02 68 74 74 70 3a 2f 2f 66 6f 6f 2e 63 6f 6d
        2f 61 63 63 00 01 01 01 03 02 73 65 6e 64 65 72
        40 62 61 72 2e 63 6f 6d 00 02 68 74 74 70 3a 2f
        2f 62 61 72 2e 63 6f 6d 2f 61 63 63 00 01 01 0a
        68 74 74 70 3a 2f 2f 66 6f 6f 2e 63 6f 6d 2f 61
        63 63 00 20 31 11 16 19 15 37 62 59 20 03 31 32
        33 34 35 36 37 38 39 00 01 01");
    let (envelope, used) = decode_envelope(&octets, &Limits::default()).unwrap();
    assert_eq!(used, octets.len());
    let date = time("2000-05-08T04:26:51.481");
    let expected = Slots {
        acl_representation: Some(Representation::Xml),
        date: Some(date),
        to: vec![AgentId::new("receiver@foo.com").address("http://foo.com/acc")],
        from: Some(AgentId::new("sender@bar.com").address("http://bar.com/acc")),
        received: Some(Received {
            id: Some("123456789".into()),
            ..stamp("http://foo.com/acc", date)
        }),
        ..Slots::default()
    };
    assert_eq!(envelope, Envelope::new(expected));
}

fn stamp(by: &str, date: FipaTime) -> Received {
    Received {
        by: by.into(),
        from: None,
        date,
        id: None,
        via: None,
        user_defined: Vec::new(),
    }
}

/// The letter of the second example.
fn stamped() -> Letter {
    let base = Slots {
        to: vec!["b@h".into()],
        from: Some("a@h".into()),
        acl_representation: Some(Representation::BitEfficient),
        payload_length: Some(26),
        date: Some(time("2026-01-02T03:04:05.678Z")),
        intended_receiver: vec!["b@h".into()],
        ..Slots::default()
    };
    let overlay = Slots {
        received: Some(Received {
            via: Some("http".into()),
            ..stamp("http://h/acc", time("2026-01-02T03:04:05.700Z"))
        }),
        ..Slots::default()
    };
    Letter {
        envelope: Envelope {
            base,
            overlays: vec![overlay],
        },
        payload: hex(MINIMAL),
    }
}

#[test]
fn a_letter_with_bare_strings_is_read() {
    let octets = format!(
        "fd 00 23 68 74 74 70 3a 2f 2f 68 2f 61 63 63 00
        24 31 37 12 13 14 15 16 81 10 5a 04 68 74 74 70 00 01 01
        fe 00 2b 10 24 31 37 12 13 14 15 16 78 90 5a
        02 02 62 40 68 00 01 01 03 02 61 40 68 00 01
        06 12 37 00 09 02 62 40 68 00 01 01 01 {MINIMAL}"
    );
    assert_eq!(letter(hex(&octets)), stamped());
}

/// The second example with the only form of strings that all peers read.
fn stamped_octets() -> Bytes {
    hex(&format!(
        "fd 00 2a 23 31 32 22 68 74 74 70 3a 2f 2f 68 2f 61 63 63 00
        24 31 37 12 13 14 15 16 81 10 5a 04 23 34 22 68 74 74 70 00 01 01
        fe 00 34 10 24 31 37 12 13 14 15 16 78 90 5a
        02 02 23 33 22 62 40 68 00 01 01 03 02 23 33 22 61 40 68 00 01
        06 12 37 00 09 02 23 33 22 62 40 68 00 01 01 01 {MINIMAL}"
    ))
}

#[test]
fn a_letter_is_written_with_counted_strings() {
    let mut out = Output::new();
    encode_letter(&stamped(), &mut out).unwrap();
    let octets = out.take_bytes();
    assert_eq!(octets, stamped_octets());
    assert_eq!(letter(octets), stamped());
}

#[test]
fn an_overlay_in_front_of_received_octets_is_the_newest() {
    let overlay = Slots {
        received: Some(stamp("next", time("2026-01-02T03:04:06Z"))),
        ..Slots::default()
    };
    let mut out = Output::new();
    encode_overlay(&overlay, &mut out).unwrap();
    out.put_slice(&stamped_octets());
    let mut expected = stamped();
    expected.envelope.overlays.push(overlay);
    assert_eq!(letter(out.take_bytes()), expected);
}

#[test]
fn a_letter_as_fipa_acl_writes_it_is_read() {
    let octets = format!(
        "fd 00 21 23 34 22 6d 74 73 31 00 20 31 37 12 13
        14 15 16 78 90 03 23 31 22 31 00 01 06 12 37 00 01
        fe 00 33 10 20 31 37 12 13 14 15 16 78 90 02 02
        23 33 22 62 40 68 00 01 01 03 02 23 33 22 61 40
        68 00 01 06 12 37 00 09 02 23 33 22 62 40 68 00 01 01 01 {MINIMAL}"
    );
    let letter = letter(hex(&octets));
    assert_eq!(letter.envelope.from(), Some(&"a@h".into()));
    assert_eq!(letter.envelope.intended_receiver(), ["b@h".into()]);
    assert_eq!(letter.envelope.stamps().next().unwrap().by, *"mts1");
    assert_eq!(letter.envelope.payload_length(), Some(26));
    assert_eq!(message(letter.payload), minimal());
}
