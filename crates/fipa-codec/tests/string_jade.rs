//! Recordings of JADE in string form.

mod string_support;
mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, Expression, FipaTime, Message, Performative, UserDefined};
use fipa_codec::Fault;
use string_support::{octets_of, read, refused};
use support::{index, message as bit_efficient, path, recording, string};

/// The recorded cases in string form: case, octets.
fn cases() -> Vec<(String, Bytes)> {
    let entries = index("jade/index.json").into_iter();
    entries
        .filter(|entry| entry["representation"] == "string" && entry["kind"] == "acl-payload")
        .map(|entry| {
            let octets = recording(&format!("jade/{}", string(&entry["file"])));
            assert_eq!(octets.len() as u64, entry["bytes"].as_u64().unwrap());
            (string(&entry["case"]), octets)
        })
        .collect()
}

/// What the agent said in this case, as its bit-efficient recording has it, save for what the
/// encoder of the string form, or that of the other form, loses.
fn expected(case: &str) -> Message {
    let mut message = bit_efficient(recording(&format!("jade/out_be_{case}.acl")));
    let in_string_form = |tag: &mut Option<Expression>| {
        if *tag == Some(Expression::from(format!("case-be-{case}"))) {
            *tag = Some(Expression::from(format!("case-string-{case}")));
        }
    };
    in_string_form(&mut message.conversation_id);
    in_string_form(&mut message.reply_with);
    match case {
        // White space around the content is lost.
        "spaces-trim" => message.content = Some("padded both sides".into()),
        // The other form ends too early.
        "utf8-declared" => message.content = Some("grüß 你好 € 🚀".into()),
        // Without a charset it is ASCII.
        "utf8-default" => message.content = Some("gr?? ?? ? ?".into()),
        _ => {}
    }
    message
}

/// The cases that are recorded in this form only, without sender, receiver and conversation.
fn only_here(case: &str) -> Option<Message> {
    let at = |name: &str| AgentId::new(name).address("http://127.0.0.1:9990/acc");
    let request = || Message::new(Performative::Request);
    Some(match case {
        // Names that are no words are quoted.
        "aid-odd-names" => request()
            .reply_to(at("name with space@pyplat"))
            .reply_to(at("#hash@pyplat"))
            .reply_to(at("7up@pyplat"))
            .reply_to(at("paren(1)@pyplat"))
            .content("x"),
        "slots-odd-values" => request()
            .content("x")
            .reply_with("1.5e3")
            .in_reply_to("a(b)c")
            .encoding("#tag")
            .language("two words")
            .ontology("12")
            .protocol("proto-x"),
        _ => return None,
    })
}

#[test]
fn messages_have_the_values_of_their_bit_efficient_form() {
    let mut compared = 0;
    for (case, octets) in cases() {
        if !path(&format!("jade/out_be_{case}.acl")).exists() {
            continue;
        }
        let mut message = read(octets);
        let mut expected = expected(&case);
        let by_name = |parameter: &UserDefined| parameter.name.clone();
        message.user_defined.sort_by_key(by_name);
        expected.user_defined.sort_by_key(by_name);
        // Some are too long to be printed.
        assert!(message == expected, "{case}");
        compared += 1;
    }
    assert!(compared > 30, "{compared} messages");
}

#[test]
fn messages_recorded_in_string_form_only_are_read() {
    for (case, octets) in cases() {
        if path(&format!("jade/out_be_{case}.acl")).exists() {
            continue;
        }
        let message = read(octets);
        assert_eq!(message.sender.as_ref().unwrap().name, *"cap@capplat");
        assert_eq!(message.receiver.len(), 1, "{case}");
        let id = Expression::from(format!("case-string-{case}"));
        assert_eq!(message.conversation_id, Some(id), "{case}");
        if let Some(expected) = only_here(&case) {
            let bare = Message {
                sender: None,
                receiver: Vec::new(),
                conversation_id: None,
                ..message
            };
            assert_eq!(bare, expected, "{case}");
        } else {
            assert!(
                case.starts_with("ams-") || case.starts_with("df-"),
                "{case}"
            );
            let content = message.content_str().unwrap();
            assert!(
                content.starts_with("((") && content.ends_with("))"),
                "{case}"
            );
            assert_eq!(
                message.ontology.unwrap().as_str(),
                Some("FIPA-Agent-Management")
            );
        }
    }
}

fn names_of_user_defined(answer: &str) -> Option<&'static str> {
    match answer {
        "in_df-deregister-notify.reply.acl" | "in2_df-subscribe-existing.reply.acl" => {
            Some("JADE-ignore-failure")
        }
        _ => None,
    }
}

#[test]
fn answers_are_read_and_come_back_unchanged() {
    let mut answers = 0;
    for file in std::fs::read_dir(path("jade")).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        if !name.ends_with(".reply.acl") {
            continue;
        }
        let octets = recording(&format!("jade/{name}"));
        if octets[0] != b'(' {
            continue;
        }
        let message = read(octets);
        assert!(message.sender.is_some(), "{name}");
        assert!(!message.receiver.is_empty(), "{name}");
        let names = message
            .user_defined
            .iter()
            .map(|parameter| &*parameter.name);
        // That of the Base64 is not shown.
        assert!(names.eq(names_of_user_defined(&name)), "{name}");
        assert_eq!(read(octets_of(&message)), message, "{name}");
        answers += 1;
    }
    assert!(answers > 50, "{answers} answers");
}

#[test]
fn contents_of_answers_are_what_the_agent_echoed() {
    for (case, content) in [
        ("in_echo-base64", &b"\x00\x01\x02\x03\x04\x05\xff"[..]),
        ("in_echo-ble", b"ab\"c(d)\\e:f"),
        ("in_echo-ble-binary", b"\x80\xff"),
        ("in_echo-utf8-nodecl", b"gr???? ??????"),
        ("in_echo-userdef", b"u"),
    ] {
        let answer = read(recording(&format!("jade/{case}.reply.acl")));
        assert_eq!(answer.content.unwrap(), content, "{case}");
    }
}

/// The inputs that JADE's decoder was asked about, and its answers.
fn probes() -> Vec<(String, String)> {
    let text = String::from_utf8(recording("jade/string_decode_probes.txt").to_vec()).unwrap();
    let parts: Vec<_> = text.split("\n    -> ").collect();
    let inputs = parts.iter().map(|part| part.rsplit('\n').next().unwrap());
    let answers = parts
        .iter()
        .skip(1)
        .map(|part| match part.rsplit_once('\n') {
            Some((answer, _next)) if !part.ends_with('\n') => answer,
            _ => part.trim_end_matches('\n'),
        });
    inputs
        .zip(answers)
        .map(|(input, answer)| (input.replace("<LF>", "\n"), answer.to_owned()))
        .collect()
}

/// A message as JADE prints it, as far as it can be compared.
fn as_jade_prints(message: &Message) -> String {
    let tag = |tag: &Option<Expression>| match tag {
        // It has a blank behind each item.
        Some(list @ Expression::List(_)) => format!("<{}>", list.to_string().replace(')', " )")),
        Some(other) => format!("<{other}>"),
        None => "null".to_owned(),
    };
    let text = |text: Option<&str>| text.map_or("null".to_owned(), |text| format!("<{text}>"));
    format!(
        "content={} onto={} conv={} proto={} rw={} irt={} lang={}",
        text(message.content_str()),
        tag(&message.ontology),
        tag(&message.conversation_id),
        text(message.protocol.as_deref()),
        tag(&message.reply_with),
        tag(&message.in_reply_to),
        tag(&message.language),
    )
}

/// What JADE refuses although it can be read.
fn better_reading(input: &str) -> Option<Message> {
    let inform = Message::new(Performative::Inform);
    Some(match input {
        // Older messages have expressions for content; its octets are clear.
        "(INFORM :content (a b (c)) :ontology o)" => inform.content("(a b (c))").ontology("o"),
        // A literal ends where it ends.
        "(INFORM :content \"c\":ontology o)" => inform.content("c").ontology("o"),
        "(INFORM :content \"c d\":ontology o)" => inform.content("c d").ontology("o"),
        // Its own encoder writes such protocols, though without quotes.
        "(INFORM :protocol \"fipa request\")" => inform.protocol("fipa request"),
        // Some encoders leave the mark of user-defined parameters out.
        "(INFORM :foo bar)" => inform.user_defined("foo", "bar"),
        // One agent is a set of one.
        "(INFORM :receiver (agent-identifier :name a@b))" => inform.to("a@b"),
        // No legal words, but readable ones.
        "(INFORM :reply-with -x)" => inform.reply_with("-x"),
        "(INFORM :ontology 1abc)" => inform.ontology("1abc"),
        _ => return None,
    })
}

#[test]
fn inputs_are_read_as_the_peer_reads_them_or_better() {
    let probes = probes();
    assert_eq!(probes.len(), 43);
    for (input, answer) in probes {
        if let Some(expected) = better_reading(&input) {
            assert_eq!(read(&input), expected, "{input}");
        } else if answer.starts_with("ERR") {
            let (offset, fault) = refused(&input);
            assert_eq!(fault, Fault::Malformed, "{input}");
            assert!(offset > 10, "{input}");
        } else {
            let message = match input.strip_suffix("trailing") {
                // Whoever knows where the message ends ignores what follows it.
                Some(message) => read(message),
                None => read(&input),
            };
            let seen = as_jade_prints(&message);
            assert!(
                answer.starts_with(&format!("OK  {seen} ")),
                "{input}: {seen}"
            );
        }
    }
}

#[test]
fn what_the_peer_prints_otherwise_is_read_as_it_reads_it() {
    let time = |text: &str| read(text).reply_by.unwrap();
    let zoned: FipaTime = "2031-02-03T04:05:06.789Z".parse().unwrap();
    assert_eq!(time("(INFORM :reply-by 20310203T040506789Z)"), zoned);
    // Local time, which was UTC where it was recorded.
    assert_eq!(
        time("(INFORM :reply-by 20310203T040506789)").unix_millis(),
        zoned.unix_millis()
    );
    let day: FipaTime = "+P1D".parse().unwrap();
    assert_eq!(time("(INFORM :reply-by +00000001T000000000)"), day);
    assert_eq!(time("(INFORM :reply-by +00000001T000000000Z)"), day);

    let message = read("(INFORM :X-foo \"a b\" :X-bar 5 :x-baz (1 2))");
    let list = Expression::List(vec!["1".into(), "2".into()]);
    let expected = Message::new(Performative::Inform)
        .user_defined("foo", "a b")
        .user_defined("bar", "5")
        .user_defined("baz", list);
    assert_eq!(message, expected);

    let message = read(
        "(INFORM :sender (agent-identifier :name \"a b@c\" :addresses (sequence http://h:1/acc) \
         :resolvers (sequence (agent-identifier :name r@c)) :X-s v))",
    );
    let sender = AgentId::new("a b@c")
        .address("http://h:1/acc")
        .resolver("r@c")
        .user_defined("s", "v");
    assert_eq!(message.sender, Some(sender));
    let reply_to = "(set (agent-identifier :name a@b) (agent-identifier :name c@d))";
    let message = read(format!("(INFORM :reply-to {reply_to})"));
    assert_eq!(message.reply_to, ["a@b".into(), "c@d".into()]);
}
