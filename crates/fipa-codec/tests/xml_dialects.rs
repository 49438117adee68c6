//! What is written to peers in XML: each row of the table of dialects, and the recordings of these
//! peers.

mod support;
mod xml_support;

use bytes::Bytes;
use fipa_acl::{
    AgentId, Envelope, FipaTime, Letter, Message, Performative, Received, Representation, Slots,
};
use fipa_codec::xml::{encode_envelope_as, encode_letter_as, encode_message_as};
use fipa_codec::{Dialect, Output};
use support::{fipa_acl, index, recording, string};
use xml_support::{read, read_envelope, read_letter};

const JADE: [Dialect; 2] = [Dialect::Jade, Dialect::JadeBridge];
const NOT_JADE: [Dialect; 2] = [Dialect::Standard, Dialect::Cpp];
const NOT_CPP: [Dialect; 3] = [Dialect::Standard, Dialect::Jade, Dialect::JadeBridge];

fn octets_for(dialect: Dialect, message: &Message) -> Bytes {
    let mut out = Output::new();
    encode_message_as(dialect, message, &mut out).unwrap();
    out.take_bytes()
}

/// What stands in the message.
fn inner(dialect: Dialect, message: &Message) -> String {
    let octets = octets_for(dialect, message);
    let text = String::from_utf8_lossy(&octets);
    let start = "<?xml version=\"1.0\"?><fipa-message act=\"inform\">";
    let text = text.strip_prefix(start).unwrap();
    text.strip_suffix("</fipa-message>").unwrap().to_owned()
}

fn envelope_for(dialect: Dialect, envelope: &Envelope) -> Bytes {
    let mut out = Output::new();
    encode_envelope_as(dialect, envelope, 7, &mut out).unwrap();
    out.take_bytes()
}

/// What stands in the only layer.
fn slots(dialect: Dialect, slots: Slots) -> String {
    let octets = envelope_for(dialect, &Envelope::new(slots));
    let text = String::from_utf8(octets.to_vec()).unwrap();
    let start = "<?xml version=\"1.0\"?><envelope><params index=\"1\">";
    let text = text.strip_prefix(start).unwrap();
    text.strip_suffix("</params></envelope>")
        .unwrap()
        .to_owned()
}

fn inform() -> Message {
    Message::new(Performative::Inform)
}

const NOW: FipaTime = FipaTime::Absolute {
    unix_millis: 1_767_323_045_678,
    zone: fipa_acl::Zone::Utc,
};

fn stamp(by: &str) -> Option<Received> {
    Some(Received {
        by: by.into(),
        from: None,
        date: NOW,
        id: None,
        via: None,
        user_defined: vec![("empty".into(), "".into())],
    })
}

const A: &str = "<agent-identifier><name>a</name></agent-identifier>";
const B: &str = "<agent-identifier><name>b</name></agent-identifier>";
/// What JADE cannot do without.
const LENGTH: &str = "<payload-length>7</payload-length>";

#[test]
fn agents_of_a_slot_stand_together_but_not_for_jade() {
    let two = || vec![AgentId::new("a"), AgentId::new("b")];
    let both = || Slots {
        to: two(),
        intended_receiver: two(),
        ..Slots::default()
    };
    let receiver = "intended-receiver";
    let together = format!("<to>{A}{B}</to><{receiver}>{A}{B}</{receiver}>");
    let each = format!(
        "<to>{A}</to><to>{B}</to>{LENGTH}<{receiver}>{A}</{receiver}><{receiver}>{B}</{receiver}>"
    );
    for dialect in NOT_JADE {
        assert_eq!(slots(dialect, both()), together);
    }
    for dialect in JADE {
        assert_eq!(slots(dialect, both()), each);
    }
}

#[test]
fn agents_of_a_parameter_stand_together_for_cpp() {
    let message = inform().to("a").to("b").reply_to("a").reply_to("b");
    let agent = |name| format!("<agent-identifier><name id=\"{name}\"/></agent-identifier>");
    let (a, b) = (agent("a"), agent("b"));
    let cpp = format!("<receiver>{a}{b}</receiver><reply-to>{a}{b}</reply-to>");
    assert_eq!(inner(Dialect::Cpp, &message), cpp);
    let others = format!(
        "<receiver>{a}</receiver><receiver>{b}</receiver>\
         <reply-to>{a}</reply-to><reply-to>{b}</reply-to>"
    );
    for dialect in NOT_CPP {
        assert_eq!(inner(dialect, &message), others);
    }
}

#[test]
fn dates_have_no_letter_for_cpp() {
    let message = Message {
        reply_by: Some(NOW),
        ..inform()
    };
    let dated = || Slots {
        date: Some(NOW),
        received: stamp("mts"),
        ..Slots::default()
    };
    let date = "20260102T030405678";
    let cpp = format!("<reply-by time=\"{date}\"/>");
    assert_eq!(inner(Dialect::Cpp, &message), cpp);
    let cpp = format!(
        "<date>{date}</date><received><received-by value=\"mts\"/>\
         <received-date value=\"{date}\"/></received>"
    );
    assert_eq!(slots(Dialect::Cpp, dated()), cpp);
    for dialect in NOT_CPP {
        let others = format!("<reply-by time=\"{date}Z\"/>");
        assert_eq!(inner(dialect, &message), others);
        let others = slots(dialect, dated());
        assert!(others.contains(&format!("<date>{date}Z</date>")));
        assert!(others.contains(&format!("<received-date value=\"{date}Z\"/>")));
    }
}

#[test]
fn contents_stand_in_sections_that_their_readers_leave_alone() {
    let base64 = "</content><user-defined href=\"X-JADE-Encoding\" type=\"string\">Base64\
        </user-defined>";
    let as_element = "</content><X-JADE-Encoding>Base64</X-JADE-Encoding>";
    for (content, standard, cpp, jade) in [
        (
            &b" a  b"[..],
            " a  b",
            "<![CDATA[ a  b]]>",
            "<![CDATA[ a  b]]>",
        ),
        (
            b"<&]]",
            "&lt;&amp;]]",
            "<![CDATA[<&]]]]>",
            "<![CDATA[<&]]]]>",
        ),
        (b"a]]>b", "a]]&gt;b", "a]]&gt;b", "a]]&gt;b"),
        (b"a\rb", "a&#13;b", "<![CDATA[a\rb]]>", "a&#13;b"),
    ] {
        let message = inform().content(content);
        let written = |dialect| inner(dialect, &message);
        assert_eq!(
            written(Dialect::Standard),
            format!("<content>{standard}</content>")
        );
        assert_eq!(written(Dialect::Cpp), format!("<content>{cpp}</content>"));
        for dialect in JADE {
            assert_eq!(written(dialect), format!("<content>{jade}</content>"));
        }
    }
    let octets = inform().content(&b"\x01\xff"[..]);
    let standard = format!("<content>Af8={base64}");
    assert_eq!(inner(Dialect::Standard, &octets), standard);
    let cpp = octets_for(Dialect::Cpp, &octets);
    let section = b"<content><![CDATA[\x01\xff]]></content>";
    assert!(cpp.windows(section.len()).any(|here| here == section));
    for dialect in JADE {
        assert_eq!(
            inner(dialect, &octets),
            format!("<content>Af8={as_element}")
        );
    }
    for content in [&b"a\0"[..], b"\xff]]>"] {
        let message = inform().content(content);
        let cpp = inner(Dialect::Cpp, &message);
        assert!(cpp.ends_with(base64), "{cpp}");
    }
}

#[test]
fn user_defined_parameters_of_messages_are_elements_for_jade() {
    let message = inform()
        .user_defined("a-1", "<v>")
        .user_defined("no name", "w")
        .user_defined("empty", "");
    let other = "<user-defined href=\"X-no name\" type=\"string\">w</user-defined>";
    let standard = format!(
        "<user-defined href=\"X-a-1\" type=\"string\">&lt;v&gt;</user-defined>{other}\
         <user-defined href=\"X-empty\" type=\"string\"></user-defined>"
    );
    assert_eq!(inner(Dialect::Standard, &message), standard);
    for dialect in JADE {
        let jade = format!("<X-a-1>&lt;v&gt;</X-a-1>{other}<X-empty></X-empty>");
        assert_eq!(inner(dialect, &message), jade);
        assert_eq!(read(octets_for(dialect, &message)), message);
    }
    // fipa_acl rejects empty ones.
    let cpp = standard.split("<user-defined href=\"X-empty\"").next();
    assert_eq!(Some(&*inner(Dialect::Cpp, &message)), cpp);
    let empty = || Slots {
        received: stamp("mts"),
        user_defined: vec![("empty".into(), "".into())],
        ..Slots::default()
    };
    assert!(!slots(Dialect::Cpp, empty()).contains("user-defined"));
    for dialect in NOT_CPP {
        let written = slots(dialect, empty());
        assert_eq!(written.matches("<user-defined").count(), 2, "{dialect:?}");
    }
}

/// A letter that was stamped twice, and told where to go in between.
fn layered() -> Envelope {
    let overlay = |received, intended_receiver| Slots {
        received,
        intended_receiver,
        ..Slots::default()
    };
    Envelope {
        base: Slots {
            to: vec!["a".into(), "b".into()],
            date: Some(NOW),
            ..Slots::default()
        },
        overlays: vec![
            overlay(stamp("first"), Vec::new()),
            overlay(None, vec!["b".into()]),
            overlay(stamp("second"), Vec::new()),
        ],
    }
}

#[test]
fn jade_gets_one_layer() {
    for dialect in JADE {
        let octets = envelope_for(dialect, &layered());
        let read = read_envelope(octets);
        assert!(read.overlays.is_empty());
        assert_eq!(read.base.to, ["a".into(), "b".into()]);
        assert_eq!(read.base.intended_receiver, ["b".into()]);
        assert_eq!(read.base.payload_length, Some(7));
        assert_eq!(read.base.received, stamp("second"));
    }
    for dialect in NOT_JADE {
        let octets = envelope_for(dialect, &layered());
        assert_eq!(read_envelope(octets).overlays.len(), 3);
    }
}

#[test]
fn what_the_envelope_says_is_not_derived_for_jade() {
    let given = || Slots {
        to: vec!["a".into()],
        intended_receiver: vec!["b".into()],
        payload_length: Some(9),
        ..Slots::default()
    };
    for dialect in JADE {
        let written = slots(dialect, given());
        assert!(written.contains("<payload-length>9<"), "{written}");
        assert!(written.ends_with(&format!("{B}</intended-receiver>")));
        let to = Slots {
            intended_receiver: Vec::new(),
            ..given()
        };
        assert!(slots(dialect, to).ends_with(&format!("{A}</intended-receiver>")));
    }
}

#[test]
fn cpp_gets_nine_layers_at_most() {
    let envelope = |overlays| Envelope {
        base: Slots::default(),
        overlays: vec![Slots::default(); overlays],
    };
    for (overlays, fits) in [(8, true), (9, false)] {
        for dialect in [Dialect::Cpp, Dialect::Standard] {
            let mut out = Output::new();
            let written = encode_envelope_as(dialect, &envelope(overlays), 0, &mut out);
            assert_eq!(written.is_ok(), fits || dialect == Dialect::Standard);
            assert_eq!(out.is_empty(), written.is_err());
        }
    }
}

#[test]
fn jade_gets_no_resolvers_in_envelopes() {
    let resolved = AgentId::new("a").resolver("b");
    let slotted = || Slots {
        from: Some(resolved.clone()),
        intended_receiver: vec!["b".into()],
        ..Slots::default()
    };
    let message = inform().from_agent(resolved.clone());
    for dialect in JADE {
        assert!(slots(dialect, slotted()).contains(&format!("<from>{A}</from>")));
        assert_eq!(read(octets_for(dialect, &message)), message);
    }
    for dialect in NOT_JADE {
        let written = slots(dialect, slotted());
        assert!(written.contains(&format!("<resolvers>{B}</resolvers>")));
    }
}

#[test]
fn jade_gets_envelopes_in_one_line_of_ascii() {
    let commented = || Slots {
        comments: Some("gr\u{fc}n & \u{1f680}\n<".into()),
        user_defined: vec![("\u{fc}".into(), "\u{20ac}".into())],
        ..Slots::default()
    };
    for dialect in JADE {
        let written = slots(dialect, commented());
        let comments = "<comments>gr&#252;n &amp; &#128640;&#10;&lt;</comments>";
        assert!(written.starts_with(comments), "{written}");
        let parameter = "<user-defined href=\"X-&#252;\" type=\"string\">&#8364;</user-defined>";
        assert!(written.ends_with(parameter), "{written}");
        let read = read_envelope(envelope_for(dialect, &Envelope::new(commented())));
        assert_eq!(read.base.comments, commented().comments);
        assert_eq!(read.base.user_defined, commented().user_defined);
    }
    for dialect in NOT_JADE {
        assert!(slots(dialect, commented()).contains("gr\u{fc}n &amp; \u{1f680}\n&lt;"));
    }
}

#[test]
fn cpp_gets_no_transport_behaviour() {
    let behaviour = || Slots {
        transport_behaviour: Some(Bytes::from_static(b"x")),
        ..Slots::default()
    };
    assert_eq!(slots(Dialect::Cpp, behaviour()), "");
    for dialect in NOT_CPP {
        let written = slots(dialect, behaviour());
        assert!(written.contains("<transport-behaviour>x</transport-behaviour>"));
    }
}

#[test]
fn letters_have_their_payload_behind_the_envelope() {
    let letter = Letter {
        envelope: layered(),
        payload: Bytes::from_static(b"1234567"),
    };
    for dialect in [Dialect::Standard, Dialect::Cpp, Dialect::Jade] {
        let mut out = Output::new();
        encode_letter_as(dialect, &letter, &mut out).unwrap();
        let octets = out.take_bytes();
        let envelope = envelope_for(dialect, &letter.envelope);
        assert_eq!(octets, [&envelope[..], &letter.payload].concat());
        assert_eq!(read_letter(octets).payload, letter.payload);
    }
}

/// What fipa_acl and this writer spell differently in one spelling: there are blanks that do not
/// count, references that are not needed, other quotes, a prefix twice, and an attribute and a message that are
/// empty.
fn respelled(recorded: &[u8]) -> Vec<u8> {
    // Octets as characters: a content may be any of them.
    let text: String = recorded.iter().copied().map(char::from).collect();
    let (head, rest) = match text.split_once("<content>") {
        Some((head, rest)) => (head, format!("<content>{rest}")),
        None => (&*text, String::new()),
    };
    let (content, tail) = match rest.rsplit_once("</content>") {
        Some((content, tail)) => (content, format!("</content>{tail}")),
        None => (&*rest, String::new()),
    };
    let respell = |text: &str| {
        text.replace("<?xml version=\"1.0\" ?>", "<?xml version=\"1.0\"?>")
            .replace(" />", "/>")
            .replace(" conversation-id=\"\"", "")
            .replace("&apos;", "'")
            .replace("&quot;", "\"")
            .replace("X-X-", "X-")
            .replace("conversation-id='a\"b\\c'", "conversation-id=\"a\"b\\c\"")
            .replace(
                "<fipa-message act=\"inform\"/>",
                "<fipa-message act=\"inform\"></fipa-message>",
            )
    };
    let text = [respell(head), content.to_owned(), respell(&tail)].concat();
    text.chars().map(|octet| octet as u8).collect()
}

#[test]
fn messages_for_cpp_are_those_of_its_recordings() {
    let mut compared = 0;
    for (name, recorded, entry) in fipa_acl("xml", "message") {
        // It writes messages that it cannot read, or not to their end.
        if entry["peer_decode"]["accepted"] != true
            || ["content_cdata_end", "content_nul_only"].contains(&&*name)
        {
            continue;
        }
        let written = respelled(&octets_for(Dialect::Cpp, &read(&recorded)));
        let expected = respelled(&recorded);
        assert!(
            written == expected,
            "{name}: {}\n{}",
            String::from_utf8_lossy(&written),
            String::from_utf8_lossy(&expected)
        );
        compared += 1;
    }
    assert!(compared > 50, "{compared} messages");
}

#[test]
fn envelopes_for_cpp_are_those_of_its_recordings() {
    let mut compared = 0;
    for (name, recorded, _) in fipa_acl("xml", "envelope") {
        let letter = read_letter(&recorded);
        let mut out = Output::new();
        encode_letter_as(Dialect::Cpp, &letter, &mut out).unwrap();
        let envelope = |octets: &[u8]| respelled(&octets[..octets.len() - letter.payload.len()]);
        let (written, expected) = (envelope(&out.take_bytes()), envelope(&recorded));
        assert!(
            written == expected,
            "{name}: {}\n{}",
            String::from_utf8_lossy(&written),
            String::from_utf8_lossy(&expected)
        );
        compared += 1;
    }
    assert!(compared > 20, "{compared} letters");
}

/// JADE has a line end behind the declaration, empty lists of addresses, and its own letter in
/// dates.
#[test]
fn envelopes_for_jade_are_those_of_its_recordings() {
    let mut compared = 0;
    for entry in index("jade/index.json") {
        if entry["kind"] != "envelope" {
            continue;
        }
        let file = string(&entry["file"]);
        let recorded = recording(&format!("jade/{file}"));
        let envelope = read_envelope(&recorded);
        let mut expected = String::from_utf8(recorded.to_vec())
            .unwrap()
            .replace("?>\n", "?>")
            .replace("<addresses></addresses>", "");
        let date = expected.find("<date>").unwrap() + "<date>".len();
        expected.replace_range(date + 8..date + 9, "T");
        expected.insert(date + 18, 'Z');
        let written = envelope_for(Dialect::Jade, &envelope);
        assert_eq!(
            String::from_utf8(written.to_vec()).unwrap(),
            expected,
            "{file}"
        );
        compared += 1;
    }
    assert_eq!(compared, 113);
}

/// What fipa_services makes of a letter for the bridge, in one layer instead of four.
#[test]
fn a_letter_for_the_bridge_says_what_the_recorded_one_says() {
    let recorded = read_letter(recording("mts/sent_01_to_jade.bin"));
    assert_eq!(recorded.envelope.overlays.len(), 3);
    let mut out = Output::new();
    encode_letter_as(Dialect::JadeBridge, &recorded, &mut out).unwrap();
    let written = read_letter(out.take_bytes());
    assert_eq!(written.payload, recorded.payload);
    let flattened = Slots {
        received: recorded.envelope.stamps().last().cloned(),
        ..recorded.envelope.flattened()
    };
    assert_eq!(flattened.acl_representation, Some(Representation::String));
    let mut read = written.envelope.base;
    let dates = read.date.iter_mut();
    let stamped = read.received.iter_mut().map(|stamp| &mut stamp.date);
    for date in dates.chain(stamped) {
        if let FipaTime::Absolute { zone, .. } = date {
            *zone = fipa_acl::Zone::Unspecified;
        }
    }
    assert_eq!(read, flattened);
}
