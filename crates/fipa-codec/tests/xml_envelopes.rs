//! What differs from the envelopes that are written, and is read all the same.

mod xml_support;

use bytes::Bytes;
use fipa_acl::{AgentId, FipaTime, Representation};
use fipa_codec::xml::{decode_envelope, decode_letter, is_envelope};
use fipa_codec::{Fault, Limits};
use xml_support::{octets, read_envelope, read_letter, refused_envelope};

fn base(inner: &str) -> fipa_acl::Slots {
    read_envelope(format!(
        "<envelope><params index=\"1\">{inner}</params></envelope>"
    ))
    .base
}

#[test]
fn comments_that_jade_did_not_escape_are_read() {
    let text = "<envelope><params index=\"1\"><comments>a & b </comments> c</comments>\
                <user-defined href=\"k\" type=\"string\">x<y</user-defined>\
                <from><agent-identifier><name>a</name><addresses><url>http://h/?a=1&b</url>\
                </addresses></agent-identifier></from>\
                </params></envelope><comments>& </comments></envelope>";
    let letter = read_letter(text);
    let base = &letter.envelope.base;
    assert_eq!(base.comments.as_deref(), Some("a & b </comments> c"));
    assert_eq!(base.user_defined, [("k".into(), "x<y".into())]);
    assert_eq!(base.from.as_ref().unwrap().addresses, ["http://h/?a=1&b"]);
    assert_eq!(letter.payload, "<comments>& </comments></envelope>");
}

fn date(text: &str) -> Result<String, Fault> {
    let text = format!("<envelope><params><date>{text}</date></params></envelope>");
    let decoded = decode_envelope(&octets(text), &Limits::default());
    let date = decoded.map_err(|error| error.fault)?.0.base.date;
    Ok(date.map(describe).unwrap_or_default())
}

fn describe(time: FipaTime) -> String {
    match time {
        FipaTime::Absolute { zone, .. } => format!("{time} {zone:?}"),
        FipaTime::Relative(_) => time.to_string(),
    }
}

#[test]
fn dates_are_read_in_all_forms() {
    let utc = "2026-01-02T03:04:05.678Z Utc";
    let unspecified = "2026-01-02T03:04:05.678Z Unspecified";
    for (text, expected) in [
        ("20260102T030405678Z", utc),
        ("20260102T030405678z", utc),
        (" 20260102T030405678Z\n", utc),
        ("20260102T030405678", unspecified),
        ("20260102Z030405678", unspecified),
        ("20260102x030405678", unspecified),
        ("20260102Z030405678Z", utc),
        ("20260102T030405678J", unspecified),
        ("20260102T030405Z", "2026-01-02T03:04:05.000Z Utc"),
        ("20260102T030405678+0000", utc),
        ("20260102T050405678+0200", utc),
        ("20260102T014405678-0120", utc),
        ("20260102T040405678A", utc),
        ("20260102T020405678N", utc),
        ("20260102T150405678M", utc),
        ("20260101T150405678Y", utc),
        ("+00000001T000010500", "+P1DT10.5S"),
        ("-00000000T020000000Z", "-PT2H"),
        ("", ""),
        ("  ", ""),
    ] {
        assert_eq!(date(text).as_deref(), Ok(expected), "{text}");
    }
    for text in [
        "2026-01-02T03:04:05Z",
        "20260102T0304056",
        "20261302T030405678Z",
        "20260230T030405678Z",
        "20260102 030405678Z",
        "20260102T030405678?",
        "20260102T030405678+00",
        "00000101T000000000A",
        "x",
    ] {
        assert_eq!(date(text), Err(Fault::Violation), "{text}");
    }
}

#[test]
fn layers_are_sorted_by_their_numbers() {
    let layers = |indexes: &[&str]| -> String {
        let params = indexes.iter().map(|index| {
            format!(
                "<params {index}><comments>{}</comments></params>",
                index.replace('\'', "")
            )
        });
        let text = format!("<envelope>{}</envelope>", params.collect::<String>());
        let envelope = read_envelope(text);
        let comments = envelope.layers().rev().map(|slots| slots.comments.clone());
        comments
            .map(|text| text.unwrap_or_default().to_string())
            .collect::<Vec<_>>()
            .join(",")
    };
    assert_eq!(
        layers(&["index='10'", "index='9'", "index='2'"]),
        "index=2,index=9,index=10"
    );
    assert_eq!(
        layers(&["index='2'", "index='2'", "index='1'"]),
        "index=1,index=2,index=2"
    );
    assert_eq!(layers(&["a='b'", "index='x'", "a='c'"]), "a=b,index=x,a=c");
    assert_eq!(
        layers(&["index='3'", "a='b'", "index='1'"]),
        "index=1,index=3,a=b"
    );
}

#[test]
fn the_highest_layer_wins_and_agents_do_not_add_up_across_layers() {
    let agent =
        |name: &str| format!("<to><agent-identifier><name>{name}</name></agent-identifier></to>");
    let envelope = read_envelope(format!(
        "<envelope><params index='2'>{}{}</params><params index='1'>{}</params></envelope>",
        agent("b"),
        agent("c"),
        agent("a"),
    ));
    assert_eq!(envelope.to(), [AgentId::new("b"), AgentId::new("c")]);
}

#[test]
fn stamps_are_read_in_all_forms() {
    let by = [
        "<received-by value='b'/>",
        "<received-by>b</received-by>",
        "<received-by><url>b</url></received-by>",
        "<received-by><url href='b'/></received-by>",
    ];
    for by in by {
        let text = format!(
            "<received><received-via value='v'/><received-date value='20260102T030405678'/>{by}\
             <received-id>i</received-id><received-from><url> f </url></received-from>\
             <unknown/></received>",
        );
        let stamp = base(&text).received.unwrap();
        assert_eq!((&*stamp.by, stamp.id.as_deref()), ("b", Some("i")));
        assert_eq!(
            (stamp.from.as_deref(), stamp.via.as_deref()),
            (Some("f"), Some("v"))
        );
    }
    let nobody = "<received><received-by value=''/></received>";
    assert_eq!(base(nobody).received, None);
}

#[test]
fn numbers_and_names_in_envelopes_are_trimmed_and_empty_ones_are_absent() {
    let slots = base(
        "<payload-length> 42\n</payload-length>\
                      <acl-representation>\n FIPA.acl.rep.XML.std </acl-representation>",
    );
    assert_eq!(slots.payload_length, Some(42));
    assert_eq!(slots.acl_representation, Some(Representation::Xml));
    let empty = "<payload-length/><acl-representation> </acl-representation><comments></comments>\
                 <payload-encoding/><date/><to/><transport-behaviour/>";
    assert_eq!(base(empty), fipa_acl::Slots::default());
    for text in ["x", "-1", "+1", "99999999999999999999"] {
        let text = format!(
            "<envelope><params><payload-length>{text}</payload-length></params></envelope>"
        );
        assert_eq!(refused_envelope(text).1, Fault::Malformed);
    }
}

#[test]
fn is_envelope_reads_utf_16() {
    let utf_16 =
        |text: &str| -> Vec<u8> { text.encode_utf16().flat_map(u16::to_le_bytes).collect() };
    assert!(is_envelope(&utf_16(
        "\u{feff}<?xml version='1.0'?><envelope>"
    )));
    assert!(!is_envelope(&utf_16("\u{feff}<fipa-message act='inform'>")));
}

#[test]
fn a_payload_in_any_form_follows_an_envelope_in_utf_16() {
    let text = "\u{feff}<envelope><params><comments>\u{1f680}</comments></params></envelope>";
    let mut letter: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
    let begin = letter.len();
    letter.extend_from_slice(b"\xfa\xd8\x00PAY");
    let letter = Bytes::from(letter);
    let (_, payload) = decode_envelope(&letter, &Limits::default()).unwrap();
    assert_eq!(payload, begin);
    let letter = decode_letter(&letter, &Limits::default()).unwrap();
    assert_eq!(letter.payload, &b"\xfa\xd8\x00PAY"[..]);
}

#[test]
fn a_payload_shares_the_buffer_of_the_input() {
    let input = octets("<envelope><params/></envelope>PAYLOAD");
    let letter = decode_letter(&input, &Limits::default()).unwrap();
    assert_eq!(letter.payload.as_ptr(), input[input.len() - 7..].as_ptr());
}
