//! Agents of a text platform in the fleet, on a simulated clock.

use std::net::SocketAddr;
use std::time::Duration;

use fipa_acl::{Message, Performative, Text};
use fipa_gateway::{TextGateway, TextOutput};
use robot_text::{Place, PlatformConfig, StreamId, parse};

const START: Duration = Duration::ZERO;
const DRIVE: &str = "drive@robot1";

fn place() -> Place {
    Place::Datagram(SocketAddr::from(([127, 0, 0, 1], 7)))
}

/// A gateway with the agent `drive`.
fn gateway() -> TextGateway {
    let mut gateway = TextGateway::new("robot1", PlatformConfig::default());
    receive(&mut gateway, "{O:drive;S:up}");
    gateway
}

fn receive(gateway: &mut TextGateway, text: &str) -> Vec<TextOutput> {
    let message = parse(text.as_bytes()).unwrap();
    gateway.received(START, place(), message, |name| name.ends_with("@robot2"));
    outputs(gateway)
}

fn deliver(gateway: &mut TextGateway, message: &Message) -> Vec<TextOutput> {
    gateway.deliver(START, DRIVE, message);
    outputs(gateway)
}

fn outputs(gateway: &mut TextGateway) -> Vec<TextOutput> {
    std::iter::from_fn(|| gateway.poll_output()).collect()
}

fn write(text: &str, ticket: Option<u64>) -> TextOutput {
    TextOutput::Write {
        to: place(),
        message: parse(text.as_bytes()).unwrap(),
        ticket,
    }
}

fn message(performative: Performative, content: &str) -> Message {
    Message::new(performative)
        .from_agent("m@robot2")
        .to(DRIVE)
        .content(content.as_bytes().to_vec())
        .conversation_id("c-1")
        .reply_with("r-1")
        .protocol("fipa-request")
}

/// What the drive answers to `message`.
fn answer(message: &Message, performative: Performative, content: &str) -> TextOutput {
    let mut answer = message.reply(performative).from_agent(DRIVE);
    if !content.is_empty() {
        answer = answer.content(content.as_bytes().to_vec());
    }
    TextOutput::Send(Box::new(answer))
}

#[test]
fn an_agent_is_registered_when_it_speaks_and_deregistered_when_it_is_silent() {
    let mut gateway = TextGateway::new("robot1", PlatformConfig::default());
    let registered = receive(&mut gateway, "{O:drive;S:up}");
    assert_eq!(registered, [TextOutput::Register(Text::from(DRIVE))]);
    assert_eq!(gateway.poll_timeout(), Some(Duration::from_secs(30)));
    gateway.handle_timeout(Duration::from_secs(30));
    let deregistered = [TextOutput::Deregister(Text::from(DRIVE))];
    assert_eq!(outputs(&mut gateway), deregistered);
}

#[test]
fn a_request_is_an_action_and_done_when_it_is_written() {
    let mut gateway = gateway();
    let request = message(Performative::Request, "go 1");
    let action = write("{O:m@robot2;D:drive;A:go 1}", Some(1));
    assert_eq!(
        deliver(&mut gateway, &request),
        [answer(&request, Performative::Agree, ""), action]
    );
    gateway.written(1, Ok(()));
    let sent = answer(&request, Performative::Inform, "sent");
    assert_eq!(outputs(&mut gateway), [sent]);

    deliver(&mut gateway, &request);
    gateway.written(2, Err("the line is cut"));
    let failed = answer(&request, Performative::Failure, "the line is cut");
    assert_eq!(outputs(&mut gateway), [failed]);
    gateway.written(2, Ok(()));
    assert_eq!(outputs(&mut gateway), []);
}

#[test]
fn a_query_is_a_question_and_its_answer_an_inform() {
    let mut gateway = gateway();
    let query = message(Performative::QueryRef, "where");
    let question = write("{O:m@robot2;D:drive;X=1;Q:where}", None);
    assert_eq!(deliver(&mut gateway, &query), [question]);
    let second = message(Performative::QueryIf, "ready").conversation_id("c-2");
    let question = write("{O:m@robot2;D:drive;X=2;Q:ready}", None);
    assert_eq!(deliver(&mut gateway, &second), [question]);
    assert_eq!(
        receive(&mut gateway, "{O:drive;D:m@robot2;X=2;R:yes}"),
        [answer(&second, Performative::Inform, "yes")]
    );
    assert_eq!(
        receive(&mut gateway, "{O:drive;D:m@robot2;X=1;R:3 4}"),
        [answer(&query, Performative::Inform, "3 4")]
    );
    assert_eq!(receive(&mut gateway, "{O:drive;D:m@robot2;X=1;R:3 4}"), []);
}

#[test]
fn silence_and_loss_are_failures() {
    let mut gateway = gateway();
    let query = message(Performative::QueryRef, "where");
    deliver(&mut gateway, &query);
    gateway.handle_timeout(Duration::from_secs(5));
    let failed = answer(&query, Performative::Failure, "it gave no answer in time");
    assert_eq!(outputs(&mut gateway), [failed]);

    let stream = StreamId(3);
    let hello = parse(b"{O:arm;S:up}").unwrap();
    gateway.received(START, Place::Stream(stream), hello, |_| false);
    outputs(&mut gateway);
    gateway.deliver(START, "arm@robot1", &query);
    // Its action is not on the line yet.
    let request = message(Performative::Request, "go 1");
    gateway.deliver(START, "arm@robot1", &request);
    outputs(&mut gateway);
    gateway.stream_closed(stream);
    let failed = |message: &Message, reason: &str| {
        let failure = message.reply(Performative::Failure);
        let failure = failure
            .from_agent("arm@robot1")
            .content(reason.as_bytes().to_vec());
        TextOutput::Send(Box::new(failure))
    };
    assert_eq!(
        outputs(&mut gateway),
        [
            failed(&query, "it is gone"),
            failed(&request, "the agent is gone"),
            TextOutput::Deregister(Text::from("arm@robot1")),
        ]
    );
    gateway.written(1, Ok(()));
    assert_eq!(outputs(&mut gateway), []);
}

#[test]
fn a_configured_agent_stays_in_the_fleet_and_fails_while_it_is_nowhere() {
    let mut gateway = TextGateway::new("robot1", PlatformConfig::default());
    gateway.configure("drive");
    gateway.configure("drive");
    let registered = [TextOutput::Register(Text::from(DRIVE))];
    assert_eq!(outputs(&mut gateway), registered);
    let request = message(Performative::Request, "go 1");
    let failed = answer(&request, Performative::Failure, "the agent is gone");
    assert_eq!(
        deliver(&mut gateway, &request),
        std::slice::from_ref(&failed)
    );

    let stream = StreamId(3);
    gateway.declare_at("drive", Place::Stream(stream)).unwrap();
    let action = TextOutput::Write {
        to: Place::Stream(stream),
        message: parse(b"{O:m@robot2;D:drive;A:go 1}").unwrap(),
        ticket: Some(1),
    };
    let agreed = answer(&request, Performative::Agree, "");
    assert_eq!(deliver(&mut gateway, &request), [agreed, action]);
    gateway.stream_closed(stream);
    assert_eq!(outputs(&mut gateway), [failed]);
    // At a datagram's address it stays however long it is silent.
    gateway.declare_at("drive", place()).unwrap();
    assert_eq!(gateway.poll_timeout(), None);
    assert_eq!(outputs(&mut gateway), []);
    let elsewhere = gateway.declare_at("drive", Place::Stream(stream));
    assert_eq!(elsewhere, Err(robot_text::DeclareError::Elsewhere));
}

#[test]
fn a_status_informs_every_subscription_until_it_is_cancelled() {
    let mut gateway = gateway();
    let first = message(Performative::Subscribe, "");
    let second = message(Performative::Subscribe, "").conversation_id("c-2");
    for subscribe in [&first, &second] {
        let agreed = answer(subscribe, Performative::Agree, "");
        assert_eq!(deliver(&mut gateway, subscribe), [agreed]);
    }
    let informed = |subscribe| answer(subscribe, Performative::Inform, "hot");
    assert_eq!(
        receive(&mut gateway, "{O:drive;S:hot}"),
        [informed(&first), informed(&second)]
    );
    let cancel = message(Performative::Cancel, "");
    let cancelled = answer(&cancel, Performative::Inform, "cancelled");
    assert_eq!(deliver(&mut gateway, &cancel), [cancelled]);
    assert_eq!(
        receive(&mut gateway, "{O:drive;S:hot}"),
        [informed(&second)]
    );
    gateway.agent_gone("m@robot2");
    assert_eq!(receive(&mut gateway, "{O:drive;S:hot}"), []);
    let nothing = answer(&cancel, Performative::Failure, "nothing to cancel");
    assert_eq!(deliver(&mut gateway, &cancel), [nothing]);
}

#[test]
fn a_cancelled_question_is_forgotten() {
    let mut gateway = gateway();
    deliver(&mut gateway, &message(Performative::QueryRef, "where"));
    let cancel = message(Performative::Cancel, "");
    let cancelled = answer(&cancel, Performative::Inform, "cancelled");
    assert_eq!(deliver(&mut gateway, &cancel), [cancelled]);
    assert_eq!(receive(&mut gateway, "{O:drive;D:m@robot2;X=1;R:3}"), []);
    gateway.handle_timeout(Duration::from_secs(5));
    assert_eq!(outputs(&mut gateway), []);
}

#[test]
fn what_the_format_cannot_say_is_not_understood() {
    let mut gateway = gateway();
    for content in ["a;b", "{", "}", "é", " x", &"x".repeat(1000)] {
        for performative in [
            Performative::Request,
            Performative::QueryRef,
            Performative::Inform,
        ] {
            let message = message(performative, content);
            let [TextOutput::Send(reply)] = &deliver(&mut gateway, &message)[..] else {
                panic!("{content}");
            };
            assert_eq!(reply.performative, Performative::NotUnderstood);
            let reason = reply.content_str().unwrap();
            assert!(
                reason.starts_with("the text format has printable ASCII"),
                "{reason}"
            );
        }
    }
    let propose = message(Performative::Propose, "x");
    let [TextOutput::Send(reply)] = &deliver(&mut gateway, &propose)[..] else {
        panic!("no reply");
    };
    assert_eq!(reply.performative, Performative::NotUnderstood);
    // But nobody answers an answer.
    for performative in [
        Performative::NotUnderstood,
        Performative::Failure,
        Performative::Refuse,
    ] {
        assert_eq!(deliver(&mut gateway, &message(performative, "é")), []);
    }
}

#[test]
fn an_agent_that_is_not_there_fails_or_refuses() {
    let mut gateway = gateway();
    let query = message(Performative::QueryRef, "where");
    gateway.deliver(START, "arm@robot1", &query);
    let failed = query
        .reply(Performative::Failure)
        .from_agent("arm@robot1")
        .content("the agent is gone");
    assert_eq!(outputs(&mut gateway), [TextOutput::Send(Box::new(failed))]);
}

#[test]
fn an_action_of_an_agent_is_a_request() {
    let mut gateway = gateway();
    let request = Message::new(Performative::Request)
        .from_agent(DRIVE)
        .to("m@robot2")
        .content("stop");
    assert_eq!(
        receive(&mut gateway, "{O:drive;D:m@robot2;A:stop}"),
        [TextOutput::Send(Box::new(request))]
    );
}

#[test]
fn a_question_of_an_agent_is_a_query_and_what_comes_back_its_answer() {
    for (performative, content, answer) in [
        (Performative::Inform, "9", "9"),
        (
            Performative::Failure,
            "no map; {x}",
            "ERROR failure no map   x",
        ),
        (Performative::Refuse, "", "ERROR refuse"),
        (
            Performative::Inform,
            "é",
            "ERROR the answer cannot be written",
        ),
    ] {
        let mut gateway = gateway();
        let asked = receive(&mut gateway, "{O:drive;D:m@robot2;X=5;Q:where}");
        let [TextOutput::Send(query)] = &asked[..] else {
            panic!("{asked:?}");
        };
        assert_eq!(query.performative, Performative::QueryRef);
        assert_eq!(query.reply_with, Some("5".into()));
        assert_eq!(
            deliver(
                &mut gateway,
                &query.reply(Performative::Agree).from_agent("m@robot2")
            ),
            []
        );
        let reply = query
            .reply(performative)
            .from_agent("m@robot2")
            .content(content.as_bytes().to_vec());
        let text = format!("{{O:m@robot2;D:drive;X=5;R:{answer}}}");
        let outputs = deliver(&mut gateway, &reply);
        assert!(outputs.contains(&write(&text, None)), "{outputs:?}");
        // The question is answered: what comes now is something to do.
        if content == "9" {
            let action = write("{O:m@robot2;D:drive;A:9}", None);
            assert_eq!(deliver(&mut gateway, &reply), [action]);
        }
    }
}

#[test]
fn an_answer_without_conversation_is_known_by_its_reference() {
    let mut gateway = gateway();
    receive(&mut gateway, "{O:drive;D:m@robot2;X=5;Q:where}");
    let mut reply = message(Performative::Inform, "9").in_reply_to("5");
    reply.conversation_id = None;
    let answer = write("{O:m@robot2;D:drive;X=5;R:9}", None);
    assert_eq!(deliver(&mut gateway, &reply), [answer]);
}

#[test]
fn a_question_that_does_not_reach_the_fleet_is_answered_with_the_reason() {
    let mut gateway = gateway();
    let asked = receive(&mut gateway, "{O:drive;D:m@robot2;X=5;Q:where}");
    let [TextOutput::Send(query)] = &asked[..] else {
        panic!("{asked:?}");
    };
    gateway.undelivered(START, query, "no agent of this name is known");
    let text = "{O:m@robot2;D:drive;X=5;R:ERROR no agent of this name is known}";
    assert_eq!(outputs(&mut gateway), [write(text, None)]);
    gateway.undelivered(START, query, "again");
    assert_eq!(outputs(&mut gateway), []);
}

#[test]
fn a_question_that_the_fleet_leaves_open_is_answered_with_an_error() {
    let mut gateway = gateway();
    receive(&mut gateway, "{O:drive;D:m@robot2;X=5;Q:where}");
    gateway.handle_timeout(Duration::from_secs(5));
    let text = "{O:m@robot2;D:drive;X=5;R:ERROR it gave no answer in time}";
    assert_eq!(outputs(&mut gateway), [write(text, None)]);
    let late = message(Performative::Failure, "x").in_reply_to("5");
    assert_eq!(deliver(&mut gateway, &late), []);
}
