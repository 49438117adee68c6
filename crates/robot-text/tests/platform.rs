//! Agents of a small robot, on a simulated clock.

use std::net::SocketAddr;
use std::time::Duration;

use robot_text::{
    Counters, DeclareError, Message, Output, PLATFORM, Place, Platform, PlatformConfig, StreamId,
    Unanswered, UrgencyQueue, parse,
};

const START: Duration = Duration::ZERO;

fn at(port: u16) -> Place {
    Place::Datagram(SocketAddr::from(([10, 0, 0, 1], port)))
}

fn message(text: &str) -> Message {
    parse(text.as_bytes()).unwrap()
}

fn platform() -> Platform {
    Platform::new(PlatformConfig::default())
}

/// A platform on which these have spoken, each on the port of its place in the list.
fn with(names: &[&str]) -> Platform {
    let mut platform = platform();
    for (port, name) in (1..).zip(names) {
        platform.declare_at(name, at(port)).unwrap();
    }
    outputs(&mut platform);
    platform
}

fn receive(platform: &mut Platform, now: Duration, from: Place, text: &str) -> Vec<Output> {
    platform.received(now, from, message(text), |name| name.ends_with("@fleet"));
    outputs(platform)
}

fn outputs(platform: &mut Platform) -> Vec<Output> {
    std::iter::from_fn(|| platform.poll_output()).collect()
}

fn sent(to: Place, text: &str) -> Output {
    Output::Send {
        to,
        message: message(text),
    }
}

fn fleet(to: &str, text: &str) -> Output {
    Output::Fleet {
        to: to.to_owned(),
        message: message(text),
    }
}

#[test]
fn declared_agents_get_addresses_none_twice() {
    let mut platform = platform();
    let first = PlatformConfig::default().assigned;
    platform
        .declare_at(
            "C",
            Place::Datagram(SocketAddr::new(first.ip(), first.port() + 1)),
        )
        .unwrap();
    let a = platform.declare("A").unwrap();
    let b = platform.declare("B").unwrap();
    assert_eq!((a, b.port()), (first, first.port() + 2));
    assert_eq!(platform.get("A"), Some(Place::Datagram(a)));
    assert_eq!(platform.declare("A"), Err(DeclareError::Elsewhere));
    assert_eq!(
        platform.declare_at("A", at(1)),
        Err(DeclareError::Elsewhere)
    );
    assert_eq!(platform.declare_at("A", Place::Datagram(a)), Ok(()));
    assert_eq!(platform.declare("a b"), Err(DeclareError::Name));
    assert_eq!(platform.declare(PLATFORM), Err(DeclareError::Name));
    assert_eq!(platform.names().collect::<Vec<_>>(), ["A", "B", "C"]);
}

#[test]
fn the_first_message_declares_its_sender() {
    let mut platform = with(&["B"]);
    let action = "{O:A;D:B;A:x}";
    assert_eq!(
        receive(&mut platform, START, at(9), action),
        [Output::Declared("A".to_owned()), sent(at(1), action)]
    );
    assert_eq!(receive(&mut platform, START, at(8), action), []);
    assert_eq!(platform.counters().misplaced, 1);
    assert_eq!(platform.get("A"), Some(at(9)));
}

#[test]
fn nobody_speaks_in_the_name_of_the_fleet_or_of_the_platform() {
    let mut platform = with(&["B"]);
    for origin in ["x@fleet", PLATFORM] {
        let action = format!("{{O:{origin};D:B;A:x}}");
        assert_eq!(receive(&mut platform, START, at(9), &action), []);
    }
    assert_eq!(platform.counters().misplaced, 2);
}

#[test]
fn the_platform_answers_over_the_wire() {
    let mut platform = with(&["A", "B"]);
    for (asked, answered) in [
        ("DECLARE", "10.0.0.1 1"),
        ("DECLARE 10.0.0.1 1", "10.0.0.1 1"),
        (
            "DECLARE 10.0.0.1 2",
            "ERROR the name is declared at another place",
        ),
        (
            "DECLARE 10.0.0.1 77",
            "ERROR there is no agent at that address yet",
        ),
        ("GET B", "10.0.0.1 2"),
        ("GET C", "ERROR unknown name"),
        ("WHO", "ERROR unknown question"),
    ] {
        let question = format!("{{O:A;D:PLATFORM;X=4;Q:{asked}}}");
        let answer = format!("{{O:PLATFORM;D:A;X=4;R:{answered}}}");
        assert_eq!(
            receive(&mut platform, START, at(1), &question),
            [sent(at(1), &answer)]
        );
    }
}

#[test]
fn an_agent_joins_a_socket_that_exists() {
    let mut platform = with(&["A"]);
    let question = "{O:B;D:PLATFORM;Q:DECLARE 10.0.0.1 1}";
    assert_eq!(
        receive(&mut platform, START, at(9), question),
        [
            Output::Declared("B".to_owned()),
            sent(at(1), "{O:PLATFORM;D:B;R:10.0.0.1 1}"),
        ]
    );
    // Where nobody is, nobody is declared: it is where it speaks from.
    let question = "{O:C;D:PLATFORM;Q:DECLARE 10.0.0.1 5}";
    assert_eq!(
        receive(&mut platform, START, at(9), question),
        [
            Output::Declared("C".to_owned()),
            sent(
                at(9),
                "{O:PLATFORM;D:C;R:ERROR there is no agent at that address yet}"
            ),
        ]
    );
}

#[test]
fn an_answer_needs_its_question() {
    let mut platform = with(&["A", "B"]);
    let question = "{O:A;D:B;X=3;Q:x}";
    assert_eq!(
        receive(&mut platform, START, at(1), question),
        [sent(at(2), question)]
    );
    assert_eq!(receive(&mut platform, START, at(1), question), []);
    assert_eq!(
        receive(&mut platform, START, at(2), "{O:B;D:A;X=4;R:y}"),
        []
    );
    assert_eq!(receive(&mut platform, START, at(2), "{O:B;D:A;R:y}"), []);
    let answer = "{O:B;D:A;X=3;R:y}";
    assert_eq!(
        receive(&mut platform, START, at(2), answer),
        [sent(at(1), answer)]
    );
    assert_eq!(receive(&mut platform, START, at(2), answer), []);
    let expected = Counters {
        unasked: 3,
        repeated: 1,
        ..Counters::default()
    };
    assert_eq!(platform.counters(), expected);
}

#[test]
fn without_references_questions_are_answered_in_their_order() {
    let mut platform = with(&["A", "B"]);
    for text in ["{O:A;D:B;Q:x}", "{O:A;D:B;Q:y}"] {
        assert_eq!(
            receive(&mut platform, START, at(1), text),
            [sent(at(2), text)]
        );
    }
    for text in ["{O:B;D:A;R:x}", "{O:B;D:A;R:y}"] {
        assert_eq!(
            receive(&mut platform, START, at(2), text),
            [sent(at(1), text)]
        );
    }
    assert_eq!(receive(&mut platform, START, at(2), "{O:B;D:A;R:z}"), []);
}

#[test]
fn a_question_is_forgotten_when_nobody_answers() {
    let mut platform = with(&["A", "B"]);
    receive(&mut platform, START, at(1), "{O:A;D:B;X=3;Q:x}");
    let fleet_asks = message("{O:m@fleet;D:B;X=1;Q:x}");
    assert!(platform.send(START, fleet_asks.clone()));
    assert!(!platform.send(START, fleet_asks.clone()));
    outputs(&mut platform);
    assert_eq!(platform.poll_timeout(), Some(Duration::from_secs(5)));
    platform.handle_timeout(Duration::from_secs(5));
    let unanswered = Output::Unanswered {
        question: fleet_asks,
        reason: Unanswered::Silent,
    };
    assert_eq!(outputs(&mut platform), [unanswered]);
    assert_eq!(
        receive(&mut platform, START, at(2), "{O:B;D:A;X=3;R:y}"),
        []
    );
    assert_eq!(platform.poll_timeout(), None);
}

#[test]
fn the_fleet_asks_and_is_answered() {
    let mut platform = with(&["B"]);
    let reference = platform.free_reference("m@fleet", "B");
    assert!(platform.send(START, message("{O:m@fleet;D:B;X=1;Q:x}")));
    assert_eq!(reference, "1");
    assert_eq!(
        outputs(&mut platform),
        [sent(at(1), "{O:m@fleet;D:B;X=1;Q:x}")]
    );
    assert_eq!(platform.free_reference("m@fleet", "B"), "2");
    let answer = "{O:B;D:m@fleet;X=1;R:y}";
    assert_eq!(
        receive(&mut platform, START, at(1), answer),
        [fleet("m@fleet", answer)]
    );
}

#[test]
fn a_question_to_the_fleet_is_answered_with_an_error_when_nobody_does() {
    let mut platform = with(&["B"]);
    let question = "{O:B;D:m@fleet;X=1;Q:x}";
    assert_eq!(
        receive(&mut platform, START, at(1), question),
        [fleet("m@fleet", question)]
    );
    platform.handle_timeout(Duration::from_secs(5));
    let unanswered = Output::Unanswered {
        question: message(question),
        reason: Unanswered::Silent,
    };
    let told = sent(
        at(1),
        "{O:m@fleet;D:B;X=1;R:ERROR it gave no answer in time}",
    );
    assert_eq!(outputs(&mut platform), [told, unanswered]);
}

#[test]
fn an_unknown_receiver_is_told_to_who_asks() {
    let mut platform = with(&["A"]);
    assert_eq!(
        receive(&mut platform, START, at(1), "{O:A;D:Z;X=2;Q:x}"),
        [sent(at(1), "{O:PLATFORM;D:A;X=2;R:ERROR unknown name}")]
    );
    assert_eq!(receive(&mut platform, START, at(1), "{O:A;D:Z;A:x}"), []);
    assert_eq!(receive(&mut platform, START, at(7), "{D:Z;A:x}"), []);
    assert_eq!(platform.counters().unknown, 2);
    let action = "{O:A;D:m@fleet;A:x}";
    assert_eq!(
        receive(&mut platform, START, at(1), action),
        [fleet("m@fleet", action)]
    );
}

#[test]
fn a_status_goes_to_its_subscribers_and_nobody_else() {
    let mut platform = with(&["A", "B", "C"]);
    let status = "{O:A;S:PANNE}";
    assert_eq!(receive(&mut platform, START, at(1), status), []);
    receive(
        &mut platform,
        START,
        at(2),
        "{O:B;D:PLATFORM;A:SUBSCRIBE A}",
    );
    platform.subscribe("m@fleet", "A");
    assert_eq!(
        receive(&mut platform, START, at(1), status),
        [sent(at(2), status), fleet("m@fleet", status)]
    );
    assert_eq!(receive(&mut platform, START, at(3), "{O:C;S:x}"), []);
    receive(
        &mut platform,
        START,
        at(2),
        "{O:B;D:PLATFORM;A:UNSUBSCRIBE A}",
    );
    platform.unsubscribe("m@fleet", "A");
    assert_eq!(receive(&mut platform, START, at(1), status), []);
}

#[test]
fn an_agent_is_gone_with_its_stream_and_30_s_after_its_last_datagram() {
    let mut platform = platform();
    let stream = StreamId(1);
    receive(
        &mut platform,
        START,
        Place::Stream(stream),
        "{O:S;D:PLATFORM;Q:GET S}",
    );
    receive(&mut platform, START, at(1), "{O:U;S:x}");
    platform.declare_at("K", at(2)).unwrap();
    let question = message("{O:m@fleet;D:S;X=1;Q:x}");
    assert!(platform.send(START, question.clone()));
    outputs(&mut platform);

    platform.stream_closed(stream);
    let unanswered = Output::Unanswered {
        question,
        reason: Unanswered::Gone,
    };
    assert_eq!(
        outputs(&mut platform),
        [unanswered, Output::Gone("S".to_owned())]
    );

    let later = Duration::from_secs(20);
    receive(&mut platform, later, at(1), "{O:U;S:x}");
    let expiry = later + Duration::from_secs(30);
    assert_eq!(platform.poll_timeout(), Some(expiry));
    platform.handle_timeout(expiry - Duration::from_millis(1));
    assert_eq!(outputs(&mut platform), []);
    platform.handle_timeout(expiry);
    assert_eq!(outputs(&mut platform), [Output::Gone("U".to_owned())]);
    assert_eq!(platform.names().collect::<Vec<_>>(), ["K"]);
}

#[test]
fn there_is_an_end_to_agents_and_questions() {
    let mut platform = Platform::new(PlatformConfig {
        capacity: 2,
        ..PlatformConfig::default()
    });
    for (port, name) in (1..).zip(["A", "B", "C"]) {
        receive(&mut platform, START, at(port), &format!("{{O:{name};S:x}}"));
    }
    assert_eq!(platform.names().collect::<Vec<_>>(), ["A", "B"]);
    for reference in 1..=3 {
        let question = format!("{{O:A;D:B;X={reference};Q:x}}");
        receive(&mut platform, START, at(1), &question);
    }
    assert_eq!(platform.counters().overfull, 1);
}

#[test]
fn the_most_urgent_message_leaves_the_queue_first() {
    let mut queue = UrgencyQueue::new(3);
    assert_eq!(queue.push(0, "a"), None);
    assert_eq!(queue.push(5, "b"), None);
    assert_eq!(queue.push(0, "c"), None);
    assert_eq!(queue.push(5, "d"), Some("c"));
    assert_eq!(queue.push(0, "e"), Some("e"));
    let left: Vec<_> = std::iter::from_fn(|| queue.pop()).collect();
    assert_eq!(left, ["b", "d", "a"]);
    assert_eq!((queue.dropped(), queue.is_empty()), (2, true));
}
