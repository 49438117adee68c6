//! Queues that are full: who waits, who does not, and who goes first.
mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, Letter, Text};
use fipa_link::Outcome;
use fipa_sim::{Network, NodeId, Sim};

use support::{millis, outcome, pair, reason, secs};

/// Sends a letter that waits for room; its ticket.
fn send_patiently(sim: &mut Sim, node: NodeId, from: &str, to: &str, content: &str) -> u64 {
    let payload = Bytes::from(content.to_owned());
    let letter = sim.letter(from, vec![AgentId::new(to)], payload);
    sim.submit_with(node, letter, secs(10), |submission| {
        submission.patient = true
    })
}

fn urgent(mut letter: Letter, priority: &str) -> Letter {
    let priority = (Text::from("Priority"), Text::from(priority));
    letter.envelope.base.user_defined.push(priority);
    letter
}

/// Two daemons with the agents `a`, `c` and `b`, with a thin line between them.
fn thin_line(sim: &mut Sim) -> (NodeId, NodeId) {
    sim.set_network(Network {
        octets_per_second: Some(1 << 20),
        ..Network::default()
    });
    pair(sim)
}

#[test]
fn a_patient_letter_waits_for_room_in_a_mailbox_and_keeps_its_order() {
    for far in [false, true] {
        let mut sim = Sim::new(1);
        let one = sim.daemon_with("one", |config| config.mailbox_letters = 2);
        let two = sim.daemon("two");
        sim.register(one, "b");
        sim.register(one, "c");
        sim.add_peer(two, sim.address(one));
        sim.run_for(secs(1));
        sim.set_reading(one, false);
        let from = if far { two } else { one };
        let tickets: Vec<u64> = (0..6)
            .map(|n| send_patiently(&mut sim, from, "a", "b", &format!("{n}")))
            .collect();
        // Whoever waits for room at one agent keeps nobody else from another.
        let other = send_patiently(&mut sim, from, "a", "c", "other");
        sim.run_for(secs(1));
        assert_eq!(outcome(&sim, from, other), Outcome::Delivered);
        assert_eq!(outcome(&sim, from, tickets[1]), Outcome::Delivered);
        assert!(sim.told(from, tickets[2]).is_none());
        sim.set_reading(one, true);
        sim.run_for(secs(2));
        assert_eq!(sim.contents(one, "b"), ["0", "1", "2", "3", "4", "5"]);
        for ticket in tickets {
            assert_eq!(outcome(&sim, from, ticket), Outcome::Delivered);
        }
        assert_eq!(sim.mts(from).letters_under_way(), 0);
    }
}

#[test]
fn a_patient_letter_for_which_no_room_comes_is_refused_at_its_deadline() {
    let mut sim = Sim::new(1);
    let one = sim.daemon_with("one", |config| config.mailbox_letters = 1);
    sim.register(one, "b");
    sim.set_reading(one, false);
    let first = send_patiently(&mut sim, one, "a", "b", "first");
    let second = send_patiently(&mut sim, one, "a", "b", "second");
    let begun = sim.now().mono;
    sim.run_for(secs(11));
    assert_eq!(outcome(&sim, one, first), Outcome::Delivered);
    assert_eq!(outcome(&sim, one, second), Outcome::Refused);
    assert_eq!(reason(&sim, one, second), "the agent's mailbox is full");
    assert_eq!(sim.collected(one).outcomes[&second].at, begun + secs(10));
    assert_eq!(sim.mts(one).letters_under_way(), 0);
}

#[test]
fn a_program_waits_for_room_at_its_daemon() {
    let mut sim = Sim::new(1);
    let one = sim.daemon_with("one", |config| config.mailbox_letters = 1);
    sim.register(one, "b");
    let p = sim.program("p", one);
    sim.run_for(millis(100));
    sim.set_reading(one, false);
    let tickets = [1, 2].map(|n| sim.send(p, "p", &["b"], &format!("{n}")));
    sim.run_for(secs(1));
    assert!(sim.told(p, tickets[1]).is_none());
    sim.set_reading(one, true);
    sim.run_for(secs(1));
    assert_eq!(outcome(&sim, p, tickets[1]), Outcome::Delivered);
    assert_eq!(sim.contents(one, "b"), ["1", "2"]);
}

#[test]
fn an_agent_that_floods_a_slow_peer_delays_no_other_agent_much() {
    let mut sim = Sim::new(1);
    let (one, two) = thin_line(&mut sim);
    let bulk = "x".repeat(64 << 10);
    // Eight seconds on the line.
    let flood: Vec<u64> = (0..128)
        .map(|_| sim.send(one, "a", &["b"], &bulk))
        .collect();
    let begun = sim.now().mono;
    let calm = sim.send(one, "c", &["b"], "calm");
    sim.run_for(secs(30));
    let taken = sim.collected(one).outcomes[&calm].at - begun;
    assert!(taken < millis(1500), "{taken:?}");
    assert_eq!(outcome(&sim, one, calm), Outcome::Delivered);
    let delivered = flood
        .iter()
        .filter(|t| outcome(&sim, one, **t) == Outcome::Delivered);
    assert!(delivered.count() > 100);
    assert!(!sim.contents(two, "b").is_empty());
}

#[test]
fn urgent_letters_pass_those_that_wait_for_the_same_peer_and_keep_their_order() {
    let mut sim = Sim::new(1);
    let (one, two) = thin_line(&mut sim);
    let bulk = "x".repeat(1 << 20);
    for _ in 0..4 {
        sim.send(one, "a", &["b"], &bulk);
    }
    for (content, priority) in [
        ("usual", "0"),
        ("first", "2"),
        ("higher", "1"),
        ("second", "2"),
    ] {
        let payload = Bytes::from_static(content.as_bytes());
        let letter = sim.letter("a", vec![AgentId::new("b")], payload);
        sim.submit(one, urgent(letter, priority), secs(10));
    }
    sim.run_for(secs(20));
    let order: Vec<String> = sim
        .contents(two, "b")
        .into_iter()
        .map(|content| content.chars().take(6).collect())
        .collect();
    let bulk = "xxxxxx";
    assert_eq!(
        order,
        [bulk, "first", "second", "higher", bulk, bulk, bulk, "usual"]
    );
}

#[test]
fn a_peer_that_reads_nothing_delays_no_other_peer() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    let three = sim.daemon("d2");
    sim.register(three, "c");
    sim.add_peer(one, sim.address(three));
    sim.run_for(secs(1));
    sim.freeze(two);
    for _ in 0..1000 {
        sim.send(one, "a", &["b"], &"x".repeat(10_000));
    }
    let ticket = sim.send(one, "a", &["c"], "hello");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
    sim.run_for(secs(20));
    assert_eq!(sim.mts(one).letters_under_way(), 0);
}
