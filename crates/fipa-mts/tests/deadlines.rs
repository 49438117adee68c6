//! Letters whose answer is not wanted any more, and those who prefer a transport.
mod support;

use bytes::Bytes;
use fipa_acl::AgentId;
use fipa_directory::MESSAGE_TRANSPORT;
use fipa_link::Outcome;
use fipa_sim::{Habit, NodeId, Sim};

use support::{entry, millis, outcome, pair, reason, secs};

/// Submits a letter whose reply-by is so many milliseconds from now.
fn send_until(sim: &mut Sim, node: NodeId, to: &str, millis: i64) -> u64 {
    let letter = sim.letter("a", vec![AgentId::new(to)], Bytes::from("x"));
    let until = sim.now().unix_millis + millis;
    sim.submit_with(node, letter, secs(10), |submission| {
        submission.reply_by = Some(until);
    })
}

#[test]
fn a_letter_whose_reply_by_has_passed_is_not_sent() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    let program = sim.program("program", one);
    sim.run_for(millis(100));
    for node in [one, program] {
        for passed in [0, -1, -1_000_000, i64::MIN / 2] {
            let ticket = send_until(&mut sim, node, "b", passed);
            assert_eq!(outcome(&sim, node, ticket), Outcome::Expired);
            assert_eq!(reason(&sim, node, ticket), "reply-by has passed");
        }
        let ticket = send_until(&mut sim, node, "b", 1000);
        assert!(sim.run_until_quiet(secs(1)));
        assert_eq!(outcome(&sim, node, ticket), Outcome::Delivered);
    }
    assert_eq!(sim.contents(two, "b").len(), 2);
}

#[test]
fn a_letter_that_still_waits_when_reply_by_passes_expires_and_never_arrives() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.cut(one, two);
    sim.lose(one, two);
    sim.run_for(millis(10));
    let begun = sim.now().mono;
    let ticket = send_until(&mut sim, one, "b", 500);
    sim.run_for(secs(1));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Expired);
    let told = sim.collected(one).outcomes[&ticket].at;
    assert_eq!(told, begun + millis(500));
    sim.mend(one);
    sim.run_for(secs(20));
    assert!(sim.contents(two, "b").is_empty());
}

#[test]
fn a_letter_that_is_under_way_when_reply_by_passes_has_an_unknown_fate() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.freeze(two);
    let ticket = send_until(&mut sim, one, "b", 500);
    sim.run_for(secs(1));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Timeout);
}

#[test]
fn letters_behind_a_stalled_one_expire_and_the_stalled_one_times_out() {
    let mut sim = Sim::new(1);
    let (here, robot) = (sim.daemon("here"), sim.robot("robot"));
    sim.announce(
        robot,
        &entry("b", &[("tcp://robot:9999", MESSAGE_TRANSPORT)]),
    );
    sim.set_habit(robot, Habit::Stalls);
    let large = Bytes::from(vec![b'x'; 200_000]);
    let letter = sim.letter("a", vec![AgentId::new("b")], large);
    let until = sim.now().unix_millis + 600;
    let first = sim.submit_with(here, letter, secs(10), |s| s.reply_by = Some(until));
    let second = send_until(&mut sim, here, "b", 500);
    sim.run_for(secs(1));
    assert_eq!(outcome(&sim, here, first), Outcome::Timeout);
    let reason = reason(&sim, here, first);
    assert!(reason.contains("did not take the whole letter"), "{reason}");
    assert_eq!(outcome(&sim, here, second), Outcome::Expired);
    sim.set_habit(robot, Habit::Reads);
    sim.run_for(secs(5));
    assert_eq!(sim.robot_letters(robot), [] as [Bytes; 0]);
}

#[test]
fn the_senders_order_of_transports_goes_before_the_receivers() {
    let mut sim = Sim::new(1);
    let (here, robot) = (sim.daemon("here"), sim.robot("robot"));
    let places = ["udt://robot:1", "quic://robot:2", "tcp://nowhere:3"];
    sim.announce(
        robot,
        &entry("b", &places.map(|at| (at, MESSAGE_TRANSPORT))),
    );

    for (preferred, first) in [
        (&[][..], "udt"),
        (&["quic"], "quic"),
        (&["tcp", "quic"], "quic"),
    ] {
        let letter = sim.letter("a", vec![AgentId::new("b")], Bytes::new());
        let ticket = sim.submit_with(here, letter, secs(10), |submission| {
            submission.transports = preferred.iter().map(|t| (*t).into()).collect();
        });
        assert!(sim.run_until_quiet(secs(1)));
        let reason = reason(&sim, here, ticket);
        assert!(reason.starts_with(first), "{reason}");
        assert!(places.iter().all(|at| reason.contains(at)), "{reason}");
    }
}
