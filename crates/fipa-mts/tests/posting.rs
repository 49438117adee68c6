//! Letters to services of other makes: in their dialect, each on a connection of its own.
mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, Letter, Message, Performative, Representation, Text};
use fipa_codec::{Limits, Output as Encoded, decode_letter, decode_payload, encode_message};
use fipa_directory::{InstanceId, MESSAGE_TRANSPORT, Now};
use fipa_link::Outcome;
use fipa_mts::{
    Announced, Config, ConnId, Connected, Ended, Machine, Mts, Output, Registration, Submission,
};
use fipa_sim::{Habit, Network, NodeId, Sim, Then};

use support::{entry, millis, outcome, reason, recorded, secs};

const JADE_BRIDGE: &str = "JadeProxyAgent";

/// A daemon with the agent `a`, and the agent `b` of a robot of another make.
fn here_and_robot(sim: &mut Sim) -> (NodeId, NodeId) {
    let (here, robot) = (sim.daemon("here"), sim.robot("robot"));
    sim.register(here, "a");
    sim.announce(
        robot,
        &entry("b", &[("tcp://robot:9999", MESSAGE_TRANSPORT)]),
    );
    (here, robot)
}

fn letters(sim: &mut Sim, robot: NodeId) -> Vec<Letter> {
    let written = sim.robot_letters(robot).into_iter();
    written
        .map(|octets| decode_letter(&octets, &Limits::default()).unwrap())
        .collect()
}

fn contents(sim: &mut Sim, robot: NodeId) -> Vec<String> {
    let payloads = letters(sim, robot).into_iter().map(|letter| letter.payload);
    payloads
        .map(|payload| String::from_utf8(payload.to_vec()).unwrap())
        .collect()
}

fn large(octets: usize) -> String {
    "x".repeat(octets)
}

#[test]
fn a_letter_to_a_robot_of_another_make_is_sent_and_nothing_more_is_claimed() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let ticket = sim.send(here, "a", &["b"], "hello");
    assert!(sim.run_until_quiet(secs(1)));
    let told = &sim.outcomes(here, ticket)[0];
    assert_eq!((told.outcome, told.reason.as_str()), (Outcome::Sent, ""));
    assert_eq!(told.via.as_deref(), Some("tcp://robot:9999"));
    let letter = &letters(&mut sim, robot)[0];
    assert_eq!(letter.payload, "hello");
    assert_eq!(letter.envelope.intended_receiver(), [AgentId::new("b")]);
    let stamps: Vec<_> = letter.envelope.stamps().map(|s| s.by.as_str()).collect();
    assert_eq!(stamps, ["here"]);
    // fipa_services delivers to those whom an intended-receiver names.
    assert!(!letter.envelope.overlays[0].intended_receiver.is_empty());
    assert_eq!(sim.streams(here, robot), 0);
}

#[test]
fn a_letter_passed_on_between_robots_bears_our_overlay_behind_theirs() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    sim.announce(
        robot,
        &entry("agent-b", &[("tcp://robot:9999", MESSAGE_TRANSPORT)]),
    );
    let octets = recorded("mts/sent_03_to_agent-b.bin");
    sim.robot_writes(robot, sim.address(here), octets.clone(), Then::Ends);
    assert!(sim.run_until_quiet(secs(1)));
    let passed_on = sim.robot_letters(robot).remove(0);
    let base = octets.iter().position(|octet| *octet == 0xfe).unwrap();
    let behind = passed_on.len() - (octets.len() - base);
    assert_eq!(passed_on[..base], octets[..base]);
    assert_eq!(passed_on[base], 0xfd);
    assert_eq!(passed_on[behind..], octets[base..]);
    let letter = &letters(&mut sim, robot)[0];
    let stamps: Vec<_> = letter.envelope.stamps().map(|s| s.by.as_str()).collect();
    assert_eq!(stamps.first(), Some(&"mts-0"));
    assert_eq!(stamps.last(), Some(&"here"));
}

#[test]
fn parameters_that_make_fipa_services_reject_an_envelope_are_left_out_for_it_only() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let there = sim.daemon("there");
    sim.register(there, "c");
    sim.add_peer(here, sim.address(there));
    sim.run_for(millis(100));
    let to = vec![AgentId::new("b"), AgentId::new("c")];
    let mut letter = sim.letter("a", to, Bytes::from("urgent"));
    let priority = (Text::from("Priority"), Text::from("2"));
    letter.envelope.base.user_defined.push(priority.clone());
    sim.submit(here, letter, secs(10));
    assert!(sim.run_until_quiet(secs(1)));
    let theirs = &letters(&mut sim, robot)[0];
    assert_eq!(theirs.envelope.flattened().user_defined, []);
    assert_eq!(theirs.payload, "urgent");
    let ours = &sim.collected(there).mail["c"][0];
    assert_eq!(ours.envelope.flattened().user_defined, [priority]);
}

#[test]
fn letters_to_one_receiver_are_written_one_after_the_other_in_their_order() {
    let mut sim = Sim::new(3);
    sim.set_network(Network {
        jitter: millis(20),
        split: true,
        ..Network::default()
    });
    let (here, robot) = here_and_robot(&mut sim);
    for n in 0..40 {
        sim.send(here, "a", &["b"], &n.to_string());
        sim.run_for(millis(2));
    }
    assert!(sim.run_until_quiet(secs(9)));
    let expected: Vec<String> = (0..40).map(|n| n.to_string()).collect();
    assert_eq!(contents(&mut sim, robot), expected);
}

#[test]
fn a_place_that_refuses_is_tried_twice_and_then_the_next_one() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let spare = sim.robot("spare");
    let locations = [
        ("udt://robot:9998", MESSAGE_TRANSPORT),
        ("tcp://robot:9999", MESSAGE_TRANSPORT),
        ("tcp://spare:9999", MESSAGE_TRANSPORT),
        ("", ""),
    ];
    sim.announce(robot, &entry("b", &locations));
    sim.crash(robot);
    sim.forget(here);
    let ticket = sim.send(here, "a", &["b"], "hello");
    assert!(sim.run_until_quiet(secs(2)));
    assert_eq!(outcome(&sim, here, ticket), Outcome::Sent);
    let via = sim.outcomes(here, ticket)[0].via.clone();
    assert_eq!(via.as_deref(), Some("tcp://spare:9999"));
    let dials = sim.collected(here).dials.iter();
    let dialled: Vec<_> = dials.map(|(_, to)| to[0].to_string()).collect();
    let expected = ["tcp://robot:9999", "tcp://robot:9999", "tcp://spare:9999"];
    assert_eq!(dialled, expected);
    assert_eq!(contents(&mut sim, spare), ["hello"]);
}

#[test]
fn when_every_place_fails_the_outcome_says_why_of_each() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let locations = [
        ("tcp://nowhere:1", MESSAGE_TRANSPORT),
        ("quic://robot:80", "fipa.quic"),
        ("tcp://robot:9999", "fipa.tcp"),
        ("tcp://elsewhere:2", JADE_BRIDGE),
    ];
    sim.announce(robot, &entry("b", &locations));
    let mut letter = sim.letter("a", vec![AgentId::new("b")], Bytes::new());
    letter.payload = message(&Representation::BitEfficient, "hi");
    let ticket = sim.submit(here, letter, secs(10));
    assert!(sim.run_until_quiet(secs(1)));
    assert_eq!(outcome(&sim, here, ticket), Outcome::Timeout);
    let reason = reason(&sim, here, ticket);
    let parts = [
        "quic://robot:80: \"fipa.quic\" is not spoken here",
        "tcp://robot:9999: \"fipa.tcp\" is not spoken here",
        "tcp://nowhere:1: connection refused",
        "tcp://elsewhere:2: connection refused",
    ];
    assert_eq!(reason, parts.join("; "));
}

#[test]
fn an_agent_without_a_place_that_is_understood_is_refused_at_once() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    for locations in [&[("tcp://robot:9999", "fipa.tcp")][..], &[("", "")], &[]] {
        sim.announce(robot, &entry("b", locations));
        let ticket = sim.send(here, "a", &["b"], "");
        assert_eq!(outcome(&sim, here, ticket), Outcome::Refused);
        assert!(!reason(&sim, here, ticket).is_empty());
    }
    assert_eq!(sim.robot_accepted(robot), 0);
}

#[test]
fn a_stalled_robot_delays_nobody_else_and_gets_no_half_letter_for_a_whole_one() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let other = sim.robot("other");
    sim.announce(
        other,
        &entry("c", &[("tcp://other:9999", MESSAGE_TRANSPORT)]),
    );
    for n in 0..10 {
        let name = format!("b{n}");
        sim.announce(
            robot,
            &entry(&name, &[("tcp://robot:9999", MESSAGE_TRANSPORT)]),
        );
    }
    sim.set_habit(robot, Habit::Stalls);
    let begun = sim.now().mono;
    let stalled: Vec<u64> = (0..10)
        .flat_map(|n| [format!("b{n}"), "b".to_owned()])
        .map(|to| sim.send(here, "a", &[&to], &large(200_000)))
        .collect();
    let fine: Vec<u64> = (0..50).map(|_| sim.send(here, "a", &["c"], "x")).collect();
    sim.run_for(secs(1));
    for ticket in fine {
        assert_eq!(outcome(&sim, here, ticket), Outcome::Sent);
        assert!(sim.collected(here).outcomes[&ticket].at < begun + millis(500));
    }
    // A few connections are all that the robot costs.
    assert_eq!(sim.robot_accepted(robot), 4);
    sim.run_for(secs(10));
    for ticket in stalled {
        assert_eq!(outcome(&sim, here, ticket), Outcome::Timeout);
        assert_eq!(sim.collected(here).outcomes[&ticket].at, begun + secs(10));
    }
    sim.set_habit(robot, Habit::Reads);
    sim.run_for(secs(5));
    assert_eq!(sim.robot_letters(robot), [] as [Bytes; 0]);
    assert_eq!(sim.mts(here).letters_under_way(), 0);
    let after = sim.send(here, "a", &["b"], "after");
    assert!(sim.run_until_quiet(secs(1)));
    assert_eq!(outcome(&sim, here, after), Outcome::Sent);
}

#[test]
fn a_robot_that_reads_late_gets_a_large_letter_whole() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    sim.set_habit(robot, Habit::Stalls);
    let ticket = sim.send(here, "a", &["b"], &large(500_000));
    sim.run_for(secs(5));
    assert!(sim.told(here, ticket).is_none());
    sim.set_habit(robot, Habit::Reads);
    assert!(sim.run_until_quiet(secs(1)));
    assert_eq!(outcome(&sim, here, ticket), Outcome::Sent);
    assert_eq!(contents(&mut sim, robot), [large(500_000)]);
}

#[test]
fn a_connection_that_breaks_in_a_letter_is_made_anew_once() {
    let mut sim = Sim::new(1);
    sim.set_network(Network {
        octets_per_second: Some(1_000_000),
        ..Network::default()
    });
    let (here, robot) = here_and_robot(&mut sim);
    sim.set_habit(robot, Habit::Breaks(100_000));
    let once = sim.send(here, "a", &["b"], &large(500_000));
    sim.run_for(millis(200));
    assert_eq!(sim.robot_accepted(robot), 2);
    sim.set_habit(robot, Habit::Reads);
    assert!(sim.run_until_quiet(secs(5)));
    assert_eq!(outcome(&sim, here, once), Outcome::Sent);
    assert_eq!(contents(&mut sim, robot), [large(500_000)]);

    sim.set_habit(robot, Habit::Breaks(100_000));
    let never = sim.send(here, "a", &["b"], &large(500_000));
    assert!(sim.run_until_quiet(secs(5)));
    assert_eq!(outcome(&sim, here, never), Outcome::Timeout);
    let reason = reason(&sim, here, never);
    assert_eq!(reason, "tcp://robot:9999: connection reset by peer");
    assert_eq!(sim.robot_accepted(robot), 4);
}

/// A service that has written a letter to an agent of another make whole; what ended its
/// connection, as `ended` says.
fn after_the_last_octet(ended: Ended<'_>) -> (Outcome, String, bool) {
    let now = Now::default();
    let mut mts = Mts::new(Config::new(InstanceId::from_bytes([1; 16]), "here"));
    mts.register(now, 1, Registration::new("a"));
    mts.neighbour_found(now, entry("b", &[("tcp://robot:9999", MESSAGE_TRANSPORT)]));
    let letter = Sim::new(1).letter("a", vec![AgentId::new("b")], Bytes::from("x"));
    mts.submit(now, Submission::new(7, letter, secs(10)));
    let mut dials = Vec::new();
    let mut told = None;
    let mut done = false;
    while let Some(output) = mts.poll_output() {
        match output {
            Output::Dial {
                dial, addresses, ..
            } => {
                dials.push(addresses.clone());
                let conn = ConnId(dials.len() as u64);
                let connected = Connected {
                    conn,
                    dialled: Some((dial, addresses[0].clone())),
                    control: false,
                    same_host: false,
                    remote: Text::default(),
                    identity: None,
                    lanes: false,
                };
                mts.connected(now, connected);
            }
            Output::Finish(conn) if !std::mem::replace(&mut done, true) => {
                while mts.poll_transmit(now, conn).is_some() {}
                mts.closed(now, conn, ended);
            }
            Output::Outcome { outcomes, .. } => told = outcomes.into_iter().next(),
            _ => {}
        }
    }
    let (outcome, reason) = match told {
        Some(told) => (told.outcome, told.reason.to_string()),
        None => (Outcome::Unknown, String::new()),
    };
    (outcome, reason, dials.len() > 1)
}

#[test]
fn a_letter_of_which_every_octet_was_taken_is_never_written_again() {
    let ended = |orderly, all_written| Ended {
        reason: "reset",
        orderly,
        all_written,
    };
    let (outcome, _, again) = after_the_last_octet(ended(true, true));
    assert_eq!((outcome, again), (Outcome::Sent, false));
    let (outcome, reason, again) = after_the_last_octet(ended(false, true));
    assert_eq!((outcome, again), (Outcome::Timeout, false));
    assert!(
        reason.contains("nobody knows whether it arrived"),
        "{reason}"
    );
    for orderly in [true, false] {
        let (_, _, again) = after_the_last_octet(ended(orderly, false));
        assert!(again);
    }
}

fn message(representation: &Representation, content: &'static str) -> Bytes {
    let message = Message::new(Performative::Request)
        .from_agent("a")
        .to("b")
        .content(content);
    let mut payload = Encoded::new();
    encode_message(representation, &message, &mut payload).unwrap();
    payload.take_bytes()
}

#[test]
fn the_bridge_to_jade_gets_xml_around_a_message_in_string_form_with_where_to_answer() {
    for representation in [Representation::BitEfficient, Representation::String] {
        let mut sim = Sim::new(1);
        let endpoints = ["tcp://127.0.0.1:4100", "tcp://here:4100"];
        let here = sim.daemon_with("here", |config| {
            config.endpoints = endpoints.iter().map(|at| at.parse().unwrap()).collect();
        });
        let robot = sim.robot("robot");
        sim.announce(robot, &entry("b", &[("tcp://robot:9999", JADE_BRIDGE)]));
        let payload = message(&representation, "gr\u{fc}\u{df}");
        let mut letter = sim.letter("a", vec![AgentId::new("b")], payload.clone());
        letter.envelope.base.acl_representation = Some(representation.clone());
        let ticket = sim.submit(here, letter, secs(10));
        assert!(sim.run_until_quiet(secs(1)));
        assert_eq!(outcome(&sim, here, ticket), Outcome::Sent);
        assert!(sim.robot_letters(robot)[0].starts_with(b"<?xml"));
        let written = &letters(&mut sim, robot)[0];
        let envelope = &written.envelope;
        assert_eq!(envelope.acl_representation(), Some(&Representation::String));
        assert_eq!(
            envelope.payload_length(),
            Some(written.payload.len() as u64)
        );
        let from = AgentId::new("a").address("tcp://here:4100");
        assert_eq!(envelope.from(), Some(&from));
        let text = std::str::from_utf8(&written.payload).unwrap();
        assert!(
            text.contains(":content \"Z3LDvMOf\" :X-JADE-Encoding Base64"),
            "{text}"
        );
        let read = decode_payload(envelope, &written.payload, &Limits::default()).unwrap();
        assert_eq!(read.content_str(), Some("gr\u{fc}\u{df}"));
    }
}

#[test]
fn what_the_bridge_to_jade_cannot_be_told_is_refused_without_a_connection() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    sim.announce(robot, &entry("b", &[("tcp://robot:9999", JADE_BRIDGE)]));
    let ticket = sim.send(here, "a", &["b"], "no message");
    assert_eq!(outcome(&sim, here, ticket), Outcome::Refused);
    let reason = reason(&sim, here, ticket);
    assert!(
        reason.contains("cannot be put into string form"),
        "{reason}"
    );
    assert_eq!(sim.robot_accepted(robot), 0);
}

#[test]
fn a_robot_that_is_not_reached_is_asked_for_once_and_gone_with_its_letters_when_it_is() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    // The host is away: every dial takes three seconds.
    sim.isolate(robot);
    let begun = sim.now().mono;
    let tickets: Vec<u64> = (0..5).map(|_| sim.send(here, "a", &["b"], "")).collect();
    sim.run_for(millis(4500));
    let asked = sim.collected(here).verified.clone();
    assert_eq!(asked, [Announced::Agent(Text::from("b"))]);
    for ticket in tickets {
        assert_eq!(outcome(&sim, here, ticket), Outcome::Timeout);
        let reason = reason(&sim, here, ticket);
        assert!(reason.starts_with("b is gone"), "{reason}");
        let told = sim.collected(here).outcomes[&ticket].at - begun;
        assert!(told >= secs(4) && told < millis(4010));
    }
    assert!(sim.directory(here).find("b").is_none());
    assert_eq!(sim.mts(here).letters_under_way(), 0);
}

/// Sends to `b` at the robot's address, of which nothing else is known.
fn send_to_address(sim: &mut Sim, here: NodeId, content: &'static str) -> u64 {
    let receiver = AgentId::new("stranger").address("tcp://robot:9999");
    let letter = sim.letter("a", vec![receiver], Bytes::from(content));
    sim.submit(here, letter, secs(10))
}

#[test]
fn an_address_that_nobody_knows_is_greeted_for_two_seconds_and_then_gets_letters() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let begun = sim.now().mono;
    let tickets = [
        send_to_address(&mut sim, here, "first"),
        send_to_address(&mut sim, here, "second"),
    ];
    assert!(sim.run_until_quiet(secs(5)));
    for ticket in tickets {
        assert_eq!(outcome(&sim, here, ticket), Outcome::Sent);
        let at = sim.collected(here).outcomes[&ticket].at;
        assert!(at > begun + secs(2) && at < begun + millis(2100));
    }
    // The next ones are not held up.
    let begun = sim.now().mono;
    let third = send_to_address(&mut sim, here, "third");
    assert!(sim.run_until_quiet(secs(5)));
    assert!(sim.collected(here).outcomes[&third].at < begun + millis(10));
    let written = sim.robot_letters(robot);
    assert!(written[0].starts_with(&fipa_link::PREAMBLE));
    let payloads = written[1..].iter().map(|octets| {
        let letter = decode_letter(octets, &Limits::default()).unwrap();
        String::from_utf8(letter.payload.to_vec()).unwrap()
    });
    assert_eq!(payloads.collect::<Vec<_>>(), ["first", "second", "third"]);
    // After a while the robot may have become one of ours.
    sim.run_for(secs(700));
    send_to_address(&mut sim, here, "fourth");
    assert!(sim.run_until_quiet(secs(5)));
    let greetings = sim.robot_letters(robot);
    let greetings = greetings
        .iter()
        .filter(|o| o.starts_with(&fipa_link::PREAMBLE));
    assert_eq!(greetings.count(), 2);
}

#[test]
fn a_peer_that_the_operator_gave_is_never_taken_for_a_robot_of_another_make() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    sim.add_peer(here, sim.address(robot));
    let ticket = send_to_address(&mut sim, here, "");
    sim.run_for(secs(20));
    assert_eq!(outcome(&sim, here, ticket), Outcome::Timeout);
    let all_greetings = |octets: &Bytes| octets.starts_with(&fipa_link::PREAMBLE);
    assert!(sim.robot_letters(robot).iter().all(all_greetings));
}

#[test]
fn what_is_being_written_at_the_shutdown_is_broken_off() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    sim.set_habit(robot, Habit::Stalls);
    sim.send(here, "a", &["b"], &large(200_000));
    sim.run_for(millis(100));
    sim.shutdown(here);
    sim.set_habit(robot, Habit::Reads);
    sim.run_for(secs(1));
    assert!(!sim.is_up(here));
    assert_eq!(sim.robot_letters(robot), [] as [Bytes; 0]);
}

/// Letters to a robot on which everything goes wrong, at random.
fn chaos(seed: u64) -> (usize, usize) {
    let mut sim = Sim::new(seed);
    sim.set_network(Network {
        latency: millis(2),
        jitter: millis(10),
        split: true,
        octets_per_second: Some(2_000_000),
    });
    let (here, robot) = here_and_robot(&mut sim);
    let spare = sim.robot("spare");
    let places = [
        ("tcp://robot:9999", MESSAGE_TRANSPORT),
        ("tcp://spare:9999", MESSAGE_TRANSPORT),
    ];
    for name in ["b", "c"] {
        sim.announce(robot, &entry(name, &places));
    }
    let mut sent = Vec::new();
    for n in 0..60 {
        let pause = sim.random().u64(0..200);
        sim.run_for(millis(pause));
        let to = ["b", "c"][sim.random().usize(0..2)];
        let size = sim.random().usize(0..200_000);
        let content = format!("{n} {}", large(size));
        let timeout = millis(sim.random().u64(200..5000));
        let ticket = sim.send_within(here, "a", &[to], &content, timeout);
        sent.push((ticket, content));
        let at = [robot, spare][sim.random().usize(0..2)];
        match sim.random().u8(0..10) {
            0 => sim.set_habit(at, Habit::Stalls),
            1 => sim.set_habit(at, Habit::Breaks(50_000)),
            2..5 => sim.set_habit(at, Habit::Reads),
            5 => sim.reset(here, at),
            6 => sim.cut(here, at),
            7 | 8 => sim.mend(at),
            _ => {}
        }
    }
    for at in [robot, spare] {
        sim.mend(at);
        sim.set_habit(at, Habit::Reads);
    }
    sim.run_for(secs(20));
    assert_eq!(sim.mts(here).letters_under_way(), 0, "seed {seed}");
    let mut read = contents(&mut sim, robot);
    read.extend(contents(&mut sim, spare));
    let mut arrived = 0;
    for (ticket, content) in &sent {
        let told = outcome(&sim, here, *ticket);
        let times = read.iter().filter(|letter| *letter == content).count();
        // What is sent may still be lost with a connection that breaks; it never comes twice.
        assert!(times <= 1, "seed {seed}: {told} came {times} times");
        assert!(times == 0 || told == Outcome::Sent, "seed {seed}: {told}");
        arrived += times;
    }
    // Nothing but whole letters ended properly.
    assert_eq!(read.len(), arrived, "seed {seed}");
    (arrived, sent.len())
}

#[test]
fn whatever_goes_wrong_no_letter_comes_twice_or_in_part() {
    let (mut arrived, mut all) = (0, 0);
    for seed in 0..40 {
        let (some, of) = chaos(seed);
        arrived += some;
        all += of;
    }
    assert!(arrived * 2 > all, "{arrived} of {all} arrived");
}
