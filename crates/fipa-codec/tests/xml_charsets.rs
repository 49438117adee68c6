//! XML whose declaration names another charset.

mod xml_support;

use bytes::Bytes;
use fipa_acl::{Envelope, Message, Performative, Representation, Slots};
use fipa_codec::xml::{decode_letter, decode_message_prefix};
use fipa_codec::{Fault, Limits, decode_payload};
use xml_support::{octets, read, refused, refused_envelope};

fn declared(encoding: &str, text: &[u8]) -> Bytes {
    let head = format!("<?xml version='1.0' encoding={encoding} ?>\n<fipa-message act='inform'>");
    let content = [b"<content>", text, b"</content></fipa-message>"].concat();
    octets([head.as_bytes(), &content].concat())
}

fn inform(content: &str) -> Message {
    Message::new(Performative::Inform).content(content.to_owned())
}

#[test]
fn messages_are_read_in_the_charset_that_they_declare() {
    for (encoding, text, expected) in [
        ("\"ISO-8859-1\"", &b"gr\xfc\xdf \x80"[..], "grüß \u{80}"),
        ("'iso-8859-15'", b"5 \xa4", "5 €"),
        ("'windows-1252'", b"5 \x80", "5 €"),
        ("'KOI8-R'", b"\xcd\xc9\xd2", "мир"),
        ("'Shift_JIS'", b"\x93\xfa\x96{", "日本"),
        ("'ISO-8859-1'", b"<![CDATA[\xe4]]>", "ä"),
        ("'UTF-8'", "ä".as_bytes(), "ä"),
        ("'us-ascii'", b"a", "a"),
        // It says so in ASCII.
        ("'UTF-16'", "ä".as_bytes(), "ä"),
    ] {
        assert_eq!(
            read(declared(encoding, text)),
            inform(expected),
            "{encoding}"
        );
    }
}

#[test]
fn octets_behind_a_message_are_counted_as_they_stand() {
    let message = declared("'ISO-8859-1'", b"\xfc\xfc");
    let more = octets([&message[..], b" \xfc"].concat());
    let read = decode_message_prefix(&more, &Limits::default());
    assert_eq!(read, Ok((inform("üü"), message.len())));
}

#[test]
fn errors_are_told_where_they_stand_in_the_input() {
    let text = declared(
        "'ISO-8859-1'",
        b"\xfc\xfc</content><reply-by time='x'/><content>",
    );
    let at = text.windows(8).position(|here| here == b"reply-by");
    assert_eq!(refused(&text), (at.unwrap(), Fault::Violation));
}

#[test]
fn a_charset_that_nobody_knows_is_refused() {
    for encoding in ["'x-martian'", "'EBCDIC-US'", "''"] {
        let message = declared(encoding, b"a");
        let at = message
            .windows(9)
            .position(|here| here == b"encoding=")
            .unwrap()
            + 10;
        assert_eq!(refused(&message), (at, Fault::Unsupported), "{encoding}");
    }
    let envelope = "<?xml version='1.0' encoding='x-martian'?><envelope/>";
    assert_eq!(refused_envelope(envelope), (30, Fault::Unsupported));
}

/// The payload is in its own charset, and shared.
#[test]
fn an_envelope_declares_nothing_about_its_payload() {
    let payload = b"\xfc\xff(inform)";
    let envelope = b"<?xml version='1.0' encoding='ISO-8859-1'?><envelope><params index='1'>\
        <comments>gr\xfcn</comments></params></envelope>";
    let letter = octets([&envelope[..], payload].concat());
    let read = decode_letter(&letter, &Limits::default()).unwrap();
    assert_eq!(read.envelope.base.comments, Some("grün".into()));
    assert_eq!(read.payload, &payload[..]);
    assert_eq!(read.payload.as_ptr(), letter[envelope.len()..].as_ptr());
}

/// A payload-encoding wins over the declaration of a payload that was transcoded by it.
#[test]
fn a_payload_is_transcoded_once() {
    for (named, declaration) in [
        (Some("ISO-8859-1"), "'ISO-8859-1'"),
        (Some("ISO-8859-1"), "'x-martian'"),
        (None, "'ISO-8859-1'"),
    ] {
        let envelope = Envelope::new(Slots {
            acl_representation: Some(Representation::Xml),
            payload_encoding: named.map(fipa_acl::Text::from),
            ..Slots::default()
        });
        let payload = declared(declaration, b"gr\xfc\xdf");
        let read = decode_payload(&envelope, &payload, &Limits::default());
        assert_eq!(read, Ok(inform("grüß")), "{named:?} {declaration}");
    }
}
