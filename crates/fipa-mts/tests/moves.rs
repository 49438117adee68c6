//! Agents that move from one service to another, and the letters for them.
mod support;

use std::collections::BTreeSet;
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::{AgentId, Text};
use fipa_directory::{Address, ChangeKind};
use fipa_link::Outcome;
use fipa_sim::{Network, NodeId, Sim};

use support::{changes, fleet, millis, outcome, pair, reason, secs};

/// A letter that was sent: by whom, and its content.
struct Sent {
    node: NodeId,
    ticket: u64,
    content: String,
}

/// Everything that came for an agent, wherever it was.
fn got(sim: &Sim, nodes: &[NodeId], agent: &str) -> Vec<String> {
    let everywhere = nodes.iter().flat_map(|node| sim.contents(*node, agent));
    everywhere.collect()
}

/// Checks that every letter came once, or did not come and its sender knows; how many came.
fn check(sim: &Sim, nodes: &[NodeId], agent: &str, sent: &[Sent], case: &str) -> usize {
    let got = got(sim, nodes, agent);
    let distinct: BTreeSet<&String> = got.iter().collect();
    assert_eq!(distinct.len(), got.len(), "{case}: a letter came twice");
    for letter in sent {
        let outcomes = sim.outcomes(letter.node, letter.ticket);
        assert_eq!(outcomes.len(), 1, "{case}: {outcomes:?}");
        let arrived = distinct.contains(&letter.content);
        let told = outcomes[0].outcome == Outcome::Delivered;
        assert_eq!(told, arrived, "{case}: {}: {outcomes:?}", letter.content);
        assert!(told || !outcomes[0].reason.is_empty(), "{case}");
    }
    got.len()
}

/// How an agent moves.
#[derive(Clone, Copy, Debug)]
enum Way {
    /// It leaves its old place, and is at the new one after so many milliseconds.
    LeaveFirst(u64),
    /// It is at the new place so many milliseconds before it leaves the old one.
    ArriveFirst(u64),
}

fn go(sim: &mut Sim, from: NodeId, to: NodeId, agent: &'static str, way: Way) {
    match way {
        Way::LeaveFirst(pause) => {
            sim.leave(from, agent);
            sim.after(millis(pause), move |sim| {
                sim.register(to, agent);
            });
        }
        Way::ArriveFirst(pause) => {
            sim.register(to, agent);
            sim.after(millis(pause), move |sim| sim.leave(from, agent));
        }
    }
}

/// An agent moves under a thousand letters a second from a third service, with the hundredth; how
/// many of them came.
fn move_under_load(letters: usize, way: Way, with_programs: bool, latency: Duration) -> usize {
    let case = format!("{way:?}, programs: {with_programs}, {latency:?}");
    let mut sim = Sim::new(1);
    sim.set_network(Network {
        latency,
        jitter: latency / 2,
        split: true,
        octets_per_second: None,
    });
    let fleet = fleet(&mut sim, 3);
    let mut nodes = vec![fleet[0], fleet[1]];
    if with_programs {
        nodes = vec![sim.program("p", fleet[0]), sim.program("q", fleet[1])];
        sim.run_for(millis(100));
    }
    sim.register(nodes[0], "payload");
    sim.register(fleet[2], "sender");
    sim.run_for(secs(1));
    let mut sent = Vec::new();
    for n in 0..letters {
        if n == 100 {
            go(&mut sim, nodes[0], nodes[1], "payload", way);
        }
        let content = format!("{n}");
        let ticket = sim.send(fleet[2], "sender", &["payload"], &content);
        sent.push(Sent {
            node: fleet[2],
            ticket,
            content,
        });
        sim.run_for(millis(1));
    }
    assert!(sim.run_until_quiet(secs(20)), "{case}");
    for node in &fleet {
        let conflicts = changes(&sim, *node, ChangeKind::Conflict, "payload");
        assert_eq!(conflicts, 0, "{case}");
        assert_eq!(sim.mts(*node).letters_under_way(), 0, "{case}");
    }
    check(&sim, &nodes, "payload", &sent, &case)
}

#[test]
fn an_agent_that_moves_within_a_second_gets_every_letter_once() {
    for with_programs in [false, true] {
        for latency in [millis(1), millis(20)] {
            for pause in [0, 30, 600] {
                for way in [Way::LeaveFirst(pause), Way::ArriveFirst(pause)] {
                    let came = move_under_load(750, way, with_programs, latency);
                    assert_eq!(came, 750, "{way:?} {with_programs} {latency:?}");
                }
            }
        }
    }
}

#[test]
fn of_an_agent_that_is_away_for_longer_senders_are_told() {
    for with_programs in [false, true] {
        let away = Way::LeaveFirst(1100);
        let came = move_under_load(1400, away, with_programs, millis(1));
        assert!((290..310).contains(&came), "{came}");
    }
}

#[test]
fn letters_to_an_agent_that_has_gone_for_good_are_unknown_after_a_second() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.deregister(two, "b");
    sim.run_for(millis(300));
    let begun = sim.now().mono;
    let ticket = sim.send(one, "a", &["b"], "");
    sim.run_for(secs(3));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Unknown);
    let told = sim.collected(one).outcomes[&ticket].at - begun;
    assert!(told < secs(1), "{told:?}");
    let ticket = sim.send(one, "a", &["b"], "");
    sim.run_for(millis(1));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Unknown, "at once");
}

#[test]
fn letters_that_wait_for_an_agent_on_the_move_are_bounded_and_end_in_time() {
    let mut sim = Sim::new(1);
    let one = sim.daemon_with("one", |config| config.queue_octets = 1000);
    sim.register(one, "a");
    sim.register(one, "b");
    sim.deregister(one, "b");
    let content = "x".repeat(100);
    let tickets: Vec<u64> = (0..20)
        .map(|_| sim.send_within(one, "a", &["b"], &content, millis(500)))
        .collect();
    let ended = |sim: &Sim| {
        let ended = tickets
            .iter()
            .filter(|ticket| sim.told(one, **ticket).is_some());
        ended.count()
    };
    assert!((10..20).contains(&ended(&sim)), "{}", ended(&sim));
    sim.run_for(millis(500));
    assert_eq!(ended(&sim), 20);
    sim.run_for(secs(2));
    // The room is free again.
    sim.register(one, "b");
    sim.deregister(one, "b");
    let ticket = sim.send(one, "a", &["b"], &content);
    assert!(sim.told(one, ticket).is_none());
    sim.register(one, "b");
    sim.run_for(millis(1));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
    assert_eq!(sim.contents(one, "b").len(), 1);
}

#[test]
fn an_agent_that_moves_back_and_forth_among_slow_links_loses_no_letter_without_notice() {
    let mut all = 0;
    let mut came = 0;
    for seed in 0..10 {
        let mut sim = Sim::new(seed);
        let latency = millis(sim.random().u64(1..60));
        sim.set_network(Network {
            latency,
            jitter: latency,
            split: seed.is_multiple_of(2),
            octets_per_second: None,
        });
        let fleet = fleet(&mut sim, 3);
        let nodes = [
            fleet[0],
            sim.program("p", fleet[0]),
            fleet[1],
            sim.program("q", fleet[2]),
        ];
        sim.run_for(secs(1));
        sim.register(fleet[0], "s0");
        sim.register(fleet[2], "s2");
        let mut at = 0;
        sim.register(nodes[at], "payload");
        sim.run_for(secs(1));
        let mut sent = Vec::new();
        let mut next_move = 0;
        for n in 0..1200 {
            if n == next_move {
                let to = (at + sim.random().usize(1..nodes.len())) % nodes.len();
                let pause = sim.random().u64(0..250);
                let way = match sim.random().bool() {
                    true => Way::LeaveFirst(pause),
                    false => Way::ArriveFirst(pause),
                };
                // One service holds a name once: within it, the agent leaves first.
                let hosts = [0, 0, 1, 2];
                let way = match way {
                    Way::ArriveFirst(pause) if hosts[at] == hosts[to] => Way::LeaveFirst(pause),
                    way => way,
                };
                go(&mut sim, nodes[at], nodes[to], "payload", way);
                at = to;
                next_move = n + sim.random().usize(260..500);
            }
            let (node, from) = [(fleet[0], "s0"), (fleet[2], "s2")][n % 2];
            let content = format!("{n}");
            let ticket = sim.send(node, from, &["payload"], &content);
            sent.push(Sent {
                node,
                ticket,
                content,
            });
            sim.run_for(millis(1));
        }
        assert!(sim.run_until_quiet(secs(20)));
        all += sent.len();
        came += check(&sim, &nodes, "payload", &sent, &format!("seed {seed}"));
    }
    assert!(came * 100 > all * 98, "{came} of {all} came");
}

#[test]
fn a_letter_that_has_not_left_yet_follows_an_agent_from_a_robot_that_died() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 3);
    sim.register(nodes[0], "a");
    sim.register(nodes[1], "payload");
    sim.run_for(secs(1));
    sim.crash(nodes[1]);
    sim.run_for(millis(100));
    let waits = sim.send(nodes[0], "a", &["payload"], "waits");
    sim.run_for(millis(900));
    assert!(sim.told(nodes[0], waits).is_none());
    sim.register(nodes[2], "payload");
    sim.run_for(secs(2));
    assert_eq!(outcome(&sim, nodes[0], waits), Outcome::Delivered);
    assert_eq!(sim.contents(nodes[2], "payload"), ["waits"]);
}

#[test]
fn a_letter_that_a_dead_robot_may_have_got_does_not_follow() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 3);
    sim.register(nodes[0], "a");
    sim.register(nodes[1], "payload");
    sim.run_for(secs(1));
    let ticket = sim.send_within(nodes[0], "a", &["payload"], "taken", secs(60));
    sim.run_for(Duration::from_micros(1500));
    assert_eq!(sim.contents(nodes[1], "payload"), ["taken"]);
    // Its receipt is under way, and does not arrive.
    sim.isolate(nodes[1]);
    sim.register(nodes[2], "payload");
    sim.run_for(secs(30));
    assert_eq!(outcome(&sim, nodes[0], ticket), Outcome::Timeout);
    assert!(reason(&sim, nodes[0], ticket).contains("d1 is gone"));
    assert_eq!(sim.contents(nodes[2], "payload"), [""; 0]);
}

#[test]
fn a_letter_that_crosses_an_agents_leave_follows_it() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 3);
    let program = sim.program("p", nodes[1]);
    sim.register(nodes[0], "a");
    sim.run_for(millis(100));
    sim.register(program, "payload");
    sim.run_for(secs(1));
    let ticket = sim.send(nodes[0], "a", &["payload"], "late");
    // It is on its way from the daemon to the program.
    sim.run_for(Duration::from_micros(1025));
    sim.deregister(program, "payload");
    sim.run_for(millis(200));
    assert!(sim.told(nodes[0], ticket).is_none());
    sim.register(nodes[2], "payload");
    sim.run_for(millis(10));
    assert_eq!(outcome(&sim, nodes[0], ticket), Outcome::Delivered);
    assert_eq!(sim.contents(nodes[2], "payload"), ["late"]);
    assert_eq!(sim.contents(program, "payload"), [""; 0]);
}

#[test]
fn whoever_leaves_takes_along_what_was_delivered() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 2);
    let program = sim.program("p", nodes[1]);
    sim.run_for(millis(100));
    sim.register(nodes[0], "a");
    for home in [nodes[1], program] {
        sim.register(home, "payload");
        sim.run_for(secs(1));
        sim.set_reading(home, false);
        let sent: Vec<u64> = (0..10)
            .map(|n| {
                sim.run_for(Duration::from_micros(150));
                sim.send(nodes[0], "a", &["payload"], &format!("{n}"))
            })
            .collect();
        // Some are there, some are not.
        sim.run_for(Duration::from_micros(200));
        sim.leave(home, "payload");
        sim.run_for(secs(3));
        let came: Vec<String> = sim.contents(home, "payload");
        let outcomes = sent.iter().map(|ticket| outcome(&sim, nodes[0], *ticket));
        let delivered = outcomes.filter(|outcome| *outcome == Outcome::Delivered);
        assert_eq!(delivered.count(), came.len());
        assert!((1..10).contains(&came.len()), "{came:?}");
        assert!(sim.names(nodes[0]).iter().all(|name| name != "payload"));
    }
}

#[test]
fn a_program_whose_daemon_dies_while_its_agent_leaves_keeps_what_was_delivered() {
    let mut sim = Sim::new(1);
    let daemon = sim.daemon("d");
    let program = sim.program("p", daemon);
    sim.run_for(millis(100));
    sim.register(program, "payload");
    sim.register(daemon, "a");
    sim.run_for(millis(100));
    sim.set_reading(program, false);
    let ticket = sim.send(daemon, "a", &["payload"], "kept");
    sim.run_for(millis(1));
    assert_eq!(outcome(&sim, daemon, ticket), Outcome::Delivered);
    sim.leave(program, "payload");
    sim.crash(daemon);
    sim.run_for(millis(10));
    assert_eq!(sim.contents(program, "payload"), ["kept"]);
    sim.restart(daemon);
    sim.run_for(secs(1));
    assert!(sim.directory(daemon).is_empty(), "it has left");
}

#[test]
fn all_agents_of_a_robot_change_their_place_in_one_step() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 3);
    for n in 0..300 {
        sim.register(nodes[0], &format!("agent{n}"));
    }
    sim.register(nodes[1], "b");
    sim.run_for(secs(1));
    sim.forget(nodes[1]);
    let place = Address::tcp("docked", 4100);
    sim.set_endpoints(nodes[0], vec![place.clone()]);
    sim.run_for(millis(100));
    let seen = &sim.collected(nodes[1]).changes;
    assert_eq!(seen.len(), 300);
    let times: BTreeSet<Duration> = seen.iter().map(|(at, _)| *at).collect();
    assert_eq!(times.len(), 1, "one step");
    for (_, change) in seen {
        assert_eq!(change.kind, ChangeKind::Changed);
        assert_eq!(change.record.entry.locations[0].address, place.to_text());
    }
    // Its peers dial it there, should the link break.
    sim.forget(nodes[1]);
    sim.reset(nodes[0], nodes[1]);
    sim.run_for(secs(1));
    let dials = sim.collected(nodes[1]).dials.iter();
    assert!(dials.clone().all(|(_, to)| to[0] == place), "{dials:?}");
    assert_eq!(dials.count(), 1);
    let ticket = sim.send(nodes[1], "b", &["agent7"], "");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, nodes[1], ticket), Outcome::Delivered);
    assert_eq!(changes(&sim, nodes[1], ChangeKind::Removed, "agent7"), 0);
}

#[test]
fn two_agents_of_one_name_are_told_of_loudly_by_both_services_and_keep_it() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 3);
    let program = sim.program("p", nodes[2]);
    sim.register(nodes[0], "a");
    sim.register(nodes[1], "a");
    sim.run_for(secs(60));
    for node in nodes.iter().chain([&program]) {
        assert_eq!(
            changes(&sim, *node, ChangeKind::Conflict, "a"),
            1,
            "{node:?}"
        );
        assert_eq!(sim.names(*node), ["a", "a"]);
    }
    for node in &nodes[..2] {
        let ticket = sim.send(*node, "a", &["a"], "mine");
        sim.run_for(millis(10));
        assert_eq!(outcome(&sim, *node, ticket), Outcome::Delivered);
        assert_eq!(sim.contents(*node, "a"), ["mine"]);
    }
}

/// Sends a letter for an agent that is known by its resolver only.
fn send_to_resolved(sim: &mut Sim, from: NodeId, name: &str, resolver: AgentId) -> u64 {
    let mut to = AgentId::new(name);
    to.resolvers.push(resolver);
    let mut letter = sim.letter("a", vec![to.clone()], Bytes::from_static(b"resolved"));
    letter.envelope.base.intended_receiver = vec![to];
    sim.submit(from, letter, secs(5))
}

#[test]
fn the_service_of_a_resolver_knows_more_names() {
    let mut sim = Sim::new(1);
    let nodes: Vec<NodeId> = (0..3).map(|n| sim.daemon(&format!("d{n}"))).collect();
    // The first and the last do not reach each other.
    sim.cut(nodes[0], nodes[2]);
    for node in [nodes[0], nodes[2]] {
        let between = sim.address(nodes[1]);
        sim.add_peer(node, between);
    }
    sim.register(nodes[0], "a");
    sim.register(nodes[1], "names");
    sim.register(nodes[2], "c");
    sim.run_for(secs(1));
    assert!(sim.directory(nodes[0]).find("c").is_none());
    let mut at = AgentId::new("names-elsewhere");
    at.addresses
        .push(Text::from(sim.address(nodes[1]).to_string()));
    for resolver in [AgentId::new("names"), at] {
        let ticket = send_to_resolved(&mut sim, nodes[0], "c", resolver.clone());
        sim.run_for(secs(1));
        assert_eq!(
            outcome(&sim, nodes[0], ticket),
            Outcome::Delivered,
            "{resolver:?}"
        );
        // It does not know everything, and what it is asked is no pattern.
        for name in ["nobody", "c.*"] {
            let ticket = send_to_resolved(&mut sim, nodes[0], name, resolver.clone());
            sim.run_for(secs(1));
            assert_eq!(outcome(&sim, nodes[0], ticket), Outcome::Unknown);
            assert!(reason(&sim, nodes[0], ticket).contains("d1"), "{name}");
        }
    }
    assert_eq!(sim.contents(nodes[2], "c").len(), 2);
    // A resolver that nobody knows helps nobody.
    let ticket = send_to_resolved(&mut sim, nodes[0], "c", AgentId::new("nobody"));
    sim.run_for(secs(1));
    assert_eq!(outcome(&sim, nodes[0], ticket), Outcome::Unknown);
}

#[test]
fn resolvers_that_name_each_other_come_to_an_end() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    let mut to = AgentId::new("nobody");
    to.resolvers = vec![AgentId::new("b"), AgentId::new("a")];
    let mut letter = sim.letter("a", vec![to.clone()], Bytes::new());
    letter.envelope.base.intended_receiver = vec![to];
    let ticket = sim.submit(one, letter, secs(5));
    assert!(sim.run_until_quiet(secs(1)));
    let told = sim.outcomes(one, ticket);
    assert!(!told[0].outcome.is_success(), "{told:?}");
    assert_eq!(sim.mts(two).letters_under_way(), 0);
}
