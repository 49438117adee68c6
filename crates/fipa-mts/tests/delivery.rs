//! From a sender to receivers by name, pattern and address.
mod support;

use std::collections::BTreeSet;

use bytes::Bytes;
use fipa_acl::AgentId;
use fipa_link::Outcome;
use fipa_sim::Sim;

use support::{fleet, outcome, pair, reason, secs};

#[test]
fn a_message_between_two_daemons_is_delivered_and_names_the_address() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    let there = sim.send(one, "a", &["b"], "to b");
    let back = sim.send(two, "b", &["a"], "to a");
    assert!(sim.run_until_quiet(secs(1)));
    assert_eq!(sim.contents(two, "b"), ["to b"]);
    assert_eq!(sim.contents(one, "a"), ["to a"]);
    for (node, ticket, to, peer) in [(one, there, "b", two), (two, back, "a", one)] {
        let told = &sim.outcomes(node, ticket)[0];
        assert_eq!((told.to.as_str(), told.outcome), (to, Outcome::Delivered));
        assert_eq!(told.via, Some(sim.address(peer).to_text()));
        assert!(told.reason.is_empty());
    }
}

#[test]
fn a_delivered_letter_bears_the_stamp_of_each_service_and_its_payload_as_it_was() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.send(one, "a", &["b"], "unchanged");
    assert!(sim.run_until_quiet(secs(1)));
    let letter = &sim.collected(two).mail["b"][0];
    let stamps: Vec<_> = letter.envelope.stamps().map(|s| s.by.as_str()).collect();
    assert_eq!(stamps, ["d0", "d1"]);
    let last = letter.envelope.stamps().last().unwrap();
    assert_eq!(last.from.as_deref(), Some("d0"));
    assert_eq!(letter.payload, "unchanged");
}

#[test]
fn a_name_that_nobody_has_is_unknown() {
    let mut sim = Sim::new(1);
    let (one, _) = pair(&mut sim);
    let ticket = sim.send(one, "a", &["nobody"], "");
    assert_eq!(outcome(&sim, one, ticket), Outcome::Unknown);
    assert_eq!(reason(&sim, one, ticket), "no agent of this name is known");
}

#[test]
fn an_exact_name_wins_over_the_pattern_that_it_is() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.register(two, "r.bot");
    sim.register(two, "robot");
    sim.run_for(secs(1));
    let ticket = sim.send(one, "a", &["r.bot"], "exact");
    assert!(sim.run_until_quiet(secs(1)));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
    assert_eq!(sim.contents(two, "r.bot"), ["exact"]);
    assert!(sim.contents(two, "robot").is_empty());
}

#[test]
fn a_pattern_reaches_every_agent_once_and_not_the_sender() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 5);
    for agent in 0..50 {
        sim.register(nodes[agent % 5], &format!("agent{agent}"));
    }
    sim.run_for(secs(1));
    let ticket = sim.send(nodes[0], "agent0", &[".*"], "all");
    assert!(sim.run_until_quiet(secs(1)));
    let outcomes = sim.outcomes(nodes[0], ticket);
    assert!(outcomes.iter().all(|o| o.outcome == Outcome::Delivered));
    let told: BTreeSet<_> = outcomes.iter().map(|o| o.to.as_str()).collect();
    assert_eq!((outcomes.len(), told.len()), (49, 49));
    for agent in 0..50 {
        let got = sim.contents(nodes[agent % 5], &format!("agent{agent}"));
        assert_eq!(got.len(), usize::from(agent != 0), "agent{agent}");
    }
}

#[test]
fn a_pattern_that_matches_the_sender_only_reaches_nobody() {
    let mut sim = Sim::new(1);
    let (one, _) = pair(&mut sim);
    let ticket = sim.send(one, "a", &["a+"], "");
    assert_eq!(outcome(&sim, one, ticket), Outcome::Unknown);
    let reason = reason(&sim, one, ticket);
    assert!(reason.contains("nobody but the sender"), "{reason}");
}

#[test]
fn a_receiver_that_is_named_twice_gets_the_letter_once() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    let ticket = sim.send(one, "a", &["b", "b", "b.*", "a"], "once");
    assert!(sim.run_until_quiet(secs(1)));
    let told: Vec<_> = sim.outcomes(one, ticket).iter().map(|o| &o.to).collect();
    assert_eq!(told, ["b", "a"]);
    assert_eq!(sim.contents(two, "b"), ["once"]);
    assert_eq!(sim.contents(one, "a"), ["once"]);
}

#[test]
fn a_bad_regular_expression_says_so() {
    let mut sim = Sim::new(1);
    let (one, _) = pair(&mut sim);
    let ticket = sim.send(one, "a", &["b["], "");
    assert_eq!(outcome(&sim, one, ticket), Outcome::Unknown);
    let reason = reason(&sim, one, ticket);
    assert!(reason.contains("is no regular expression"), "{reason}");
}

#[test]
fn a_letter_without_receiver_says_so() {
    let mut sim = Sim::new(1);
    let (one, _) = pair(&mut sim);
    let ticket = sim.send(one, "a", &[], "");
    assert_eq!(outcome(&sim, one, ticket), Outcome::Unknown);
    assert_eq!(reason(&sim, one, ticket), "the envelope names no receiver");
}

#[test]
fn an_unknown_receiver_is_reached_at_the_addresses_that_it_brings() {
    let mut sim = Sim::new(1);
    let (one, two) = (sim.daemon("one"), sim.daemon("two"));
    sim.register(one, "a");
    sim.register(two, "b");
    let receiver = AgentId::new("b").address("tcp://two:4100");
    for text in ["first", "second"] {
        let letter = sim.letter("a", vec![receiver.clone()], Bytes::from(text));
        let ticket = sim.submit(one, letter, secs(10));
        assert!(sim.run_until_quiet(secs(1)));
        assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
    }
    assert_eq!(sim.contents(two, "b"), ["first", "second"]);
    assert_eq!(sim.collected(one).dials.len(), 1);
}

#[test]
fn an_address_where_nobody_listens_ends_in_a_timeout_that_says_why() {
    let mut sim = Sim::new(1);
    let one = sim.daemon("one");
    let receiver = AgentId::new("b").address("tcp://two:4100");
    let letter = sim.letter("a", vec![receiver], Bytes::new());
    let begun = sim.now().mono;
    let ticket = sim.submit(one, letter, secs(5));
    assert!(sim.run_until_quiet(secs(20)));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Timeout);
    let reason = reason(&sim, one, ticket);
    assert!(reason.contains("connection refused"), "{reason}");
    assert_eq!(sim.collected(one).outcomes[&ticket].at, begun + secs(5));
    // Nobody is dialled when no letter waits.
    sim.run_for(secs(10));
    sim.forget(one);
    sim.run_for(secs(60));
    assert_eq!(sim.collected(one).dials, []);
}

#[test]
fn a_receiver_at_our_own_address_that_nobody_has_is_unknown() {
    let mut sim = Sim::new(1);
    let own = "tcp://one:4100".parse().unwrap();
    let other = "tcp://localhost:4100".parse().unwrap();
    let one = sim.daemon_with("one", |config| config.endpoints = vec![own, other]);
    for address in ["tcp://one:4100", "tcp://localhost:4100"] {
        let receiver = AgentId::new("b").address(address);
        let letter = sim.letter("a", vec![receiver], Bytes::new());
        let ticket = sim.submit(one, letter, secs(5));
        assert_eq!(outcome(&sim, one, ticket), Outcome::Unknown);
    }
}
