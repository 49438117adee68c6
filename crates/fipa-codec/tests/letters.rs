//! Letters and messages in whichever representation they are.

use bytes::Bytes;
use fipa_acl::{Envelope, Letter, Message, Performative, Representation, Slots, Text};
use fipa_codec::{
    DecodeError, EnvelopeRepresentation, Fault, Limits, Output, arbitrary, decode_envelope,
    decode_letter, decode_letter_prefix, decode_message, decode_message_prefix, decode_payload,
    decode_payload_as, encode_letter, encode_message, payload_encoding, payload_representation,
};
use proptest::prelude::*;

const REPRESENTATIONS: [Representation; 3] = [
    Representation::BitEfficient,
    Representation::String,
    Representation::Xml,
];

fn message() -> Message {
    Message::new(Performative::Inform)
        .from_agent("a@h")
        .to("b@h")
        .content("grüß")
}

fn octets_of(representation: &Representation, message: &Message) -> Bytes {
    let mut out = Output::new();
    encode_message(representation, message, &mut out).unwrap();
    out.take_bytes()
}

fn envelope(representation: Option<Representation>, encoding: Option<&str>) -> Envelope {
    Envelope::new(Slots {
        acl_representation: representation,
        payload_encoding: encoding.map(Text::from),
        date: Some(fipa_acl::FipaTime::from_unix_millis(0)),
        ..Slots::default()
    })
}

#[test]
fn messages_are_read_and_written_in_the_named_representation() {
    let limits = Limits::default();
    for representation in &REPRESENTATIONS {
        let octets = octets_of(representation, &message());
        assert_eq!(
            decode_message(representation, &octets, &limits),
            Ok(message())
        );
        let two = Bytes::from([&octets[..], &octets].concat());
        let prefix = decode_message_prefix(representation, &two, &limits);
        assert_eq!(prefix, Ok((message(), octets.len())));
    }
    let unknown = Representation::Other("x".into());
    let error = decode_message(&unknown, &Bytes::new(), &limits).unwrap_err();
    assert_eq!(error.fault, Fault::Unsupported);
    assert!(decode_message_prefix(&unknown, &Bytes::new(), &limits).is_err());
    assert!(encode_message(&unknown, &message(), &mut Output::new()).is_err());
}

#[test]
fn letters_are_read_by_their_first_octets() {
    let limits = Limits::default();
    let letter = Letter {
        envelope: Envelope::new(Slots {
            payload_length: Some(4),
            ..envelope(Some(Representation::String), None).base
        }),
        payload: Bytes::from_static(b"1234"),
    };
    for representation in [
        EnvelopeRepresentation::BitEfficient,
        EnvelopeRepresentation::Xml,
    ] {
        let mut out = Output::new();
        encode_letter(representation, &letter, &mut out).unwrap();
        let octets = out.take_bytes();
        assert_eq!(
            EnvelopeRepresentation::detect(&octets),
            Some(representation)
        );
        assert_eq!(decode_letter(&octets, &limits), Ok(letter.clone()));
        let (envelope, payload) = decode_envelope(&octets, &limits).unwrap();
        assert_eq!((&envelope, payload), (&letter.envelope, octets.len() - 4));
        let more = Bytes::from([&octets[..], b"56"].concat());
        let prefix = decode_letter_prefix(&more, &limits);
        assert_eq!(prefix, Ok((letter.clone(), octets.len())));
    }
    for (other, offset) in [
        (&b""[..], 0),
        (b"(inform)", 0),
        (b"<fipa-message act='inform'/>", 1),
        (b"\xfa\x10\x08\x01", 0),
    ] {
        let other = Bytes::from_static(other);
        let malformed = |error: DecodeError| (error.offset, error.fault);
        let expected = Err((offset, Fault::Malformed));
        assert_eq!(
            decode_letter(&other, &limits).map(drop).map_err(malformed),
            expected
        );
        assert_eq!(
            decode_envelope(&other, &limits)
                .map(drop)
                .map_err(malformed),
            expected
        );
    }
}

#[test]
fn payloads_are_read_as_their_envelope_names_them_or_as_they_look() {
    for representation in REPRESENTATIONS {
        let payload = octets_of(&representation, &message());
        let trailing = Bytes::from([&payload[..], b"\r\n--boundary"].concat());
        for named in [Some(representation.clone()), None] {
            let envelope = envelope(named, None);
            let found = payload_representation(&envelope, &payload);
            assert_eq!(found, Some(representation.clone()));
            for payload in [&payload, &trailing] {
                let read = decode_payload(&envelope, payload, &Limits::default());
                assert_eq!(read, Ok(message()));
            }
        }
    }
    let nothing = decode_payload(&envelope(None, None), &Bytes::new(), &Limits::default());
    assert_eq!(nothing.unwrap_err().fault, Fault::Malformed);
}

#[test]
fn text_that_was_not_escaped_ends_with_the_payload() {
    let payload = "<fipa-message act=\"INFORM\"><content>a < b </fipa-message> c</content>\
        </fipa-message>\n";
    let envelope = envelope(Some(Representation::Xml), None);
    let message = decode_payload(&envelope, &payload.into(), &Limits::default()).unwrap();
    assert_eq!(message.content_str(), Some("a < b </fipa-message> c"));
}

#[test]
fn what_is_transcoded_keeps_to_the_limits() {
    let limits = Limits {
        max_octets: 20,
        ..Limits::default()
    };
    let envelope = envelope(Some(Representation::String), Some("ISO-8859-1"));
    for len in [5, 15, 30] {
        let payload = Bytes::from([b"(inform :content \"", &vec![0xfc; len][..], b"\")"].concat());
        let error = decode_payload(&envelope, &payload, &limits).unwrap_err();
        assert_eq!((error.offset, error.fault), (20, Fault::Limit), "{len}");
    }
}

proptest! {
    #[test]
    fn any_octets_in_any_charset_do_no_harm(
        octets in prop::collection::vec(any::<u8>(), 0..60),
        tokens in "[()\"#0-9:\\\\ a\u{e4}\u{436}]{0,40}",
        encoding in prop::sample::select(vec![
            "UTF-16", "UTF-32", "ISO-8859-1", "windows-1251", "Shift_JIS", "gb18030", "ISO-2022-JP",
            "EUC-KR", "Big5", "x-user-defined", "replacement", "",
        ]),
    ) {
        for representation in REPRESENTATIONS {
            let envelope = envelope(Some(representation.clone()), Some(encoding));
            for head in [&b""[..], b"(inform ", b"\0(\0i", b"(\0i\0", b"<fipa-message ", b"(\0\0\0"] {
                for rest in [&octets[..], tokens.as_bytes(), &[&octets, tokens.as_bytes()].concat()] {
                    let payload = Bytes::from([head, rest].concat());
                    let read =
                        decode_payload_as(&representation, &envelope, &payload, &Limits::default());
                    let at = read.map_or_else(|error| error.offset, |(_, used)| used);
                    prop_assert!(at <= payload.len());
                }
            }
        }
    }

    #[test]
    fn what_was_written_is_read_in_the_charset_that_the_envelope_should_name(
        message in arbitrary::message(),
        given in prop::option::of(prop::sample::select(vec![
            "UTF-16", "UTF-32", "ISO-8859-1", "UTF-8", "US-ASCII", "ISO-2022-JP", "anything",
        ])),
    ) {
        for representation in REPRESENTATIONS {
            let mut out = Output::new();
            if encode_message(&representation, &message, &mut out).is_err() {
                continue;
            }
            let payload = out.take_bytes();
            let given = given.map(Text::from);
            let encoding = payload_encoding(&representation, &payload, given.as_ref());
            let plain = decode_message(&representation, &payload, &Limits::default());
            let envelope = envelope(Some(representation), encoding.as_deref());
            let read = decode_payload(&envelope, &payload, &Limits::default());
            prop_assert_eq!(read, plain);
        }
    }
}
