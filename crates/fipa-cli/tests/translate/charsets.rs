//! Payloads in other charsets than UTF-8.

use serde_json::{Value, json};

use crate::{NOW, decode, decoded, encoded, failure};

/// A letter with this payload: its envelope in XML names the representation and the charset.
fn letter(rep: &str, encoding: &str, payload: &[u8]) -> Vec<u8> {
    let envelope = format!(
        "<envelope><params index=\"1\"><acl-representation>fipa.acl.rep.{rep}.std\
         </acl-representation><payload-length>{}</payload-length>\
         <payload-encoding>{encoding}</payload-encoding></params></envelope>",
        payload.len()
    );
    [envelope.as_bytes(), payload].concat()
}

fn message(rep: &str, encoding: &str, payload: &[u8]) -> Value {
    let letter = decoded(&["--envelope"], &letter(rep, encoding, payload)).remove(0);
    assert_eq!(letter["envelope"]["payload-encoding"], encoding);
    letter["message"].clone()
}

fn utf_16(text: &str, unit: fn(u16) -> [u8; 2]) -> Vec<u8> {
    text.encode_utf16().flat_map(unit).collect()
}

fn utf_32(text: &str, unit: fn(u32) -> [u8; 4]) -> Vec<u8> {
    text.chars().map(u32::from).flat_map(unit).collect()
}

const STRING: &str = "(inform :content \"grüß 🚀\" :X-a \"ж\")";
const XML: &str = "<fipa-message act=\"inform\"><content>grüß 🚀</content>\
    <user-defined href=\"X-a\">ж</user-defined></fipa-message>";

#[test]
fn units_of_two_and_four_octets_are_transcoded_before_anything_is_read() {
    let expected =
        json!({"performative": "inform", "content": "grüß 🚀", "user-defined": {"X-a": "ж"}});
    for (rep, text) in [("string", STRING), ("xml", XML)] {
        for mark in ["", "\u{feff}"] {
            let text = format!("{mark}{text}");
            for (encoding, octets) in [
                ("UTF-16", utf_16(&text, u16::to_be_bytes)),
                ("UTF-16", utf_16(&text, u16::to_le_bytes)),
                ("utf-16be", utf_16(&text, u16::to_be_bytes)),
                ("UTF-16LE", utf_16(&text, u16::to_le_bytes)),
                ("UTF-32", utf_32(&text, u32::to_be_bytes)),
                ("UTF-32LE", utf_32(&text, u32::to_le_bytes)),
            ] {
                assert_eq!(
                    message(rep, encoding, &octets),
                    expected,
                    "{rep} {encoding}"
                );
            }
        }
    }
}

#[test]
fn whoever_names_such_a_charset_and_writes_utf_8_is_understood() {
    for (rep, text) in [("string", STRING), ("xml", XML)] {
        for encoding in [
            "UTF-16",
            "UTF-32",
            "UTF-8",
            "US-ASCII",
            "test encoding",
            "x",
        ] {
            let message = message(rep, encoding, text.as_bytes());
            assert_eq!(message["content"], "grüß 🚀", "{rep} {encoding}");
        }
    }
    let message = json!({"performative": "inform", "content": "grüß", "language": "grüß"});
    let octets = encoded("bit-efficient", &[], &message);
    for encoding in ["UTF-16", "ISO-8859-1"] {
        assert_eq!(self::message("bitefficient", encoding, &octets), message);
    }
}

#[test]
fn words_and_literals_are_transcoded_but_not_what_is_counted() {
    let payload =
        b"(inform :language gr\xfc\xdf :content #4\"gr\xfc\xdf :ontology \"#2\\\"\xe4\xe4\"\
        :X-a #0\" :X-b \"\xe4\")";
    let expected = json!({
        "performative": "inform", "content": {"base64": "Z3L83w=="}, "language": "grüß",
        "ontology": "#2\"ää", "user-defined": {"X-a": "", "X-b": "ä"},
    });
    for encoding in ["ISO-8859-1", "latin1", "windows-1252", "ISO-8859-15"] {
        assert_eq!(message("string", encoding, payload), expected, "{encoding}");
    }
    // The peer that writes no white space.
    let glued = b"(inform:content#2\"\xfc\xdf:conversation-id\xe4)";
    let expected = json!({
        "performative": "inform", "content": {"base64": "/N8="}, "conversation-id": "ä",
    });
    assert_eq!(message("string", "iso-8859-1", glued), expected);
}

#[test]
fn names_mean_what_they_say() {
    let literal = |octet: u8| [b"(inform :content \"", &[octet][..], b"\")"].concat();
    for (encoding, octet, character) in [
        ("ISO-8859-1", 0x80, "\u{80}"),
        ("windows-1252", 0x80, "€"),
        ("ISO-8859-15", 0xa4, "€"),
        ("windows-1251", 0xe6, "ж"),
        ("KOI8-R", 0xd6, "ж"),
    ] {
        let message = message("string", encoding, &literal(octet));
        assert_eq!(message["content"], character, "{encoding}");
    }
    // Half of its second character looks like a backslash.
    let shift_jis = b"(inform :content \"\x83\x5c\" :language #2\"\x83\x5c)";
    let message = message("string", "Shift_JIS", shift_jis);
    assert_eq!(message["content"], "ソ");
}

#[test]
fn bit_efficient_texts_that_are_no_utf_8_are_transcoded() {
    let octets = [
        &b"\xfa\x10\x08\x02\x02\x10a@h\0\x01"[..],
        // Words and literals, alone and in lists; counted octets and numbers.
        b"\x09\x10gr\xfc\xdf\0\x0a\x14\"\xe4 1\"\0",
        b"\x0b\x70\xe4\0\x12\x23\0\x74\"\xf6\"\0\x78\0\0\0\x01a\x40\x50\xfc\0\x40",
        b"\x05\x14#1\"\xe4\0\x06\x24\x31\x37\x12\x13\x14\x15\x16\x78\x90Z",
        b"\x00\x10X-n\0\x14\"UTF-8: \xc3\xa4\"\0\x04\x17\0\x01\xfc\x01",
    ]
    .concat();
    let expected = json!({
        "performative": "inform", "sender": {"name": "a@h"}, "content": {"base64": "/A=="},
        "language": "grüß", "encoding": "ä 1", "ontology": "(ä 12 (\"ö\" (\"a\")) ü)",
        "reply-with": "\u{fffd}", "reply-by": NOW, "user-defined": {"X-n": "UTF-8: ä"},
    });
    assert_eq!(message("bitefficient", "ISO-8859-1", &octets), expected);
    // An error behind a text that has become longer.
    let wrong = [&octets[..octets.len() - 1], b"\x0e"].concat();
    let letter = letter("bitefficient", "ISO-8859-1", &wrong);
    let (_, result) = decode(&[], &letter);
    let place = format!("octet {}: ", letter.len() - 1);
    assert!(failure(result).1.starts_with(&place));
}

#[test]
fn xml_that_is_no_utf_8_is_transcoded() {
    let payload = b"<fipa-message act=\"inform\"><content>gr\xfc\xdf</content></fipa-message>";
    assert_eq!(message("xml", "ISO-8859-1", payload)["content"], "grüß");
}

#[test]
fn a_payload_of_no_named_representation_is_found_out_in_its_charset() {
    for text in [STRING, XML] {
        let octets = utf_16(&format!("\u{feff}{text}"), u16::to_be_bytes);
        let mut input = b"<envelope><params index=\"1\"><payload-encoding>UTF-16\
            </payload-encoding></params></envelope>"
            .to_vec();
        input.extend(octets);
        input.extend(b"\0\n");
        assert_eq!(decoded(&[], &input)[0]["message"]["content"], "grüß 🚀");
    }
}

#[test]
fn offsets_are_those_of_the_octets_that_were_sent() {
    let wrong = "(inform :content \"grüß\" reply-by)";
    let place = wrong.find(" reply").unwrap();
    let chars = wrong[..=place].chars().count();
    let counted = wrong.replace("\"grüß\"", "#2\"\u{1}\u{2} :X-a \"grüß\"");
    let latin_1: Vec<u8> = counted.chars().map(|c| c as u8).collect();
    for (encoding, payload, place) in [
        ("ISO-8859-1", latin_1.clone(), latin_1.len() - 9),
        ("windows-1252", latin_1.clone(), latin_1.len() - 9),
        ("UTF-16", utf_16(wrong, u16::to_le_bytes), 2 * chars),
        ("UTF-16", utf_16(wrong, u16::to_be_bytes), 2 * chars),
        ("UTF-32", utf_32(wrong, u32::to_be_bytes), 4 * chars),
    ] {
        let letter = letter("string", encoding, &payload);
        let (_, result) = decode(&[], &letter);
        let place = letter.len() - payload.len() + place;
        let (code, line) = failure(result);
        assert_eq!(code, 2);
        assert!(
            line.starts_with(&format!("octet {place}: ")),
            "{encoding}: {line}"
        );
    }
}

/// What the envelope says about the charset of a message in JSON with this content.
fn written(rep: &str, given: Option<&str>, content: Value) -> Value {
    let mut envelope = json!({"date": NOW});
    if let Some(given) = given {
        envelope["payload-encoding"] = given.into();
    }
    let message = json!({"performative": "inform", "content": content});
    let letter = json!({"envelope": envelope, "message": message});
    let octets = encoded(rep, &["--envelope", "xml"], &letter);
    let again = decoded(&[], &octets).remove(0);
    assert_eq!(again["message"], message, "{rep} {given:?}");
    again["envelope"]["payload-encoding"].clone()
}

#[test]
fn the_envelope_says_so_where_the_payload_is_not_ascii() {
    for (rep, given, content, said) in [
        ("string", None, "hi", Value::Null),
        ("string", None, "grüß", "UTF-8".into()),
        ("string", Some("US-ASCII"), "grüß", "UTF-8".into()),
        ("string", Some("ISO-8859-1"), "grüß", "UTF-8".into()),
        ("string", Some("ISO-8859-1"), "hi", "ISO-8859-1".into()),
        ("string", Some("UTF-16"), "hi", "UTF-8".into()),
        (
            "string",
            Some("test encoding"),
            "grüß",
            "test encoding".into(),
        ),
        ("xml", None, "grüß", Value::Null),
        ("xml", Some("UTF-16"), "grüß", "UTF-8".into()),
        ("bit-efficient", None, "grüß", Value::Null),
        ("bit-efficient", Some("UTF-16"), "grüß", "UTF-16".into()),
    ] {
        assert_eq!(
            written(rep, given, content.into()),
            said,
            "{rep} {given:?} {content}"
        );
    }
    // Octets that are not UTF-8 are in no charset.
    let octets = json!({"base64": "/w=="});
    for given in [None, Some("UTF-8"), Some("ISO-8859-1")] {
        assert_eq!(written("string", given, octets.clone()), Value::Null);
    }
}
