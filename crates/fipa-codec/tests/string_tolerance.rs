//! What is accepted beyond the letter of the standard, and what is not.

mod string_support;

use bytes::Bytes;
use fipa_acl::{AgentId, Expression, FipaTime, Message, Performative, Zone};
use fipa_codec::string::{decode_message, decode_message_prefix};
use fipa_codec::{Fault, Limits};
use string_support::{read, refused};

fn inform() -> Message {
    Message::new(Performative::Inform)
}

#[test]
fn white_space_is_free_and_case_does_not_matter() {
    for text in [
        "(inform :sender (agent-identifier :name a) :receiver (set) :language l)",
        "( INFORM\n\t:Sender( Agent-Identifier :NAME a ):RECEIVER(SET):LANGUAGE\r\nl ) \r\n",
        "\u{feff}(inform :language l :sender (agent-identifier :name a) :receiver (sequence))",
    ] {
        assert_eq!(read(text), inform().from_agent("a").language("l"));
    }
    assert_eq!(read("(Request-Whenever)"), Message::new("request-whenever"));
    assert_eq!(read("(Shout)").performative.as_str(), "Shout");
    assert_eq!(read("(inform-what)").performative.as_str(), "inform-what");
}

#[test]
fn the_last_of_several_counts_and_user_defined_ones_are_kept() {
    let message = read(
        "(inform :language a :language b :receiver (set (agent-identifier :name a)) \
         :receiver (set (agent-identifier :name b)) :X-n 1 :x-n 2 :n 3 :X-X-n 4 \
         :sender (agent-identifier :addresses (sequence u) :name a :p q :name b))",
    );
    let expected = inform()
        .language("b")
        .to("b")
        .user_defined("n", "1")
        .user_defined("n", "2")
        .user_defined("n", "3")
        .user_defined("n", "4")
        .from_agent(AgentId::new("b").address("u").user_defined("p", "q"));
    assert_eq!(message, expected);
}

#[test]
fn a_literal_ends_at_the_first_quote_without_a_backslash_or_at_the_last_quote() {
    for (literal, text) in [
        (r#""""#, ""),
        (r#""a\"b""#, r#"a"b"#),
        (r#""a\b""#, r"a\b"),
        (r#""a\\"b""#, r#"a\"b"#),
        (r#""\"""#, r#"""#),
        (r#""\""#, r"\"),
        (r#""a\""#, r"a\"),
        (r#""a\\""#, r"a\\"),
        (r#""a\"b\""#, r#"a"b\"#),
    ] {
        let message = read(format!("(inform :content {literal} :language l)"));
        let expected = inform().content(text.to_owned()).language("l");
        assert_eq!(message, expected, "{literal}");
    }
    let (offset, fault) = refused(r#"(inform :content "a\" :language "b c")"#);
    assert_eq!((offset, fault), (33, Fault::Malformed));
    assert_eq!(refused(r#"(inform :content "a)"#), (17, Fault::Malformed));
}

#[test]
fn content_may_be_what_is_no_string() {
    for content in ["word", "12", "(a \"b )\" (c))", "20260102T030405678Z", "()"] {
        let message = read(format!("(inform :content {content} :language l)"));
        assert_eq!(message.content.unwrap(), content);
        assert_eq!(message.language, Some("l".into()));
    }
}

#[test]
fn a_protocol_may_have_several_words() {
    for (text, protocol) in [
        ("(inform :protocol two words)", "two words"),
        ("(inform :protocol  two \n words :language l)", "two words"),
        ("(inform :protocol a 9 -z)", "a 9 -z"),
        ("(inform :protocol :a b)", ":a b"),
        ("(inform :protocol \"two  words\")", "two  words"),
        ("(inform :protocol #3\"a b)", "a b"),
    ] {
        assert_eq!(read(text).protocol.unwrap(), protocol);
    }
    assert_eq!(
        refused("(inform :protocol \"a\" b)"),
        (22, Fault::Malformed)
    );
}

#[test]
fn dates_have_signs_zones_offsets_or_none() {
    let time = |text: &str| read(format!("(inform :reply-by {text})")).reply_by.unwrap();
    let at = |text: &str| -> FipaTime { text.parse().unwrap() };
    for (text, meaning) in [
        ("20260102T030405678Z", "2026-01-02T03:04:05.678Z"),
        ("20260102t030405678z", "2026-01-02T03:04:05.678Z"),
        ("20260102T030405678A", "2026-01-02T02:04:05.678Z"),
        ("20260102T030405678M", "2026-01-01T15:04:05.678Z"),
        ("20260102T030405678N", "2026-01-02T04:04:05.678Z"),
        ("20260102T030405678Y", "2026-01-02T15:04:05.678Z"),
        ("20260102T030405678+0130", "2026-01-02T01:34:05.678Z"),
        ("20260102T030405678-0130", "2026-01-02T04:34:05.678Z"),
        ("20260102T030405Z", "2026-01-02T03:04:05Z"),
        ("\"20260102T030405678Z\"", "2026-01-02T03:04:05.678Z"),
        ("+00000000T000500000", "+PT5M"),
        ("-00010203T040506789Z", "-P1Y2M3DT4H5M6.789S"),
    ] {
        assert_eq!(time(text), at(meaning), "{text}");
    }
    for text in ["20260102T030405678", "20260102T030405678J"] {
        let FipaTime::Absolute { zone, .. } = time(text) else {
            panic!("{text} is relative");
        };
        assert_eq!(zone, Zone::Unspecified);
    }
    for (text, fault) in [
        ("20260230T000000000Z", Fault::Violation),
        ("20260102T250000000Z", Fault::Violation),
        ("00000101T000000000A", Fault::Violation),
        ("20260102T03040567", Fault::Malformed),
        ("20260102T030405678ZZ", Fault::Malformed),
        ("20260102T030405678+01:3", Fault::Malformed),
        ("2026010aT030405678Z", Fault::Malformed),
        ("2026-01-02T03:04:05Z", Fault::Malformed),
        ("+", Fault::Malformed),
        ("()", Fault::Malformed),
    ] {
        let (offset, found) = refused(format!("(inform :reply-by {text})"));
        assert_eq!((offset, found), (18, fault), "{text}");
    }
}

#[test]
fn tokens_that_are_neither_words_nor_numbers_are_kept_as_words() {
    let message = read("(inform :language (1 -1.5E+3 .5 5. 1e 20260102T030405678Z - @a + 1a))");
    let Some(Expression::List(items)) = message.language else {
        panic!("no list");
    };
    let is_number = |item: &Expression| matches!(item, Expression::Number(_));
    let numbers: Vec<_> = items.iter().map(is_number).collect();
    let expected = [
        true, true, true, true, false, false, false, false, false, false,
    ];
    assert_eq!(numbers, expected);
    assert_eq!(
        read("(inform :ontology 1a-2b)").ontology.unwrap(),
        "1a-2b".into()
    );
}

#[test]
fn base64_that_says_so_is_undone() {
    let message = read("(inform :X-JADE-Encoding Base64 :content \"AAEC/w==\" :X-a b)");
    let expected = inform()
        .content(&b"\x00\x01\x02\xff"[..])
        .user_defined("a", "b");
    assert_eq!(message, expected);
    let message = read("(inform :content \"AA\n EC /w\" :x-jade-encoding \"BASE64\")");
    assert_eq!(message, inform().content(&b"\x00\x01\x02\xff"[..]));
    // What is none is left as it is.
    for content in ["no Base64!", "AAE*"] {
        let message = read(format!(
            "(inform :X-JADE-Encoding Base64 :content \"{content}\")"
        ));
        let expected = inform()
            .content(content)
            .user_defined("JADE-Encoding", "Base64");
        assert_eq!(message, expected);
    }
    let message = read("(inform :X-JADE-Encoding Other :content \"AAEC\")");
    assert_eq!(message.content.unwrap(), "AAEC");
}

#[test]
fn text_that_is_not_utf8_is_replaced_outside_content() {
    let message = read(
        &b"(inform :content \"\xff\" :language \"a\xff\" :protocol \xfe :X-\xff #1\"\xff \
         :ontology (\"\xff\\\"\" \xff))"[..],
    );
    assert_eq!(message.content.unwrap(), &b"\xff"[..]);
    assert_eq!(message.language.unwrap(), "a\u{fffd}".into());
    assert_eq!(message.protocol.unwrap(), "\u{fffd}");
    assert_eq!(message.user_defined[0].name, *"\u{fffd}");
    assert_eq!(message.user_defined[0].value, "\u{fffd}".into());
    let list = Expression::List(vec!["\u{fffd}\"".into(), "\u{fffd}".into()]);
    assert_eq!(message.ontology.unwrap(), list);
}

#[test]
fn text_without_white_space_is_read() {
    assert_eq!(read("(inform:content#5\"hello)"), inform().content("hello"));
    assert_eq!(read("(inform:content#4\"a)(b)"), inform().content("a)(b"));
    assert_eq!(
        read(
            "(REQUEST:SENDER(AGENT-IDENTIFIER:NAMEa@b:1099/c:ADDRESSES(SEQUENCEhttp://u:name/ v )))"
        ),
        Message::new(Performative::Request).from_agent(
            AgentId::new("a@b:1099/c")
                .address("http://u:name/")
                .address("v")
        ),
    );
    let message = read(
        "(my-act:protocolp:languagel:X-a(#1\"b):X-c\"d e\":X-f g:unknown#2\"hi\
         :reply-by20260102T030405678:conversation-id(a:name b))",
    );
    let list = Expression::List(vec!["a:name".into(), "b".into()]);
    assert_eq!(message.performative.as_str(), "my-act");
    assert_eq!(message.protocol.unwrap(), "p");
    assert_eq!(message.conversation_id.unwrap(), list);
    assert!(message.reply_by.is_some());
}

#[test]
fn parameters_of_agents_without_white_space_are_read_behind_a_parenthesis() {
    let message = read(
        "(inform:sender(agent-identifier:namea:addresses(sequenceu )p0#2\"v0p1#9\"value one)\
         :content#1\"c)",
    );
    let sender = AgentId::new("a")
        .address("u")
        .user_defined("p0", "v0")
        .user_defined("p1", "value one");
    assert_eq!(message, inform().from_agent(sender).content("c"));
    let (offset, _) = refused("(inform:sender(agent-identifier:nameap0#2\"v0))");
    assert_eq!(offset, 36);
}

#[test]
fn words_with_white_space_around_them_may_hold_keywords() {
    let message = read("(inform :language a:content :X-a b:name :protocol :sender)");
    let expected = inform()
        .language("a:content")
        .user_defined("a", "b:name")
        .protocol(":sender");
    assert_eq!(message, expected);
}

#[test]
fn one_message_is_read_from_the_front_of_the_input() {
    let octets = Bytes::from_static(b"(inform :content \"a\")(request) rest");
    let limits = Limits::default();
    let (message, used) = decode_message_prefix(&octets, &limits).unwrap();
    assert_eq!((message, used), (inform().content("a"), 21));
    let (message, used) = decode_message_prefix(&octets.slice(21..), &limits).unwrap();
    assert_eq!((message.performative, used), (Performative::Request, 9));
    let error = decode_message(&octets, &limits).unwrap_err();
    assert_eq!((error.offset, error.fault), (21, Fault::Malformed));
    assert!(decode_message(&octets.slice(..21), &limits).is_ok());
}
