//! Recordings of fipa_acl, bit-efficient.

mod support;

use fipa_acl::{AgentId, Expression, FipaTime, Message, Performative, Representation, Zone};
use fipa_codec::bit_efficient::{decode_letter, decode_message, encode_letter, encode_message};
use fipa_codec::{Fault, Limits, Output};
use support::{expected_message, expected_slots, fipa_acl, hex, letter, message, string};

/// The encoder drops resolvers of resolvers.
fn without_nested_resolvers(mut message: Message) -> Message {
    for agent in &mut message.receiver {
        for resolver in &mut agent.resolvers {
            resolver.resolvers.clear();
        }
    }
    message
}

#[test]
fn recorded_messages_have_the_values_of_the_index() {
    for (name, octets, entry) in fipa_acl("bitefficient", "message") {
        let mut expected = expected_message(&entry["message"]);
        if name == "receiver_resolvers_nested3" {
            expected = without_nested_resolvers(expected);
        }
        assert_eq!(message(octets), expected, "{name}");
    }
}

#[test]
fn recorded_messages_come_back_unchanged() {
    for (name, octets, _) in fipa_acl("bitefficient", "message") {
        let mut decoded = message(octets);
        let mut out = Output::new();
        encode_message(&decoded, &mut out).unwrap_or_else(|error| panic!("{name}: {error}"));
        if let Some(FipaTime::Absolute { zone, .. }) = &mut decoded.reply_by {
            *zone = Zone::Utc;
        }
        assert_eq!(message(out.take_bytes()), decoded, "{name}");
    }
}

#[test]
fn recorded_envelopes_have_the_layers_of_the_index() {
    for (name, octets, entry) in fipa_acl("bitefficient", "envelope") {
        let letter = letter(octets);
        let mut base = expected_slots(&entry["envelope"]["base"]);
        if name == "env_userparams" {
            // The encoder leaves them out.
            base.user_defined.clear();
        }
        let extra = entry["envelope"]["extra"].as_array().unwrap();
        let mut overlays: Vec<_> = extra.iter().map(expected_slots).collect();
        for overlay in &mut overlays {
            // An overlay has no place for a date.
            overlay.date = None;
        }
        assert_eq!(letter.envelope.base, base, "{name}");
        assert_eq!(letter.envelope.overlays, overlays, "{name}");
    }
}

#[test]
fn recorded_envelopes_flatten_as_the_peer_flattens() {
    for (name, octets, entry) in fipa_acl("bitefficient", "envelope") {
        let mut flattened = expected_slots(&entry["envelope"]["flattened"]);
        flattened.received = None;
        if name == "env_userparams" {
            flattened.user_defined.clear();
        }
        if name == "env_overlay_all" {
            flattened.date = expected_slots(&entry["envelope"]["base"]).date;
        }
        assert_eq!(letter(octets).envelope.flattened(), flattened, "{name}");
    }
}

#[test]
fn payloads_of_recorded_envelopes_are_the_recorded_ones() {
    for (name, octets, entry) in fipa_acl("bitefficient", "envelope") {
        let payload = letter(octets).payload;
        let file = string(&entry["payload_file"]);
        assert_eq!(
            payload,
            support::recording(&format!("fipa_acl/{file}")),
            "{name}"
        );
        if entry["message_representation"] == "bitefficient" {
            assert_eq!(
                message(payload),
                expected_message(&entry["message"]),
                "{name}"
            );
        }
    }
}

#[test]
fn recorded_envelopes_come_back_unchanged() {
    for (name, octets, _) in fipa_acl("bitefficient", "envelope") {
        let first = letter(octets);
        let mut out = Output::new();
        encode_letter(&first, &mut out).unwrap_or_else(|error| panic!("{name}: {error}"));
        let again = letter(out.take_bytes());
        assert_eq!(again.payload, first.payload, "{name}");
        assert_eq!(
            again.envelope.overlays.len(),
            first.envelope.overlays.len(),
            "{name}"
        );
        assert_eq!(again.envelope.to(), first.envelope.to(), "{name}");
        let by = |letter: &fipa_acl::Letter| -> Vec<_> {
            letter
                .envelope
                .stamps()
                .map(|stamp| stamp.id.clone())
                .collect()
        };
        assert_eq!(by(&again), by(&first), "{name}");
    }
}

fn inform() -> Message {
    Message::new(Performative::Inform)
}

fn absolute(zone: Zone) -> Message {
    inform().reply_by(FipaTime::Absolute {
        unix_millis: 1_293_105_637_980,
        zone,
    })
}

/// What the standard says that the hand-written messages mean.
fn decode_only_message(name: &str) -> Result<Message, Fault> {
    let b = |octets: &'static [u8]| bytes::Bytes::from_static(octets);
    Ok(match name {
        "dec_min" | "dec_hdr_fb" | "dec_hdr_fc" | "dec_receivers_empty" | "dec_perf_user_case" => {
            inform()
        }
        "dec_trailing_newline" => inform(),
        "dec_content_literal" => inform().content("say \"hi\""),
        "dec_content_bytelen_str_nul" => inform().content(b(b"he\0lo")),
        "dec_content_len16" => inform().content("hello"),
        // Announces 2 GiB.
        "dec_content_len32_truncated" => return Err(Fault::Malformed),
        "dec_lang_word" => inform().language("fipa-sl"),
        "dec_lang_number" => inform().language(Expression::Number("123".into())),
        "dec_lang_ff" => inform().language("sl"),
        "dec_lang_expr60" => inform().language("(a b)"),
        "dec_replyby_20" => absolute(Zone::Unspecified),
        "dec_replyby_24Z" => absolute(Zone::Utc),
        "dec_replyby_21" => inform().reply_by("+PT1M".parse::<FipaTime>().unwrap()),
        "dec_replyby_22" => inform().reply_by("-PT1M".parse::<FipaTime>().unwrap()),
        "dec_receivers_dup" => inform().to("a").to("a"),
        "dec_sender_aid_userparam" => inform().from_agent(AgentId::new("a").user_defined("p", "v")),
        "dec_param_twice" => inform().language("b"),
        // No legal words, but readable ones.
        "dec_word_starts_digit" => inform().protocol("1abc"),
        "dec_word_utf8" => inform().protocol("pröt"),
        _ => panic!("{name} is not in the table"),
    })
}

#[test]
fn hand_written_messages_mean_what_the_standard_says() {
    for (name, octets, _) in fipa_acl("bitefficient", "decode-only-message") {
        let decoded = decode_message(&octets, &Limits::default());
        assert_eq!(
            decoded.map_err(|error| error.fault),
            decode_only_message(&name),
            "{name}"
        );
    }
}

/// What the standard says that the hand-written envelopes mean: from, to, representation,
/// announced length and payload.
type Seen = (
    Option<&'static str>,
    Option<&'static str>,
    Representation,
    Option<u64>,
    &'static [u8],
);

fn decode_only_envelope(name: &str) -> Result<Seen, Fault> {
    let be = Representation::BitEfficient;
    Ok(match name {
        "decenv_spec_min" => (None, None, be, None, b"\xfa\x10\x08\x01"),
        "decenv_spec_paramorder" => (Some("s"), Some("r"), be, None, b"PAY"),
        "decenv_jumbo_base" | "decenv_wrong_len" | "decenv_userdef_param" => {
            (None, None, be, None, b"PAY")
        }
        "decenv_userdef_repr" => (
            None,
            None,
            Representation::Other("foo".into()),
            None,
            b"PAY",
        ),
        // A removed parameter, and a length that does not lead behind it.
        "decenv_encrypted_08" => return Err(Fault::Malformed),
        "decenv_payload_len_plain" => (None, None, be, Some(123), b"PAY"),
        _ => panic!("{name} is not in the table"),
    })
}

#[test]
fn hand_written_envelopes_mean_what_the_standard_says() {
    for (name, octets, _) in fipa_acl("bitefficient", "decode-only-envelope") {
        let letter = match decode_letter(&octets, &Limits::default()) {
            Ok(letter) => letter,
            Err(error) => {
                assert_eq!(
                    Err(error.fault),
                    decode_only_envelope(&name).map(|_| ()),
                    "{name}"
                );
                continue;
            }
        };
        let (from, to, representation, length, payload) = decode_only_envelope(&name).unwrap();
        let envelope = &letter.envelope;
        assert_eq!(envelope.from().map(|agent| &*agent.name), from, "{name}");
        assert_eq!(
            envelope.to().first().map(|agent| &*agent.name),
            to,
            "{name}"
        );
        assert_eq!(
            envelope.acl_representation(),
            Some(&representation),
            "{name}"
        );
        assert_eq!(envelope.payload_length(), length, "{name}");
        assert_eq!(letter.payload, payload, "{name}");
        assert_eq!(
            envelope.date().unwrap().unix_millis(),
            Some(1_399_470_309_123),
            "{name}"
        );
    }
}

#[test]
fn a_user_defined_parameter_of_a_hand_written_envelope_is_read() {
    let octets = support::recording("fipa_acl/decenv_userdef_param.bitefficient.bin");
    let base = letter(octets).envelope.base;
    assert_eq!(base.user_defined, [("a".into(), "v".into())]);
}

#[test]
fn dates_with_padding_in_odd_places_are_read() {
    let octets = hex("fa 01 08 06 26 31 21 50 02 29 11 11 33 30 5a 01");
    let FipaTime::Relative(span) = message(octets).reply_by.unwrap() else {
        panic!("not relative");
    };
    assert!(span.negative);
    assert_eq!((span.years, span.months, span.days), (2010, 4, 1));
    assert_eq!(
        (span.hours, span.minutes, span.seconds, span.millis),
        (18, 0, 0, 222)
    );
}
