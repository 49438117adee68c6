//! Robots that vanish and come back: what others see of it, and when.
mod support;

use std::collections::BTreeMap;
use std::time::Duration;

use fipa_directory::{ChangeKind, InstanceId, State};
use fipa_link::Outcome;
use fipa_sim::{NodeId, Sim};

use support::{changes, fleet, secs};

/// Four daemons, the second with twenty agents and the others with one each, and a program at the
/// first.
fn robots(sim: &mut Sim) -> (Vec<NodeId>, NodeId) {
    let nodes = fleet(sim, 4);
    let program = sim.program("p", nodes[0]);
    for (n, node) in nodes.iter().enumerate() {
        sim.register(*node, &format!("single{n}"));
    }
    for n in 0..20 {
        sim.register(nodes[1], &format!("agent{n}"));
    }
    sim.run_for(secs(1));
    for node in nodes.iter().chain([&program]) {
        assert_eq!(sim.directory(*node).len(), 24);
        sim.forget(*node);
    }
    (nodes, program)
}

#[test]
fn all_agents_of_a_killed_daemon_are_gone_everywhere_within_five_seconds_and_nobody_elses() {
    let mut sim = Sim::new(1);
    let (nodes, program) = robots(&mut sim);
    sim.crash(nodes[1]);
    sim.run_for(secs(5));
    for node in [nodes[0], nodes[2], nodes[3], program] {
        let names = sim.names(node);
        assert_eq!(names, ["single0", "single2", "single3"], "{node:?}");
        for n in 0..20 {
            let name = format!("agent{n}");
            assert_eq!(changes(&sim, node, ChangeKind::Removed, &name), 1);
            assert_eq!(changes(&sim, node, ChangeKind::Added, &name), 0);
        }
        let others = sim.collected(node).changes.iter();
        let others = others.filter(|(_, c)| names.contains(&c.record.entry.name));
        assert_eq!(others.count(), 0);
        let gone = sim.directory(node).tombstones(sim.now());
        assert_eq!(gone.count(), 21);
    }
}

#[test]
fn an_agent_that_deregisters_takes_nobody_with_it() {
    let mut sim = Sim::new(1);
    let (nodes, program) = robots(&mut sim);
    sim.deregister(nodes[1], "agent7");
    sim.run_for(secs(120));
    for node in nodes.into_iter().chain([program]) {
        let seen = sim.collected(node).changes.iter();
        let seen: Vec<_> = seen
            .map(|(_, c)| (c.kind, c.record.entry.name.as_str()))
            .collect();
        assert_eq!(seen, [(ChangeKind::Removed, "agent7")], "{node:?}");
        assert_eq!(sim.directory(node).len(), 23);
    }
}

/// Every name with its owner.
fn owners(sim: &Sim, node: NodeId) -> BTreeMap<String, InstanceId> {
    let records = sim.directory(node).iter();
    records
        .map(|record| (record.entry.name.to_string(), record.owner))
        .collect()
}

/// What a node has seen of an agent: changes of its state, and its comings and goings.
fn seen(sim: &Sim, node: NodeId, name: &str) -> Vec<&'static str> {
    let changes = sim.collected(node).changes.iter();
    changes
        .filter(|(_, change)| change.record.entry.name == name)
        .map(|(_, change)| match (change.kind, change.record.state) {
            (ChangeKind::Changed, state) => state.as_str(),
            (ChangeKind::Added, _) => "added",
            (ChangeKind::Removed, _) => "removed",
            (ChangeKind::Conflict, _) => "conflict",
        })
        .collect()
}

/// How robots come to know each other.
#[derive(Clone, Copy, Debug, PartialEq)]
enum By {
    Mdns,
    /// All were given the first one's address.
    Peer,
}

/// The link of a robot is cut for so long while letters flow, or while none has for long.
fn cut(seconds: u64, busy: bool, by: By) {
    let case = format!("{seconds} s, busy: {busy}, {by:?}");
    let mut sim = Sim::new(seconds);
    let nodes: Vec<NodeId> = (0..4).map(|n| sim.daemon(&format!("d{n}"))).collect();
    for (n, node) in nodes.iter().enumerate() {
        sim.register(*node, &format!("agent{n}"));
        if by == By::Peer && n > 0 {
            let first = sim.address(nodes[0]);
            sim.add_peer(*node, first);
        }
    }
    if by == By::Mdns {
        sim.discover_all();
    }
    sim.run_for(secs(if busy { 5 } else { 300 }));
    let before: Vec<_> = nodes.iter().map(|node| owners(&sim, *node)).collect();
    assert!(before.iter().all(|owners| owners.len() == 4), "{case}");
    if busy {
        sim.send(nodes[0], "agent0", &["agent2"], "before");
        sim.run_for(secs(1));
    }
    nodes.iter().for_each(|node| sim.forget(*node));

    sim.isolate(nodes[2]);
    let mut sent = Vec::new();
    for n in 0..seconds.min(60) {
        if busy {
            let content = format!("letter {n}");
            let ticket = sim.send_within(nodes[0], "agent0", &["agent2"], &content, secs(5));
            sent.push((content, ticket));
        }
        sim.run_for(secs(1));
    }
    sim.run_for(secs(seconds.saturating_sub(60)));
    sim.mend(nodes[2]);
    if by == By::Mdns {
        sim.discover_all();
    }
    sim.run_for(secs(35));

    for (node, before) in nodes.iter().zip(&before) {
        assert_eq!(&owners(&sim, *node), before, "{case}");
    }
    let expected: &[&str] = match (seconds, busy) {
        (3, _) => &[],
        // Three times ten seconds are not over.
        (30, false) => &[],
        _ => &["suspect", "removed", "added"],
    };
    assert_eq!(seen(&sim, nodes[0], "agent2"), expected, "{case}");
    assert_eq!(seen(&sim, nodes[0], "agent1"), [""; 0], "{case}");
    let got = sim.contents(nodes[2], "agent2");
    for (content, ticket) in sent {
        let told = &sim.outcomes(nodes[0], ticket)[0];
        let times = got.iter().filter(|got| **got == content).count();
        assert!(times <= 1, "{case}: {content} came {times} times");
        if told.outcome == Outcome::Delivered {
            assert_eq!(times, 1, "{case}: {content} was told as delivered");
        } else {
            assert!(!told.reason.is_empty(), "{case}: {told:?}");
        }
    }
    let ticket = sim.send(nodes[2], "agent2", &["agent[013]"], "again");
    sim.run_for(Duration::from_millis(100));
    let told = sim.outcomes(nodes[2], ticket);
    let delivered = told.iter().filter(|o| o.outcome == Outcome::Delivered);
    assert_eq!(delivered.count(), 3, "{case}: {told:?}");
}

#[test]
fn a_robot_that_was_cut_off_is_back_with_all_its_agents() {
    for seconds in [3, 30, 300] {
        for busy in [false, true] {
            cut(seconds, busy, By::Mdns);
            cut(seconds, busy, By::Peer);
        }
    }
}

#[test]
fn a_silent_peer_is_suspect_after_three_heartbeats_and_removed_after_three_more() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 2);
    sim.register(nodes[0], "a");
    sim.register(nodes[1], "b");
    sim.run_for(secs(1));
    sim.send(nodes[0], "a", &["b"], "letters flow");
    sim.run_for(secs(1));
    sim.forget(nodes[0]);
    let silent_since = sim.now().mono;
    sim.isolate(nodes[1]);
    sim.run_for(secs(30));
    let times: Vec<(State, u64)> = sim
        .collected(nodes[0])
        .changes
        .iter()
        .map(|(at, change)| (change.record.state, (*at - silent_since).as_secs()))
        .collect();
    let [(State::Suspect, suspect), (State::Gone, gone)] = times[..] else {
        panic!("{times:?}");
    };
    // The first heartbeat that is missed is sent up to 2 s later; at the end it is dialled for 2 s.
    assert!((6..=8).contains(&suspect), "{suspect} s");
    assert!((12..=16).contains(&gone), "{gone} s");
}
