//! Recordings of JADE: the messages of its XML add-on, and the envelopes of all its letters.

mod support;
mod xml_support;

use bytes::Bytes;
use fipa_acl::{
    AgentId, Envelope, Expression, FipaTime, Message, Performative, Representation, Slots, Zone,
};
use fipa_codec::xml::{decode_letter_prefix, decode_message};
use fipa_codec::{Fault, Form, Limits, bit_efficient, decode_payload, detect, xml};
use support::{index, message as bit_efficient_message, path, recording, string};
use xml_support::{read, read_envelope};

/// The message of the same case as JADE's bit-efficient add-on writes it.
fn same_case(case: &str) -> Message {
    let mut message = bit_efficient_message(recording(&format!("jade/out_be_{case}.acl")));
    // Both have the name of the representation in them.
    for tag in [&mut message.conversation_id, &mut message.reply_with] {
        if let Some(text) = tag.as_ref().and_then(Expression::as_str) {
            *tag = Some(Expression::from(text.replace("case-be-", "case-xml-")));
        }
    }
    message
}

/// The recorded messages as the XML add-on writes them.
fn expected(case: &str) -> Message {
    let content = |content: &'static str| Bytes::from_static(content.as_bytes());
    // These have no bit-efficient recording.
    let mut message = match case {
        "aid-odd-names" | "slots-odd-values" => {
            let mut message = same_case("reply-to");
            message.reply_to.clear();
            message.conversation_id = Some(Expression::from(format!("case-xml-{case}")));
            message
        }
        _ => same_case(case),
    };
    match case {
        "aid-odd-names" => {
            let at = |name: &str| AgentId::new(name).address("http://127.0.0.1:9990/acc");
            message.reply_to = ["name with space", "#hash", "7up", "paren(1)"]
                .map(|name| at(&format!("{name}@pyplat")))
                .to_vec();
        }
        "slots-odd-values" => {
            message.language = Some("two words".into());
            message.encoding = Some("#tag".into());
            message.ontology = Some("12".into());
            message.protocol = Some("proto-x".into());
            message.reply_with = Some("1.5e3".into());
            message.in_reply_to = Some("a(b)c".into());
        }
        // A backslash stands in front of every quote, and nobody takes it away again.
        "quotes" => {
            message.content = Some(content(r#"say \"hi\" and \ backslash and \\" both"#));
        }
        "spaces-trim" => message.content = Some(content("padded both sides")),
        "user-params" => message.user_defined.clear(),
        // The bit-efficient add-on cuts off the end of what is not ASCII.
        "utf16-declared" => message.content = Some(content("grüß")),
        "utf8-declared" | "utf8-default" => {
            message.content = Some(content("grüß 你好 € 🚀"));
        }
        _ => {}
    }
    message
}

#[test]
fn messages_have_the_values_that_the_agent_gave_them() {
    let mut seen = 0;
    for entry in index("jade/index.json") {
        if entry["representation"] != "xml" || entry["kind"] != "acl-payload" {
            continue;
        }
        let case = string(&entry["case"]);
        let decoded = read(recording(&format!("jade/{}", string(&entry["file"]))));
        // Some are too long to be printed.
        assert!(decoded == expected(&case), "{case}");
        seen += 1;
    }
    assert!(seen > 30, "{seen} messages");
}

#[test]
fn answers_with_unescaped_text_are_read() {
    for file in ["xml-echo", "xml-echo-href"] {
        let answer = read(recording(&format!("jade/in2_{file}.reply.acl")));
        let content = r#"hi < x > & \"q\"  two  spaces"#;
        assert_eq!(answer.content_str(), Some(content), "{file}");
        assert_eq!(answer.in_reply_to, Some("rw-x".into()), "{file}");
    }
    // The agent saw the text in Base64, and sent that back as text.
    let answer = read(recording("jade/in2_xml-echo-b64.reply.acl"));
    assert_eq!(answer.content_str(), Some("AAECAwQF/w=="));
}

/// The parts of a recorded request.
fn parts(file: &str) -> (Bytes, Bytes) {
    let request = recording(file);
    let text = String::from_utf8(request.to_vec()).unwrap();
    let parts: Vec<_> = text.split("\r\n--B0undary42").collect();
    let body = |part: &str| {
        let (_, body) = part.split_once("\r\n\r\n").unwrap();
        Bytes::copy_from_slice(body.as_bytes())
    };
    (body(parts[1]), body(parts[2]))
}

#[test]
fn messages_that_were_sent_to_jade_are_read() {
    let request = |case: &str| {
        let (envelope, payload) = parts(&format!("jade/in2_{case}.req.http"));
        let announced = read_envelope(envelope).payload_length();
        assert_eq!(announced, Some(payload.len() as u64));
        read(payload)
    };
    let plain = request("xml-echo");
    assert_eq!(plain.content_str(), Some("hi <x> & \"q\"  two  spaces"));
    // The element wins over the attribute.
    assert_eq!(plain.conversation_id, Some("in-xml-echo".into()));
    let with_attributes = request("xml-echo-href");
    assert_eq!(with_attributes.language, Some("text".into()));
    assert_eq!(with_attributes.user_defined[0].name, *"foo");
    assert_eq!(
        with_attributes.reply_by.unwrap().to_string(),
        "2031-02-03T04:05:06.789Z"
    );
    let octets = request("xml-echo-b64");
    assert_eq!(octets.content.unwrap(), &b"\0\x01\x02\x03\x04\x05\xff"[..]);
    assert!(octets.user_defined.is_empty());
}

#[test]
fn envelopes_that_jade_accepts_are_read() {
    let at = |name: &str, url: &str| AgentId::new(name).address(url);
    for case in ["multiline", "ns", "prefix", "entity"] {
        let (envelope, payload) = parts(&format!("jade/in2_http-xml-{case}.req.http"));
        let envelope = read_envelope(envelope);
        let to = [at("echo@platA", "http://127.0.0.1:7778/acc")];
        assert_eq!(envelope.to(), to, "{case}");
        assert_eq!(envelope.intended_receiver(), to, "{case}");
        let from = at("pyagent@pyplat", "http://127.0.0.1:9992/acc");
        assert_eq!(envelope.from(), Some(&from), "{case}");
        assert_eq!(
            envelope.payload_length(),
            Some(payload.len() as u64),
            "{case}"
        );
        assert_eq!(
            envelope.date(),
            Some(local("2026-01-01T12:00:00")),
            "{case}"
        );
        let comments = (case == "entity").then_some("a & b <c>");
        assert_eq!(envelope.base.comments.as_deref(), comments, "{case}");
    }
}

#[test]
fn an_internal_subset_is_refused_even_if_jade_accepts_it() {
    let (envelope, _) = parts("jade/in2_http-xml-doctype.req.http");
    let offset = "<?xml version=\"1.0\"?>\n<!DOCTYPE envelope ".len();
    assert_eq!(
        xml_support::refused_envelope(envelope),
        (offset, Fault::Unsupported)
    );
}

/// A time of day in the zone of JADE's machine.
fn local(time: &str) -> FipaTime {
    let time: FipaTime = time.parse().unwrap();
    assert!(matches!(
        time,
        FipaTime::Absolute {
            zone: Zone::Unspecified,
            ..
        }
    ));
    time
}

#[test]
fn all_envelopes_are_read() {
    let mut seen = 0;
    for entry in index("jade/index.json") {
        if entry["kind"] != "envelope" {
            continue;
        }
        let file = string(&entry["file"]);
        let octets = recording(&format!("jade/{file}"));
        assert_eq!(
            (detect(&octets), xml::is_envelope(&octets)),
            (Form::Xml, true),
            "{file}"
        );
        let envelope = read_envelope(octets);
        check_envelope(&file, &string(&entry["case"]), &envelope);
        seen += 1;
    }
    assert_eq!(seen, 113);
}

fn check_envelope(file: &str, case: &str, envelope: &Envelope) {
    let jade = AgentId::new("cap@capplat").address("http://127.0.0.1:7780/acc");
    let base = &envelope.base;
    assert!(envelope.overlays.is_empty(), "{file}");
    assert_eq!(
        base.from.as_ref().unwrap().addresses,
        jade.addresses,
        "{file}"
    );
    let payload = path(&format!("jade/{}", file.replace(".env.xml", ".acl")));
    if let Ok(payload) = std::fs::metadata(payload) {
        assert_eq!(base.payload_length, Some(payload.len()), "{file}");
    }
    let representation = match file.split('_').nth(1).unwrap() {
        "be" => Representation::BitEfficient,
        "string" => Representation::String,
        _ => Representation::Xml,
    };
    assert_eq!(base.acl_representation, Some(representation), "{file}");
    let date = base.date.unwrap().to_string();
    assert!(date.starts_with("2026-11-22T06:"), "{file}: {date}");
    assert!(matches!(
        base.date,
        Some(FipaTime::Absolute {
            zone: Zone::Unspecified,
            ..
        })
    ));
    let encoding = match case {
        "utf8-declared" => Some("UTF-8"),
        "utf16-declared" => Some("UTF-16"),
        _ => None,
    };
    assert_eq!(base.payload_encoding.as_deref(), encoding, "{file}");
    assert_eq!(base.intended_receiver.len(), 1, "{file}");
    let receivers = match case {
        "multi-receivers" => 3,
        "receiver-no-address" => 2,
        _ => 1,
    };
    assert_eq!(base.to.len(), receivers, "{file}");
    assert!(base.to.contains(&base.intended_receiver[0]), "{file}");
    let rest = Slots {
        to: Vec::new(),
        from: None,
        acl_representation: None,
        payload_length: None,
        payload_encoding: None,
        date: None,
        intended_receiver: Vec::new(),
        ..base.clone()
    };
    assert_eq!(rest, Slots::default(), "{file}");
}

#[test]
fn a_letter_of_the_bridge_over_tcp_is_read() {
    let octets = recording("jade/tcp_mtp_jade_to_rock.bin");
    let (letter, used) = decode_letter_prefix(&octets, &Limits::default()).unwrap();
    let rock = AgentId::new("rock_agent").address("tcp://127.0.0.1:9993");
    let jade = AgentId::new("jadeagent@10.0.0.1:1099/JADE");
    let base = Slots {
        to: vec![rock.clone()],
        from: Some(jade.clone()),
        acl_representation: Some(Representation::String),
        payload_length: Some(224),
        date: Some(local("2031-02-03T04:05:06.789")),
        intended_receiver: vec![rock.clone()],
        ..Slots::default()
    };
    assert_eq!(letter.envelope, Envelope::new(base));
    assert_eq!((letter.payload.len(), used), (224, octets.len()));
    let message = decode_payload(&letter.envelope, &letter.payload, &Limits::default());
    let expected = Message::new(Performative::Request)
        .from_agent(jade)
        .to(rock)
        .content("hello rock")
        .conversation_id("c1");
    assert_eq!(message, Ok(expected));
}

#[test]
fn a_bit_efficient_letter_says_the_same_in_xml() {
    let octets = recording("jade/be_envelope_full.bin");
    let envelope = bit_efficient::decode_letter(&octets, &Limits::default())
        .unwrap()
        .envelope;
    assert_eq!(
        read_envelope(xml_support::written_envelope(&envelope)),
        envelope
    );
}

#[test]
fn no_message_of_jade_is_taken_for_an_envelope() {
    let octets = recording("jade/out_xml_basic.acl");
    assert!(!xml::is_envelope(&octets));
    let envelope = recording("jade/out_xml_basic.env.xml");
    let error = decode_message(&envelope, &Limits::default()).unwrap_err();
    assert_eq!(error.fault, Fault::Malformed);
}
