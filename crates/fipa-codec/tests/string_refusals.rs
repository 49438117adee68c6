//! What is refused, and that hostile inputs cost no more time and memory than honest ones.

mod string_support;

use std::time::{Duration, Instant};

use bytes::Bytes;
use fipa_acl::{Message, Performative};
use fipa_codec::string::{decode_message, decode_message_prefix};
use fipa_codec::{Fault, Limits};
use string_support::{octets_of, refused};

const MANY: usize = 1 << 18;

#[test]
fn errors_tell_where_they_are() {
    for (text, offset) in [
        ("", 0),
        (" ", 1),
        ("inform", 0),
        ("<xml/>", 0),
        ("(", 1),
        ("()", 1),
        ("(\"inform\")", 1),
        ("(#6\"inform)", 1),
        ("(12)", 1),
        ("(:content \"x\")", 1),
        ("((inform))", 1),
        ("(inform", 7),
        ("(inform \0)", 8),
        ("(inform word)", 8),
        ("(inform : x)", 8),
        ("(inform :X- x)", 11),
        ("(inform :content)", 16),
        ("(inform :content #)", 17),
        ("(inform :content #x)", 17),
        ("(inform :content #\"x)", 17),
        ("(inform :content #2\"x", 17),
        ("(inform :content #99999999999999999999\"x)", 17),
        ("(inform :content (a)", 20),
        ("(inform :language (a", 20),
        ("(inform :language \"a)", 18),
        ("(inform :sender a)", 16),
        ("(inform :sender (a))", 17),
        ("(inform :sender (agent-identifier))", 33),
        (
            "(inform :sender (agent-identifier :addresses (sequence)))",
            55,
        ),
        (
            "(inform :sender (agent-identifier :name a :addresses u))",
            53,
        ),
        (
            "(inform :sender (agent-identifier :name a :addresses (u)))",
            54,
        ),
        ("(inform :receiver (agents))", 19),
        ("(inform :receiver (set a))", 23),
        ("(inform :receiver (set) :reply-to a)", 34),
        ("(inform) x", 9),
    ] {
        assert_eq!(refused(text), (offset, Fault::Malformed), "{text}");
    }
}

/// The fault of this text, which is found soon.
fn fault(parts: &[&[u8]]) -> Option<Fault> {
    let octets = Bytes::from(parts.concat());
    let begin = Instant::now();
    let result = decode_message(&octets, &Limits::default());
    let _ = decode_message_prefix(&octets, &Limits::default());
    assert!(begin.elapsed() < Duration::from_secs(10), "{parts:.80?}");
    result.err().map(|error| error.fault)
}

#[test]
fn depth_is_limited() {
    let deep = |open: &str, close: &str, depth| {
        let text = [&*open.repeat(depth), &*close.repeat(depth)].concat();
        fault(&[b"(inform :language ", text.as_bytes(), b")"])
    };
    assert_eq!(deep("(", ")", 32), None);
    assert_eq!(deep("(", ")", 33), Some(Fault::Limit));
    assert_eq!(deep("(a ", ")", MANY), Some(Fault::Limit));
    assert_eq!(deep("(", "", MANY), Some(Fault::Limit));
    let resolvers = |text: &str, depth| {
        let text = [text].repeat(depth).concat();
        fault(&[b"(inform :sender ", text.as_bytes()])
    };
    let spaced = "(agent-identifier :name a :resolvers (sequence ";
    assert_eq!(resolvers(spaced, 30), Some(Fault::Malformed));
    assert_eq!(resolvers(spaced, MANY / 64), Some(Fault::Limit));
    let glued = "(agent-identifier:namea:resolvers(sequence";
    assert_eq!(resolvers(glued, MANY / 64), Some(Fault::Limit));
}

#[test]
fn entries_of_lists_are_limited() {
    let many = |begin: &str, text: &str, count| {
        let text = text.repeat(count);
        fault(&[begin.as_bytes(), text.as_bytes(), b"))"])
    };
    let limit = Limits::default().max_items;
    assert_eq!(many("(inform :language (", "a ", limit), None);
    assert_eq!(
        many("(inform :language (", "a ", limit + 1),
        Some(Fault::Limit)
    );
    assert_eq!(many("(inform :language (", "()", MANY), Some(Fault::Limit));
    assert_eq!(many("(inform ", ":a b", MANY), Some(Fault::Malformed));
    assert_eq!(many("(inform ", ":a b ", MANY), Some(Fault::Limit));
    assert_eq!(many("(inform", ":X-a()", MANY), Some(Fault::Limit));
    let agents = "(inform :receiver (set ";
    assert_eq!(
        many(agents, "(agent-identifier :name a)", MANY / 2),
        Some(Fault::Limit)
    );
    let addresses = "(inform :sender (agent-identifier :name a :addresses (sequence ";
    assert_eq!(many(addresses, "u ", MANY), Some(Fault::Limit));
}

#[test]
fn repetitions_cost_no_more_than_their_length() {
    for (begin, text) in [
        ("(inform ", ":"),
        ("(inform", ":"),
        ("(inform", ":X-"),
        ("(inform", ":X-a"),
        ("(inform", ":language"),
        ("(inform", ":nam"),
        ("(inform:protocol a", ":"),
        ("(inform:protocola", ":nam"),
        ("(inform:X-", "#1"),
        ("(inform:X-#", "1"),
        ("(inform:X-", "#"),
        ("(inform:sender(agent-identifier:namea", "#1"),
        ("(inform:sender(agent-identifier:name a ", "#1"),
        ("(inform ", " "),
        ("(inform :content \"", "\\\""),
        ("(inform ", ":content \"\\\" "),
        ("(inform ", ":content \"a\\\"\" "),
        ("(inform :protocol ", "a "),
        ("(inform:protocol ", "a "),
        ("(inform :content #", "9"),
        ("", " "),
        ("", "("),
    ] {
        let found = fault(&[begin.as_bytes(), text.repeat(MANY).as_bytes()]);
        assert_eq!(found, Some(Fault::Malformed), "{begin}{text}");
    }
}

#[test]
fn the_length_of_the_input_is_limited() {
    let message = Message::new(Performative::Inform).content("0123456789");
    let octets = octets_of(&message);
    for max_octets in 0..octets.len() {
        let limits = Limits {
            max_octets,
            ..Limits::default()
        };
        let error = decode_message(&octets, &limits).unwrap_err();
        assert_eq!(error.fault, Fault::Limit, "{max_octets}");
        assert!(error.offset <= max_octets);
    }
    // What is beyond the limit could hold the closing quote.
    let octets = Bytes::from_static(br#"(inform :content "a\" :X-b c)   "d")"#);
    let limits = Limits {
        max_octets: 30,
        ..Limits::default()
    };
    assert_eq!(
        decode_message(&octets, &limits).unwrap_err().fault,
        Fault::Limit
    );
}

#[test]
fn a_very_long_content_survives() {
    let mut content = vec![b'x'; 100 << 20];
    for last in [b'x', 0xff] {
        *content.last_mut().unwrap() = last;
        let message = Message::new(Performative::Inform).content(content.clone());
        let octets = octets_of(&message);
        let decoded = decode_message(&octets, &Limits::default()).unwrap();
        assert!(decoded == message, "{last}");
    }
}
