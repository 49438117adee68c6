//! What is too much.
mod support;

use fipa_link::Outcome;
use fipa_sim::Sim;

use support::{millis, outcome, pair, reason, secs};

#[test]
fn a_full_mailbox_refuses_and_takes_letters_again_once_it_is_read() {
    let mut sim = Sim::new(1);
    let one = sim.daemon_with("one", |config| config.mailbox_letters = 2);
    sim.register(one, "b");
    sim.set_reading(one, false);
    let tickets: Vec<u64> = (0..3)
        .map(|n| sim.send(one, "a", &["b"], &format!("{n}")))
        .collect();
    assert_eq!(outcome(&sim, one, tickets[1]), Outcome::Delivered);
    assert_eq!(outcome(&sim, one, tickets[2]), Outcome::Refused);
    assert_eq!(reason(&sim, one, tickets[2]), "the agent's mailbox is full");
    sim.set_reading(one, true);
    assert_eq!(sim.contents(one, "b"), ["0", "1"]);
    let again = sim.send(one, "a", &["b"], "3");
    assert_eq!(outcome(&sim, one, again), Outcome::Delivered);
}

#[test]
fn a_full_mailbox_of_a_program_far_away_refuses() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    let p = sim.program_with("p", two, |config| config.mailbox_letters = 1);
    sim.register(p, "p");
    sim.set_reading(p, false);
    sim.run_for(millis(100));
    let first = sim.send(one, "a", &["p"], "");
    let second = sim.send(one, "a", &["p"], "");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, one, first), Outcome::Delivered);
    assert_eq!(outcome(&sim, one, second), Outcome::Refused);
}

#[test]
fn a_letter_larger_than_the_peer_takes_is_refused_and_the_link_stays() {
    let mut sim = Sim::new(1);
    let one = sim.daemon("one");
    let two = sim.daemon_with("two", |config| config.max_letter = 1000);
    sim.register(two, "b");
    sim.add_peer(one, sim.address(two));
    sim.run_for(millis(100));
    let large = sim.send(one, "a", &["b"], &"x".repeat(200_000));
    let small = sim.send(one, "a", &["b"], "small");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, one, large), Outcome::Refused);
    let reason = reason(&sim, one, large);
    assert!(reason.contains("larger than the 1000"), "{reason}");
    assert_eq!(outcome(&sim, one, small), Outcome::Delivered);
    assert_eq!(sim.collected(one).dials.len(), 1);
}

#[test]
fn a_letter_larger_than_the_daemon_takes_is_refused_and_the_program_stays() {
    let mut sim = Sim::new(1);
    let one = sim.daemon_with("one", |config| config.max_letter = 1000);
    let p = sim.program("p", one);
    sim.register(p, "p");
    let early = sim.send(p, "p", &["p"], &"x".repeat(200_000));
    sim.run_for(millis(100));
    let large = sim.send(p, "p", &["p"], &"x".repeat(200_000));
    let small = sim.send(p, "p", &["p"], "small");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, p, early), Outcome::Refused);
    assert_eq!(outcome(&sim, p, large), Outcome::Refused);
    assert_eq!(outcome(&sim, p, small), Outcome::Delivered);
    assert_eq!(sim.collected(p).dials.len(), 1);
}

#[test]
fn a_letter_larger_than_the_program_takes_is_refused_and_the_program_stays() {
    let mut sim = Sim::new(1);
    let one = sim.daemon("one");
    let p = sim.program_with("p", one, |config| config.max_letter = 1000);
    sim.register(p, "p");
    sim.run_for(millis(100));
    let large = sim.send(one, "a", &["p"], &"x".repeat(200_000));
    let small = sim.send(one, "a", &["p"], "small");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, one, large), Outcome::Refused);
    assert_eq!(outcome(&sim, one, small), Outcome::Delivered);
    assert_eq!(sim.collected(p).dials.len(), 1);
}

#[test]
fn what_waits_for_a_peer_is_bounded() {
    let mut sim = Sim::new(1);
    let one = sim.daemon_with("one", |config| config.queue_octets = 10_000);
    let two = sim.daemon("two");
    sim.register(two, "b");
    sim.add_peer(one, sim.address(two));
    sim.run_for(secs(1));
    sim.crash(two);
    sim.run_for(millis(10));
    let tickets: Vec<u64> = (0..20)
        .map(|_| sim.send(one, "a", &["b"], &"x".repeat(1000)))
        .collect();
    let refused = tickets.iter().filter(|t| sim.told(one, **t).is_some());
    // Who sends them all leaves room for others.
    assert_eq!(refused.count(), 15);
    sim.run_for(secs(3));
    for ticket in tickets {
        assert!(!outcome(&sim, one, ticket).is_success());
    }
    assert_eq!(sim.mts(one).letters_under_way(), 0);
}
