//! The simulated network behaves like one.

use std::time::Duration;

use bytes::Bytes;
use fipa_acl::AgentId;
use fipa_sim::{Network, NodeId, Sim};

const fn millis(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

fn linked(sim: &mut Sim) -> [NodeId; 2] {
    let nodes = [sim.daemon("one"), sim.daemon("two")];
    sim.register(nodes[0], "a");
    sim.register(nodes[1], "b");
    sim.add_peer(nodes[0], sim.address(nodes[1]));
    sim.run_for(millis(500));
    nodes
}

#[test]
fn a_letter_travels_for_the_latency_of_its_way() {
    let mut sim = Sim::new(1);
    sim.set_network(Network {
        latency: millis(20),
        ..Network::default()
    });
    let [one, two] = linked(&mut sim);
    let begun = sim.now().mono;
    let ticket = sim.send(one, "a", &["b"], "");
    sim.run_for(millis(19));
    assert!(sim.contents(two, "b").is_empty());
    sim.run_for(millis(1));
    assert_eq!(sim.contents(two, "b").len(), 1);
    sim.run_for(millis(50));
    let told = sim.collected(one).outcomes[&ticket].at;
    assert_eq!(told - begun, millis(40));
}

#[test]
fn letters_stay_in_order_whatever_the_jitter() {
    let mut sim = Sim::new(7);
    sim.set_network(Network {
        jitter: millis(30),
        split: true,
        ..Network::default()
    });
    let [one, two] = linked(&mut sim);
    for n in 0..100 {
        sim.send(one, "a", &["b"], &n.to_string());
        sim.run_for(millis(1));
    }
    assert!(sim.run_until_quiet(Duration::from_secs(5)));
    let expected: Vec<String> = (0..100).map(|n| n.to_string()).collect();
    assert_eq!(sim.contents(two, "b"), expected);
}

#[test]
fn who_is_gone_refuses_and_who_is_cut_off_does_not_answer() {
    for (cut, expected) in [(false, "connection refused"), (true, "no answer")] {
        let mut sim = Sim::new(1);
        let nodes = [sim.daemon("one"), sim.daemon("two")];
        if cut {
            sim.isolate(nodes[1]);
        } else {
            sim.crash(nodes[1]);
        }
        let receiver = AgentId::new("b").address("tcp://two:4100");
        let letter = sim.letter("a", vec![receiver], Bytes::new());
        let ticket = sim.submit(nodes[0], letter, millis(5000));
        sim.run_for(millis(2900));
        // The first dial has not come to an end, or has been followed by others.
        let dials = sim.collected(nodes[0]).dials.len();
        assert_eq!(dials == 1, cut, "{dials}");
        sim.run_for(millis(2200));
        let reason = &sim.outcomes(nodes[0], ticket)[0].reason;
        assert!(reason.contains(expected), "{reason}");
    }
}

#[test]
fn what_was_sent_into_a_cut_arrives_when_it_is_mended() {
    let mut sim = Sim::new(1);
    let [one, two] = linked(&mut sim);
    sim.cut(one, two);
    let ticket = sim.send(one, "a", &["b"], "");
    sim.run_for(Duration::from_secs(3));
    assert!(sim.told(one, ticket).is_none());
    sim.mend(one);
    sim.run_for(millis(10));
    assert!(sim.told(one, ticket).is_some());
    assert_eq!(sim.contents(two, "b").len(), 1);
}

#[test]
fn a_slow_network_takes_its_time() {
    let mut sim = Sim::new(1);
    sim.set_network(Network {
        octets_per_second: Some(1_000_000),
        ..Network::default()
    });
    let [one, two] = linked(&mut sim);
    sim.send(one, "a", &["b"], &"x".repeat(2_000_000));
    sim.run_for(millis(1990));
    assert!(sim.contents(two, "b").is_empty());
    sim.run_for(millis(20));
    assert_eq!(sim.contents(two, "b").len(), 1);
}

#[test]
fn a_hundred_daemons_meet_in_moments() {
    let mut sim = Sim::new(1);
    let nodes: Vec<NodeId> = (0..100).map(|n| sim.daemon(&format!("d{n}"))).collect();
    for (n, node) in nodes.iter().enumerate() {
        sim.register(*node, &format!("agent{n}"));
    }
    sim.discover_all();
    sim.run_for(Duration::from_secs(1));
    for node in &nodes {
        assert_eq!(sim.names(*node).len(), 100);
    }
}
