//! What is written to peers in string form: each row of the table of dialects.

mod string_support;
mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, Message, Performative};
use fipa_codec::string::{decode_message, encode_message_as};
use fipa_codec::{Dialect, Limits, Output};
use string_support::read;
use support::{fipa_acl, recording};

const JADE: [Dialect; 2] = [Dialect::Jade, Dialect::JadeBridge];

fn octets_for(dialect: Dialect, message: &Message) -> Bytes {
    let mut out = Output::new();
    encode_message_as(dialect, message, &mut out).unwrap();
    out.take_bytes()
}

/// The text of a message, whose contents must be text, without its act and outer parentheses.
fn text_for(dialect: Dialect, message: &Message) -> String {
    let text = String::from_utf8(octets_for(dialect, message).to_vec()).unwrap();
    let inner = text.strip_prefix("(inform ").unwrap();
    inner.strip_suffix(')').unwrap().to_owned()
}

fn inform() -> Message {
    Message::new(Performative::Inform)
}

#[test]
fn strings_are_literals_where_these_are_read() {
    let message = inform().language("a b").ontology("word").content(" hi");
    for dialect in [Dialect::Standard, Dialect::Jade, Dialect::JadeBridge] {
        let text = ":language \"a b\" :ontology word :content \" hi\"";
        assert_eq!(text_for(dialect, &message), text);
    }
    let counted = ":language #3\"a b :ontology word :content #3\" hi";
    assert_eq!(text_for(Dialect::Cpp, &message), counted);
}

#[test]
fn what_no_literal_can_hold_is_counted_as_its_reader_counts() {
    let message = inform().language("\u{fc}\\").content("\u{1f680}\\");
    for dialect in [Dialect::Standard, Dialect::Cpp] {
        let text = ":language #3\"\u{fc}\\ :content #5\"\u{1f680}\\";
        assert_eq!(text_for(dialect, &message), text);
    }
    let text = ":language #2\"\u{fc}\\ :content #3\"\u{1f680}\\";
    assert_eq!(text_for(Dialect::Jade, &message), text);
    let text = ":language #2\"\u{fc}\\ :content \"8J+agFw=\" :X-JADE-Encoding Base64";
    assert_eq!(text_for(Dialect::JadeBridge, &message), text);
}

#[test]
fn content_that_is_no_text_is_base64_for_jade() {
    let message = inform().content(&b"\x80\xff"[..]).user_defined("a", "b");
    for dialect in JADE {
        let text = ":X-a b :content \"gP8=\" :X-JADE-Encoding Base64";
        assert_eq!(text_for(dialect, &message), text);
        assert_eq!(read(octets_for(dialect, &message)), message);
    }
    let octets = octets_for(Dialect::Standard, &message);
    assert_eq!(octets, &b"(inform :X-a b :content #2\"\x80\xff)"[..]);
    let octets = octets_for(Dialect::Cpp, &message);
    assert_eq!(octets, &b"(inform :X-a (b) :content #2\"\x80\xff)"[..]);
}

#[test]
fn content_beyond_ascii_is_base64_for_the_bridge_alone() {
    let message = inform().content("gr\u{fc}n");
    let bridge = ":content \"Z3LDvG4=\" :X-JADE-Encoding Base64";
    assert_eq!(text_for(Dialect::JadeBridge, &message), bridge);
    for dialect in [Dialect::Standard, Dialect::Jade] {
        let text = ":content \"gr\u{fc}n\"";
        assert_eq!(text_for(dialect, &message), text);
    }
    let ascii = inform().content("green");
    assert_eq!(text_for(Dialect::JadeBridge, &ascii), ":content \"green\"");
}

#[test]
fn base64_is_that_of_the_recording() {
    for (case, dialect) in [("bytes-256", JADE[0]), ("bytes-70000", JADE[1])] {
        let recorded = recording(&format!("jade/out_string_{case}.acl"));
        let written = octets_for(dialect, &read(&recorded));
        let literal = |octets: &Bytes| {
            let text = String::from_utf8(octets.to_vec()).unwrap();
            let (_, content) = text.split_once(":content").unwrap();
            content.split('"').nth(1).unwrap().to_owned()
        };
        assert_eq!(literal(&written), literal(&recorded), "{case}");
        assert!(written.ends_with(b" :X-JADE-Encoding Base64)"), "{case}");
    }
}

#[test]
fn the_cpp_reader_has_parameters_in_parentheses_and_one_level_of_resolvers() {
    let resolver = AgentId::new("b").resolver("c").user_defined("q", "r");
    let sender = AgentId::new("a").resolver(resolver).user_defined("p", "q");
    let message = inform()
        .from_agent(sender)
        .user_defined("n", "v w")
        .user_defined("m", "");
    let cpp = ":sender (agent-identifier :name a :resolvers (sequence (agent-identifier :name b))) \
        :X-n (#3\"v w) :X-m (#0\")";
    assert_eq!(text_for(Dialect::Cpp, &message), cpp);
    for dialect in [Dialect::Standard, Dialect::Jade, Dialect::JadeBridge] {
        let text = ":sender (agent-identifier :name a :resolvers (sequence (agent-identifier \
            :name b :resolvers (sequence (agent-identifier :name c)) :X-q r)) :X-p q) \
            :X-n \"v w\" :X-m \"\"";
        assert_eq!(text_for(dialect, &message), text);
    }
}

#[test]
fn dates_have_their_letter_where_it_is_read() {
    let message = Message {
        reply_by: Some("2026-01-02T03:04:05.678Z".parse().unwrap()),
        ..inform()
    };
    assert_eq!(
        text_for(Dialect::Cpp, &message),
        ":reply-by 20260102T030405678"
    );
    for dialect in [Dialect::Standard, Dialect::Jade, Dialect::JadeBridge] {
        let text = ":reply-by 20260102T030405678Z";
        assert_eq!(text_for(dialect, &message), text);
    }
}

/// What fipa_acl was seen to read is what it wrote: every counted string, date and parameter in
/// parentheses that is written to it stands in its recording of the same message.
#[test]
fn what_is_written_to_cpp_stands_in_its_recordings() {
    let mut compared = 0;
    for (name, recorded, entry) in fipa_acl("string", "message") {
        if entry["peer_decode"]["equal"] != true {
            continue;
        }
        let message = read(&recorded);
        let written = octets_for(Dialect::Cpp, &message);
        let again = decode_message(&written, &Limits::default()).unwrap();
        assert_eq!(again.content, message.content, "{name}");
        assert_eq!(again.reply_by, message.reply_by, "{name}");
        let stands = |part: &[u8]| recorded.windows(part.len()).any(|here| here == part);
        if let Some(content) = &message.content {
            let part = [format!(":content#{}\"", content.len()).as_bytes(), content].concat();
            assert!(stands(&part), "{name}");
            let part = [format!(":content #{}\"", content.len()).as_bytes(), content].concat();
            assert!(
                written.windows(part.len()).any(|here| here == part),
                "{name}"
            );
        }
        compared += 1;
    }
    assert!(compared > 50, "{compared} messages");
}
