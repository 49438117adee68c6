//! Letters of other makes that come in: one a connection, its end is the end of the stream.
mod support;

use bytes::{Bytes, BytesMut};
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Received, Representation, Slots, Text};
use fipa_codec::{
    Dialect, Limits, Output as Encoded, bit_efficient, decode_letter, decode_payload,
};
use fipa_directory::{Entry, InstanceId, Location, MESSAGE_TRANSPORT, Now};
use fipa_mts::{Config, ConnId, Connected, Ended, Machine, Mts, Notice, Output, Registration};
use fipa_sim::{Network, NodeId, Sim, Then};

use support::{lost, millis, recorded, secs};

/// A daemon, and a robot of another make that writes to it.
fn here_and_robot(sim: &mut Sim) -> (NodeId, NodeId) {
    (sim.daemon("here"), sim.robot("robot"))
}

/// Has the robot write octets and end the stream.
fn write(sim: &mut Sim, robot: NodeId, to: NodeId, octets: impl Into<Bytes>) {
    let address = sim.address(to);
    sim.robot_writes(robot, address, octets.into(), Then::Ends);
    assert!(sim.run_until_quiet(secs(5)));
}

fn mail<'a>(sim: &'a Sim, node: NodeId, agent: &str) -> &'a [Letter] {
    let mail = sim.collected(node).mail.get(agent);
    mail.map_or(&[], Vec::as_slice)
}

/// A letter as fipa_services writes it.
fn letter(to: &[&str], stamp: Option<(&str, &str)>, content: &'static str) -> Bytes {
    let mut envelope = Envelope::new(Slots {
        to: to.iter().map(|name| AgentId::new(*name)).collect(),
        from: Some(AgentId::new("agent-x")),
        acl_representation: Some(Representation::BitEfficient),
        payload_length: Some(content.len() as u64),
        date: Some(FipaTime::from_unix_millis(0)),
        intended_receiver: to.iter().map(|name| AgentId::new(*name)).collect(),
        ..Slots::default()
    });
    if let Some((by, id)) = stamp {
        envelope.overlays.push(Slots {
            received: Some(Received {
                by: Text::from(by),
                from: None,
                date: FipaTime::from_unix_millis(0),
                id: Some(Text::from(id)),
                via: None,
                user_defined: Vec::new(),
            }),
            ..Slots::default()
        });
    }
    let payload = Bytes::from_static(content.as_bytes());
    let letter = Letter { envelope, payload };
    let mut octets = Encoded::new();
    bit_efficient::encode_letter_as(Dialect::Cpp, &letter, &mut octets).unwrap();
    octets.take_bytes()
}

#[test]
fn every_recorded_letter_reaches_the_agent_that_it_is_for() {
    let cases = [
        ("00_to_agent-b", "agent-b", "agent-a", "one remote"),
        ("03_to_agent-b", "agent-b", "agent-a", "mixed"),
        (
            "04_to_agent-b",
            "agent-b",
            "agent-a",
            "regex: agent-b but not sender agent-a",
        ),
        ("05_to_agent-b", "agent-b", "agent-a", "broadcast"),
        ("01_to_jade", "jade@1.2:1099/JADE", "agent-a", "one jade"),
        ("06_to_jade", "jade@1.2:1099/JADE", "agent-a", "broadcast"),
        ("02_to_agent-a", "agent-a", "mts-0", "unregistered-2"),
        ("07_to_agent-a", "agent-a", "mts-0", "odd-sig"),
        ("08_to_agent-a", "agent-a", "mts-0", "fail-x"),
    ];
    for (seed, (file, to, from, content)) in (0..).zip(cases) {
        let mut sim = Sim::new(seed);
        sim.set_network(Network {
            split: true,
            jitter: millis(5),
            ..Network::default()
        });
        let (here, robot) = here_and_robot(&mut sim);
        for agent in ["agent-a", "agent-b", "jade@1.2:1099/JADE"] {
            sim.register(here, agent);
        }
        let octets = recorded(&format!("mts/sent_{file}.bin"));
        let written = decode_letter(&octets, &Limits::default()).unwrap();
        write(&mut sim, robot, here, octets);
        assert_eq!(lost(&sim, here), [""; 0], "{file}");
        let all: usize = sim.collected(here).mail.values().map(Vec::len).sum();
        assert_eq!(all, 1, "{file}");
        let letter = &mail(&sim, here, to)[0];
        assert_eq!(letter.payload, written.payload, "{file}");
        let (payload, limits) = (&letter.payload, &Limits::default());
        let message = decode_payload(&letter.envelope, payload, limits).unwrap();
        assert_eq!(message.sender, Some(AgentId::new(from)), "{file}");
        let text = message.content_str().unwrap();
        assert!(text.contains(content), "{file}: {text}");
        let stamps: Vec<_> = letter.envelope.stamps().collect();
        let last = stamps.last().unwrap();
        assert_eq!(
            (last.by.as_str(), last.via.as_deref()),
            ("here", Some("tcp"))
        );
        assert_eq!(last.from, None);
        assert!(stamps.iter().any(|stamp| stamp.by == "mts-0"), "{file}");
    }
}

#[test]
fn the_recorded_letter_of_the_bridge_to_jade_is_taken_in() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    sim.register(here, "rock_agent");
    write(
        &mut sim,
        robot,
        here,
        recorded("jade/tcp_mtp_jade_to_rock.bin"),
    );
    let letter = &mail(&sim, here, "rock_agent")[0];
    let message = decode_payload(&letter.envelope, &letter.payload, &Limits::default()).unwrap();
    assert_eq!(message.content_str(), Some("hello rock"));
}

#[test]
fn a_receiver_may_be_a_pattern_or_have_question_marks_for_dots() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    for agent in ["agent-b", "agent-c", "agent-x", "d@h.local"] {
        sim.register(here, agent);
    }
    write(&mut sim, robot, here, letter(&["agent.*"], None, "to all"));
    write(&mut sim, robot, here, letter(&["d@h?local"], None, "to d"));
    assert_eq!(sim.contents(here, "agent-b"), ["to all"]);
    assert_eq!(sim.contents(here, "agent-c"), ["to all"]);
    assert!(sim.contents(here, "agent-x").is_empty());
    assert_eq!(sim.contents(here, "d@h.local"), ["to d"]);
}

#[test]
fn patterns_of_strangers_that_come_too_fast_are_refused_and_nobody_else_waits_for_them() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    sim.register(here, "agent-b");
    let address = sim.address(here);
    write(&mut sim, robot, here, letter(&["agent.*"], None, "first"));
    for n in 0..100 {
        let pattern = format!("({})*{n}", "a|aa".repeat(500));
        let octets = letter(&[&pattern], None, "many");
        sim.robot_writes(robot, address.clone(), octets, Then::Ends);
    }
    assert!(sim.run_until_quiet(secs(5)));
    let refused = |sim: &Sim| {
        let lost = lost(sim, here);
        let refused = lost.iter().filter(|l| l.contains("patterns come too fast"));
        refused.count()
    };
    let many = refused(&sim);
    assert!((30..90).contains(&many), "{many} of 100");
    // Names are not patterns, what was compiled is known, and programs are no strangers.
    for to in ["agent-b", "agent.*"] {
        let octets = letter(&[to], None, "then");
        sim.robot_writes(robot, address.clone(), octets, Then::Ends);
    }
    let ours = sim.send(here, "agent-b", &["(agent)-b"], "ours");
    sim.run_for(millis(100));
    assert_eq!(sim.contents(here, "agent-b"), ["first", "then", "then"]);
    assert_eq!(
        sim.outcomes(here, ours)[0].reason,
        "the pattern matches nobody but the sender"
    );
    sim.run_for(secs(1));
    write(&mut sim, robot, here, letter(&["a.*b"], None, "later"));
    assert_eq!(sim.contents(here, "agent-b").last().unwrap(), "later");
    assert_eq!(refused(&sim), many);
}

#[test]
fn names_that_are_longer_than_any_are_told_by_their_length() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let (longest, longer) = ("x".repeat(4096), "x".repeat(4097));
    sim.register(here, &longest);
    write(&mut sim, robot, here, letter(&[&longest], None, "it"));
    assert_eq!(sim.contents(here, &longest), ["it"]);
    write(
        &mut sim,
        robot,
        here,
        letter(&[&longest, &longer], None, "no"),
    );
    assert_eq!(sim.contents(here, &longest), ["it"]);
    let [lost] = &lost(&sim, here)[..] else {
        panic!("one is lost");
    };
    assert!(lost.contains("a name has 4097 octets; up to 4096 are taken"));
}

#[test]
fn a_letter_for_several_agents_goes_on_to_those_of_other_daemons() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let there = sim.daemon("there");
    sim.register(here, "b");
    sim.register(there, "c");
    sim.add_peer(here, sim.address(there));
    sim.run_for(millis(100));
    for octets in [
        letter(&["b", "c"], None, "both"),
        recorded("mts/sent_06_to_jade.bin"),
    ] {
        write(&mut sim, robot, here, octets);
    }
    assert_eq!(sim.contents(here, "b"), ["both"]);
    assert_eq!(sim.contents(there, "c"), ["both"]);
    // The recorded one is for an agent that nobody has.
    let lost = lost(&sim, here);
    assert!(
        lost.len() == 1 && lost[0].contains("jade@1?2:1099/JADE"),
        "{lost:?}"
    );
    // An envelope in XML crosses a link as a bit-efficient one.
    sim.register(there, "jade@1.2:1099/JADE");
    sim.run_for(millis(100));
    write(&mut sim, robot, here, recorded("mts/sent_06_to_jade.bin"));
    assert_eq!(mail(&sim, there, "jade@1.2:1099/JADE").len(), 1);
}

#[test]
fn what_is_no_letter_and_no_link_is_refused_at_its_first_octets() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let address = sim.address(here);
    let octets = Bytes::from_static(b"GET / HTTP/1.1\r\n");
    sim.robot_writes(robot, address, octets, Then::Stalls);
    sim.run_for(millis(10));
    let lost = lost(&sim, here);
    assert!(lost[0].contains("begins with the octet 0x47"), "{lost:?}");
    assert!(
        lost[0].contains("of 16 octets from tcp://node-1:40000"),
        "{lost:?}"
    );
    assert_eq!(sim.streams(here, robot), 0);
}

#[test]
fn a_letter_that_cannot_be_read_is_noticed_with_what_is_wrong() {
    let whole = letter(&["b"], None, "0123456789");
    let mut broken = whole.to_vec();
    broken[9] = 0x77;
    let cases = [
        (whole.slice(..whole.len() - 3), "after 7 of the 10 octets"),
        (whole.slice(..12), "cannot be read"),
        (Bytes::from(broken), "cannot be read"),
        (
            Bytes::from_static(b"<?xml?><envelope><params>"),
            "cannot be read",
        ),
        (Bytes::from_static(b" \n "), "cannot be read"),
    ];
    for (octets, expected) in cases {
        let mut sim = Sim::new(1);
        let (here, robot) = here_and_robot(&mut sim);
        sim.register(here, "b");
        let size = octets.len();
        write(&mut sim, robot, here, octets);
        let lost = lost(&sim, here);
        assert_eq!(lost.len(), 1, "{lost:?}");
        assert!(lost[0].contains(expected), "{lost:?}");
        assert!(lost[0].contains(&format!("of {size} octets")), "{lost:?}");
        assert!(sim.contents(here, "b").is_empty());
    }
}

#[test]
fn a_connection_that_breaks_or_stalls_in_a_letter_delivers_nothing() {
    for (then, after, expected) in [
        (Then::Breaks, millis(10), "broke before its end"),
        (Then::Stalls, secs(31), "did not come within 30 s"),
    ] {
        let mut sim = Sim::new(1);
        let (here, robot) = here_and_robot(&mut sim);
        sim.register(here, "b");
        // All but the announced length is there: only the end of the stream is missing.
        let octets = letter(&["b"], None, "0123456789");
        sim.robot_writes(robot, sim.address(here), octets, Then::Stalls);
        sim.run_for(millis(5));
        if then == Then::Breaks {
            sim.reset(robot, here);
        }
        sim.run_for(after);
        let lost = lost(&sim, here);
        assert!(lost.len() == 1 && lost[0].contains(expected), "{lost:?}");
        assert!(sim.contents(here, "b").is_empty());
        assert_eq!(sim.streams(here, robot), 0);
    }
}

#[test]
fn a_letter_larger_than_allowed_is_given_up_where_the_limit_is() {
    let mut sim = Sim::new(1);
    let here = sim.daemon_with("here", |config| config.max_letter = 1000);
    let robot = sim.robot("robot");
    sim.register(here, "b");
    let octets = letter(&["b"], None, "x".repeat(2000).leak());
    sim.robot_writes(robot, sim.address(here), octets, Then::Stalls);
    sim.run_for(millis(10));
    let lost = lost(&sim, here);
    assert!(lost[0].contains("larger than the 1000 octets"), "{lost:?}");
}

#[test]
fn silent_and_half_written_connections_do_not_keep_others_out() {
    for begun in [Bytes::new(), letter(&["b"], None, "half").slice(..20)] {
        let mut sim = Sim::new(1);
        let (here, robot) = here_and_robot(&mut sim);
        sim.register(here, "b");
        let other = sim.daemon("other");
        for _ in 0..3000 {
            sim.robot_writes(robot, sim.address(here), begun.clone(), Then::Stalls);
        }
        sim.run_for(millis(10));
        assert_eq!(sim.streams(here, robot), 1000);
        sim.add_peer(other, sim.address(here));
        write(&mut sim, robot, here, letter(&["b"], None, "honest"));
        sim.run_for(millis(100));
        assert_eq!(sim.contents(here, "b"), ["honest"]);
        assert!(sim.mts(other).is_linked(sim.instance_of(here)));
        sim.run_for(secs(31));
        assert_eq!(sim.streams(here, robot), 0);
    }
}

#[test]
fn unfinished_letters_are_bounded_together() {
    let mut sim = Sim::new(1);
    let here = sim.daemon_with("here", |config| {
        config.max_letter = 10_000;
        config.queue_octets = 20_000;
    });
    let robot = sim.robot("robot");
    sim.register(here, "b");
    let half = letter(&["b"], None, "x".repeat(9000).leak());
    for _ in 0..5 {
        sim.robot_writes(robot, sim.address(here), half.clone(), Then::Stalls);
        sim.run_for(millis(10));
    }
    assert_eq!(sim.streams(here, robot), 2);
    assert_eq!(lost(&sim, here).len(), 3);
}

#[test]
fn a_stamp_with_our_name_is_no_circle_unless_it_is_ours() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    let elsewhere = Location {
        address: Text::from("tcp://robot:9999"),
        signature: Text::from_static(MESSAGE_TRANSPORT),
    };
    sim.announce(
        robot,
        &Entry {
            locations: vec![elsewhere],
            ..Entry::new("b")
        },
    );
    let theirs = ("here", "1:20261122-07:05:27:563739");
    write(&mut sim, robot, here, letter(&["b"], Some(theirs), "fine"));
    assert_eq!(sim.robot_letters(robot).len(), 1);
    let own = format!("{}:1", sim.instance_of(here));
    let ours = ("here", own.as_str());
    write(&mut sim, robot, here, letter(&["b"], Some(ours), "circle"));
    assert_eq!(sim.robot_letters(robot).len(), 1);
    let lost = lost(&sim, here);
    assert!(
        lost.len() == 1 && lost[0].contains("came back to here"),
        "{lost:?}"
    );
}

#[test]
fn nothing_is_written_to_a_caller_before_it_speaks_our_link() {
    const CONN: ConnId = ConnId(1);
    let now = Now::default();
    let id = InstanceId::from_bytes([1; 16]);
    let mut mts = Mts::new(Config::new(id, "here"));
    mts.register(now, 1, Registration::new("b"));
    while mts.poll_output().is_some() {}
    let connected = Connected {
        conn: CONN,
        dialled: None,
        control: false,
        same_host: false,
        remote: Text::from("tcp://10.0.0.7:50000"),
        identity: None,
        lanes: false,
    };
    mts.connected(now, connected.clone());
    let mut octets = BytesMut::from(&letter(&["b"], None, "hi")[..]);
    mts.received(now, CONN, &mut octets);
    assert!(mts.poll_output().is_none() && mts.poll_transmit(now, CONN).is_none());
    let ended = Ended {
        reason: "",
        orderly: true,
        all_written: true,
    };
    mts.closed(now, CONN, ended);
    assert!(matches!(mts.poll_output(), Some(Output::Mail(_))));
    assert_eq!(mts.take_mail("b").unwrap().payload, "hi");

    // Who does is greeted at its first octet.
    mts.connected(now, connected);
    assert!(mts.poll_output().is_none() && mts.poll_transmit(now, CONN).is_none());
    mts.received(now, CONN, &mut BytesMut::from(&fipa_link::PREAMBLE[..1]));
    assert!(matches!(mts.poll_output(), Some(Output::Transmit(CONN))));
    let greeting = mts.poll_transmit(now, CONN).unwrap();
    assert!(greeting.starts_with(&fipa_link::PREAMBLE), "{greeting:?}");
}

#[test]
fn who_opens_a_connection_and_says_nothing_is_told_of_and_who_closes_it_is_not() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim);
    sim.robot_writes(robot, sim.address(here), Bytes::new(), Then::Ends);
    sim.run_for(secs(10));
    assert!(sim.collected(here).notices.is_empty());
    sim.robot_writes(robot, sim.address(here), Bytes::new(), Then::Stalls);
    sim.run_for(secs(10));
    let notices = &sim.collected(here).notices;
    assert!(matches!(&notices[..], [(_, Notice::LinkFailed { .. })]));
}
