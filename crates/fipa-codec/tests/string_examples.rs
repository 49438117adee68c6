//! What is written, octet for octet, and that what is long is shared.

mod string_support;

use bytes::Bytes;
use fipa_acl::{AgentId, Expression, FipaTime, Message, Performative, Relative, Text};
use fipa_codec::string::encode_message;
use fipa_codec::{EncodeError, Output};
use string_support::{octets_of, read};

fn inform() -> Message {
    Message::new(Performative::Inform)
}

fn text_of(message: &Message) -> String {
    String::from_utf8(octets_of(message).to_vec()).unwrap()
}

#[test]
fn all_parameters_stand_in_their_order() {
    let message = Message::new(Performative::Request)
        .from_agent(
            AgentId::new("i@p")
                .address("http://p:80/acc")
                .address("tcp://10.0.0.1:6789")
                .resolver(AgentId::new("r@p").resolver("s@p"))
                .user_defined("X-x-level", "very high"),
        )
        .to("j@q")
        .to("k@q")
        .reply_to("m@p")
        .content("((action (agent-identifier :name j@q) (say \"hi\")))")
        .language("fipa-sl0")
        .encoding("a b\\")
        .ontology("demo")
        .protocol("fipa-request")
        .conversation_id("c 1")
        .reply_with("r1")
        .in_reply_to("(a \"b c\" (1 x) 9z)")
        .reply_by("2026-01-02T03:04:05.678Z".parse::<FipaTime>().unwrap())
        .user_defined("trace", "42");
    let text = "(request \
        :sender (agent-identifier :name i@p \
        :addresses (sequence http://p:80/acc tcp://10.0.0.1:6789) \
        :resolvers (sequence (agent-identifier :name r@p \
        :resolvers (sequence (agent-identifier :name s@p)))) \
        :X-level \"very high\") \
        :receiver (set (agent-identifier :name j@q) (agent-identifier :name k@q)) \
        :reply-with r1 \
        :reply-by 20260102T030405678Z \
        :in-reply-to \"(a \\\"b c\\\" (1 x) 9z)\" \
        :reply-to (set (agent-identifier :name m@p)) \
        :language fipa-sl0 \
        :encoding #4\"a b\\ \
        :ontology demo \
        :protocol fipa-request \
        :conversation-id \"c 1\" \
        :X-trace \"42\" \
        :content \"((action (agent-identifier :name j@q) (say \\\"hi\\\")))\")";
    assert_eq!(text_of(&message), text);
    assert_eq!(read(text), message);
}

#[test]
fn values_are_words_literals_or_counted() {
    for (value, text) in [
        ("word", "word"),
        ("a\"b", "a\"b"),
        ("back\\slash", "back\\slash"),
        ("", "\"\""),
        ("two words", "\"two words\""),
        ("say \"hi\"", "\"say \\\"hi\\\"\""),
        ("C:\\dir\\x y", "\"C:\\dir\\x y\""),
        ("x y\\", "#4\"x y\\"),
        ("x \\\" y", "#6\"x \\\" y"),
        ("über\\", "#6\"über\\"),
        ("über", "\"über\""),
        ("42", "\"42\""),
        ("-x", "\"-x\""),
        ("#x", "\"#x\""),
        ("@x", "\"@x\""),
        // Readers take these for parameters.
        (":x", "\":x\""),
        ("a:content", "\"a:content\""),
        ("a:X-b", "\"a:X-b\""),
        ("a:1099/b", "a:1099/b"),
        ("20260102T030405678Z", "\"20260102T030405678Z\""),
        (
            "(a (b) 1 1.5e3 \"c d\" \"e\")",
            "(a (b) 1 1.5e3 \"c d\" \"e\")",
        ),
        ("()", "()"),
    ] {
        let message = inform().ontology(value);
        assert_eq!(text_of(&message), format!("(inform :ontology {text})"));
        assert_eq!(read(text_of(&message)), message);
    }
    let odd = Expression::List(vec![
        Expression::Number("no number".into()),
        Expression::Word("no word".into()),
        Expression::Word("7".into()),
        Expression::String(":x".into()),
    ]);
    let text = "(inform :ontology (\"no number\" \"no word\" \"7\" \":x\"))";
    assert_eq!(text_of(&inform().ontology(odd)), text);
}

#[test]
fn content_is_a_literal_if_it_is_text_that_one_can_hold() {
    for (content, text) in [
        (&b""[..], &b"\"\""[..]),
        (b"plain (text)\r\n", b"\"plain (text)\r\n\""),
        (b"a\0b", b"\"a\0b\""),
        (b"{\"k\": \"v\"}", b"\"{\\\"k\\\": \\\"v\\\"}\""),
        (b"\"", b"\"\\\"\""),
        (b"\xc3\xbc", b"\"\xc3\xbc\""),
        (b"end\\", b"#4\"end\\"),
        (b"\\\"", b"#2\"\\\""),
        (b"\x80\xff", b"#2\"\x80\xff"),
    ] {
        let message = inform().content(content);
        let octets = octets_of(&message);
        assert_eq!(octets, [b"(inform :content ", text, b")"].concat());
        assert_eq!(read(octets), message);
    }
}

#[test]
fn dates_have_their_zone_or_their_sign() {
    let reply_by = |time: FipaTime| text_of(&inform().reply_by(time));
    let time: FipaTime = "0000-01-01T00:00:00.001".parse().unwrap();
    assert_eq!(reply_by(time), "(inform :reply-by 00000101T000000001Z)");
    let time: FipaTime = "+P1Y2M3DT4H5M6.789S".parse().unwrap();
    assert_eq!(reply_by(time), "(inform :reply-by +00010203T040506789)");
    let time: FipaTime = "-PT5M".parse().unwrap();
    assert_eq!(reply_by(time), "(inform :reply-by -00000000T000500000)");
}

#[test]
fn what_cannot_be_written_is_refused_and_leaves_the_output_as_it_was() {
    let refused = |message: Message| -> EncodeError {
        let mut out = Output::new();
        out.put_slice(b"before");
        let error = encode_message(&message, &mut out).unwrap_err();
        assert_eq!(out.take_bytes(), &b"before"[..]);
        error
    };
    let act = refused(Message::new("shout"));
    assert_eq!(act.parameter, "performative");
    assert_eq!(refused(inform().to("two words")).parameter, "receiver");
    assert_eq!(refused(inform().from_agent("9lives")).parameter, "sender");
    assert_eq!(refused(inform().from_agent("")).parameter, "sender");
    assert_eq!(refused(inform().protocol("pröt")).parameter, "protocol");
    let far = AgentId::new("a").resolver(AgentId::new("b").address("http://a b"));
    assert_eq!(refused(inform().reply_to(far)).parameter, "reply-to");
    for name in ["", "X-", "a b", "a(b)", "ä", "a:b", "a#1", "a\"b"] {
        let error = refused(inform().user_defined(name, "v"));
        assert_eq!(error.parameter, "user-defined", "{name}");
    }
    let long = Relative {
        days: 100,
        ..Relative::default()
    };
    let error = refused(inform().reply_by(FipaTime::Relative(long)));
    assert_eq!(error.parameter, "reply-by");
}

#[test]
fn long_content_is_shared_in_both_directions() {
    let text = Bytes::from("long text ".repeat(1 << 16));
    let octets = Bytes::from(vec![0xff; 1 << 20]);
    for content in [text, octets] {
        let message = inform().to("a").content(content.clone());
        let mut out = Output::new();
        encode_message(&message, &mut out).unwrap();
        let parts = out.take();
        let [head, middle, tail] = parts.parts() else {
            panic!("{} parts", parts.parts().len());
        };
        assert_eq!(middle.as_ptr(), content.as_ptr());
        assert!(head.len() < 100 && tail.len() < 3);

        let octets = octets_of(&message);
        let decoded = fipa_codec::string::decode_message(&octets, &Default::default()).unwrap();
        assert!(decoded == message);
        let shared = decoded.content.unwrap().as_ptr();
        assert!(octets.as_ptr_range().contains(&shared));
    }
}

#[test]
fn longer_texts_share_the_input() {
    let long = |text: &str| text.to_owned() + &"z".repeat(Text::SHORT);
    let octets = octets_of(
        &inform()
            .from_agent(AgentId::new(long("a")).address(long("http://a")))
            .language(long("two words"))
            .protocol(long("p"))
            .user_defined(long("n"), long("v")),
    );
    let message = fipa_codec::string::decode_message(&octets, &Default::default()).unwrap();
    let sender = message.sender.unwrap();
    for text in [
        &*sender.name,
        &*sender.addresses[0],
        message.language.as_ref().unwrap().as_str().unwrap(),
        &*message.protocol.unwrap(),
        &*message.user_defined[0].name,
        message.user_defined[0].value.as_str().unwrap(),
    ] {
        assert!(octets.as_ptr_range().contains(&text.as_ptr()), "{text}");
    }
}
