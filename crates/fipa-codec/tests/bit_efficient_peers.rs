//! Recordings of JADE's bit-efficient add-on.

mod support;

use fipa_acl::{
    AgentId, Envelope, Expression, Message, Performative, Received, Representation, Slots, Zone,
};
use fipa_codec::bit_efficient::{decode_letter, decode_message};
use fipa_codec::{Fault, Limits};
use support::{index, letter, message, recording, string};

/// What all messages of the recorded agent have in common.
fn from_jade(act: Performative, case: &str) -> Message {
    let agent = |name: &str, url: &str| AgentId::new(name).address(url);
    Message::new(act)
        .from_agent(agent("cap@capplat", "http://127.0.0.1:7780/acc"))
        .to(agent("pyagent@pyplat", "http://127.0.0.1:9990/acc"))
        .conversation_id(format!("case-be-{case}"))
}

/// The recorded cases as the agent made them, as far as the add-on writes them.
fn jade_case(case: &str) -> Option<Message> {
    let request = from_jade(Performative::Request, case);
    let at = |name: &str| AgentId::new(name).address("http://127.0.0.1:9990/acc");
    let two = |name: &str| at(name).address("http://127.0.0.1:9/acc");
    Some(match case {
        "basic" => request
            .content("hello world")
            .ontology("echo")
            .encoding("plain")
            .language("text")
            .protocol("fipa-request")
            .reply_with("rw-1")
            .in_reply_to("irt-0"),
        "empty-content" | "minimal" => from_jade(Performative::Inform, case),
        "bytes-256" => request.content((0..=255).collect::<Vec<u8>>()),
        "bytes-70000" => request.content(
            (0..70_000)
                .map(|i| (i * 31 + i / 256) as u8)
                .collect::<Vec<u8>>(),
        ),
        "big-70000" => request.content("0123456789abcdef".repeat(70_000 / 16)),
        "convid-number" => Message {
            conversation_id: Some(Expression::Word("20260101".into())),
            ..request.reply_with("case-be-convid-number").content("x")
        },
        "multi-receivers" => request
            .to(two("second@pyplat"))
            .to(at("third@otherplat"))
            .content("x"),
        "newlines" => request.content("line1\nline2\r\nline3\ttab"),
        "protocol-two-words" => request.protocol("two words").content("x"),
        "quotes" => request.content("say \"hi\" and \\ backslash and \\\" both"),
        "receiver-no-address" => request.to("noaddr@elsewhere").content("x"),
        "reply-to" => request
            .reply_to(at("boss@pyplat"))
            .reply_to(two("deputy@pyplat"))
            .content("x"),
        "spaces-trim" => request.content("   padded both sides   "),
        "user-params" => request
            .user_defined("lower", "v\"q")
            .user_defined("priority", "5")
            .user_defined("note", "two words")
            .user_defined("word", "abc")
            .user_defined("already", "prefixed")
            .content("x"),
        // The add-on counts characters where it writes octets: the end is lost.
        "utf16-declared" => request.content("grü"),
        "utf8-declared" | "utf8-default" => {
            request.content(&b"gr\xc3\xbc\xc3\x9f \xe4\xbd\xa0\xe5\xa5"[..])
        }
        _ => {
            let act = Performative::standard(case.strip_prefix("perf-")?)?;
            from_jade(act, case).content("x")
        }
    })
}

#[test]
fn messages_of_jade_have_the_values_that_the_agent_gave_them() {
    let mut read = 0;
    for entry in index("jade/index.json") {
        if entry["representation"] != "be" || entry["kind"] != "acl-payload" {
            continue;
        }
        let case = string(&entry["case"]);
        let octets = recording(&format!("jade/{}", string(&entry["file"])));
        assert_eq!(
            octets.len() as u64,
            entry["bytes"].as_u64().unwrap(),
            "{case}"
        );
        let decoded = message(octets);
        if case == "reply-by" {
            let time = decoded.reply_by.unwrap();
            assert_eq!(time.to_string(), "2031-02-03T04:05:06.789Z");
            assert!(matches!(
                time,
                fipa_acl::FipaTime::Absolute {
                    zone: Zone::Utc,
                    ..
                }
            ));
        } else {
            let expected = jade_case(&case).unwrap_or_else(|| panic!("{case} is not in the table"));
            // Some are too long to be printed.
            assert!(decoded == expected, "{case}");
        }
        read += 1;
    }
    assert!(read > 30, "{read} messages");
}

#[test]
fn an_answer_of_jade_with_octets_as_content_is_read() {
    let answer = message(recording("jade/in2_be-echo-bytes.reply.acl"));
    assert_eq!(answer.performative, Performative::Inform);
    assert!(answer.content.is_some());
}

#[test]
fn the_first_message_with_a_code_table_is_read_and_the_next_is_unsupported() {
    for table in ["8", "9", "16"] {
        let first = message(recording(&format!("jade/be_codetable{table}_seq1.acl")));
        assert_eq!(first.conversation_id.unwrap(), Expression::from("conv-1"));
        for later in ["2", "3"] {
            let octets = recording(&format!("jade/be_codetable{table}_seq{later}.acl"));
            let error = decode_message(&octets, &Limits::default()).unwrap_err();
            assert_eq!(error.fault, Fault::Unsupported);
        }
    }
}

/// What all envelopes of the add-on say.
fn base_of_add_on() -> Slots {
    let agent = |name: &str, url: &str| AgentId::new(name).address(url);
    let receiver = agent("b@platY", "http://127.0.0.1:2/acc");
    Slots {
        to: vec![receiver.clone()],
        from: Some(agent("a@platX", "http://127.0.0.1:1/acc")),
        date: Some("2031-02-03T04:05:06.789Z".parse().unwrap()),
        intended_receiver: vec![receiver],
        ..Slots::default()
    }
}

/// One with all parameters.
fn full_base_of_add_on() -> Slots {
    Slots {
        acl_representation: Some(Representation::Other("my.own.rep".into())),
        comments: Some("a comment".into()),
        payload_length: Some(70_000),
        payload_encoding: Some("UTF-8".into()),
        ..base_of_add_on()
    }
}

#[test]
fn envelopes_of_the_add_on_are_read() {
    let basic = |representation| Slots {
        acl_representation: Some(representation),
        payload_length: Some(123),
        ..base_of_add_on()
    };
    for (file, base) in [
        ("basic", basic(Representation::BitEfficient)),
        ("stringrep", basic(Representation::String)),
        ("xmlrep", basic(Representation::Xml)),
        ("full", full_base_of_add_on()),
    ] {
        let letter = letter(recording(&format!("jade/be_envelope_{file}.bin")));
        assert!(letter.payload.is_empty(), "{file}");
        assert_eq!(letter.envelope, Envelope::new(base), "{file}");
    }
}

#[test]
fn a_stamp_of_the_add_on_with_a_code_in_front_is_read() {
    let octets = recording("jade/be_envelope_received.bin");
    let letter = decode_letter(&octets, &Limits::default()).unwrap();
    let received = Some(Received {
        by: "http://127.0.0.1:2/acc".into(),
        from: Some("http://127.0.0.1:1/acc".into()),
        date: "2031-02-03T04:05:06.789Z".parse().unwrap(),
        id: Some("id-1".into()),
        via: Some("http".into()),
        user_defined: Vec::new(),
    });
    let base = Slots {
        received: received.clone(),
        ..full_base_of_add_on()
    };
    let overlays = vec![Slots {
        received,
        ..Slots::default()
    }];
    assert_eq!(letter.envelope, Envelope { base, overlays });
}
