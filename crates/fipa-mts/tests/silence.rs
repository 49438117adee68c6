//! Peers that are there and say nothing, and networks that fall apart and come together.
mod support;

use fipa_directory::{ChangeKind, State};
use fipa_link::Outcome;
use fipa_mts::Notice;
use fipa_sim::{NodeId, Sim};

use support::{changes, fleet, millis, outcome, pair, reason, secs};

fn state(sim: &Sim, node: NodeId, name: &str) -> Option<State> {
    sim.directory(node).find(name).map(|record| record.state)
}

#[test]
fn a_letter_to_a_frozen_peer_times_out_at_its_deadline_and_names_the_peer() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.freeze(two);
    let begun = sim.now().mono;
    let ticket = sim.send_within(one, "a", &["b"], "", secs(4));
    sim.run_for(secs(5));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Timeout);
    assert_eq!(sim.collected(one).outcomes[&ticket].at, begun + secs(4));
    assert!(reason(&sim, one, ticket).contains("d1"));
}

#[test]
fn a_frozen_peer_is_suspect_after_three_heartbeats_and_alive_when_it_goes_on() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.freeze(two);
    let ticket = sim.send(one, "a", &["b"], "late");
    sim.run_for(secs(6));
    assert_eq!(state(&sim, one, "b"), Some(State::Alive));
    sim.run_for(millis(2500));
    assert_eq!(state(&sim, one, "b"), Some(State::Suspect));
    let suspect = sim.collected(one).notices.iter();
    let suspect = suspect.filter(|(_, n)| matches!(n, Notice::PeerSuspect { .. }));
    assert_eq!(suspect.count(), 1);
    sim.thaw(two);
    sim.run_for(millis(100));
    assert_eq!(state(&sim, one, "b"), Some(State::Alive));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
    assert_eq!(sim.contents(two, "b"), ["late"]);
    for (node, name) in [(one, "b"), (two, "a")] {
        assert_eq!(changes(&sim, node, ChangeKind::Removed, name), 0);
    }
}

#[test]
fn an_idle_peer_that_freezes_is_suspect_within_forty_seconds_and_gone_within_eighty() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.run_for(secs(100));
    sim.freeze(two);
    sim.run_for(secs(42));
    assert_eq!(state(&sim, one, "b"), Some(State::Suspect));
    sim.run_for(secs(40));
    assert_eq!(state(&sim, one, "b"), None);
    sim.thaw(two);
    sim.discover_all();
    sim.run_for(secs(3));
    assert_eq!(state(&sim, one, "b"), Some(State::Alive));
    assert_eq!(state(&sim, two, "a"), Some(State::Alive));
}

#[test]
fn a_caller_that_says_nothing_is_given_up_after_the_hello_timeout() {
    let mut sim = Sim::new(1);
    let (one, two) = (sim.daemon("one"), sim.daemon("two"));
    sim.freeze(two);
    sim.add_peer(one, sim.address(two));
    sim.run_for(millis(5100));
    let told = sim.collected(one).notices.iter().any(|(_, notice)| {
        matches!(notice, Notice::LinkFailed { reason, .. } if reason.contains("said nothing"))
    });
    assert!(told);
    sim.thaw(two);
    sim.run_for(secs(2));
    assert!(sim.mts(one).is_linked(sim.instance_of(two)));
    assert_eq!(sim.streams(one, two), 1);
}

#[test]
fn after_a_partition_entries_return_and_letters_are_delivered() {
    for seconds in [3, 30, 300] {
        let mut sim = Sim::new(seconds);
        let nodes = fleet(&mut sim, 4);
        for (n, node) in nodes.iter().enumerate() {
            sim.register(*node, &format!("agent{n}"));
        }
        sim.run_for(secs(1));
        let (left, right) = nodes.split_at(2);
        for one in left {
            for two in right {
                sim.cut(*one, *two);
            }
        }
        let lost = sim.send_within(nodes[0], "agent0", &["agent2"], "lost", secs(600));
        let kept = sim.send(nodes[0], "agent0", &["agent1"], "kept");
        sim.run_for(secs(seconds));
        assert_eq!(outcome(&sim, nodes[0], kept), Outcome::Delivered);
        left.iter().for_each(|node| sim.mend(*node));
        sim.discover_all();
        sim.run_for(secs(5));
        for node in &nodes {
            let names = ["agent0", "agent1", "agent2", "agent3"];
            assert_eq!(sim.names(*node), names, "after {seconds} s");
        }
        let told = outcome(&sim, nodes[0], lost);
        let got = sim.contents(nodes[2], "agent2").len();
        assert!(got <= 1);
        assert!(told != Outcome::Delivered || got == 1);
        assert!(seconds > 3 || told == Outcome::Delivered);
        let ticket = sim.send(nodes[3], "agent3", &["agent0"], "again");
        sim.run_for(millis(100));
        assert_eq!(outcome(&sim, nodes[3], ticket), Outcome::Delivered);
        assert_eq!(sim.contents(nodes[0], "agent0"), ["again"]);
    }
}

#[test]
fn seeds_alone_mend_a_partition() {
    for seconds in [3, 30, 300] {
        let mut sim = Sim::new(seconds);
        let (one, two) = (sim.daemon("one"), sim.daemon("two"));
        sim.register(one, "a");
        sim.register(two, "b");
        sim.add_peer(one, sim.address(two));
        sim.run_for(secs(1));
        sim.isolate(two);
        sim.send(one, "a", &["b"], "");
        sim.run_for(secs(seconds));
        sim.mend(two);
        sim.run_for(secs(6));
        assert_eq!(sim.names(one), ["a", "b"], "after {seconds} s");
        assert_eq!(sim.names(two), ["a", "b"], "after {seconds} s");
        let ticket = sim.send(two, "b", &["a"], "again");
        sim.run_for(millis(100));
        assert_eq!(outcome(&sim, two, ticket), Outcome::Delivered);
    }
}

#[test]
fn a_letter_that_arrived_before_the_break_is_not_delivered_again_after_the_peer_was_forgotten() {
    let mut sim = Sim::new(1);
    let (one, two) = (sim.daemon("one"), sim.daemon("two"));
    sim.register(one, "a");
    sim.register(two, "b");
    sim.add_peer(one, sim.address(two));
    sim.run_for(secs(1));
    let ticket = sim.send_within(one, "a", &["b"], "once", secs(60));
    // It has arrived; its receipt has not.
    sim.run_for(millis(1));
    assert_eq!(sim.contents(two, "b").len(), 1);
    // Two learns of the break at once and forgets one; one sleeps meanwhile, and calls again.
    sim.freeze(one);
    sim.reset(one, two);
    sim.run_for(secs(10));
    assert!(sim.directory(two).find("a").is_none());
    sim.thaw(one);
    sim.run_for(secs(5));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
    assert_eq!(sim.contents(two, "b"), ["once"]);
}
