//! Agents of other makes in the directory.
mod support;

use fipa_acl::Text;
use fipa_directory::{ChangeKind, MESSAGE_TRANSPORT, Source};
use fipa_link::Outcome;
use fipa_sim::{NodeId, Sim};

use support::{changes, entry, fleet, millis, outcome, secs};

fn count(sim: &Sim, node: NodeId, name: &str) -> usize {
    let names = sim.names(node);
    names.iter().filter(|known| *known == name).count()
}

#[test]
fn an_agent_of_another_make_is_known_here_and_to_programs_and_is_told_to_no_daemon() {
    let mut sim = Sim::new(1);
    let here = sim.daemon("here");
    let program = sim.program("program", here);
    let robot = sim.robot("robot");
    sim.announce(
        robot,
        &entry("b", &[("tcp://robot:9999", MESSAGE_TRANSPORT)]),
    );
    sim.run_for(millis(100));
    for node in [here, program] {
        let record = sim.directory(node).find("b").unwrap();
        assert_eq!(record.source, Source::Mdns);
        assert!(record.owner.to_string().starts_with("0000000000000000"));
    }
    // Another daemon, which has not heard of it, is not told of it either.
    let there = sim.daemon("there");
    sim.add_peer(here, sim.address(there));
    sim.run_for(secs(1));
    assert!(sim.mts(here).is_linked(sim.instance_of(there)));
    assert_eq!(count(&sim, there, "b"), 0);
    sim.withdraw(robot, "b");
    sim.run_for(millis(100));
    for node in [here, program] {
        assert_eq!(count(&sim, node, "b"), 0);
    }
}

#[test]
fn a_program_sends_to_an_agent_of_another_make_through_its_daemon() {
    let mut sim = Sim::new(1);
    let here = sim.daemon("here");
    let program = sim.program("program", here);
    let robot = sim.robot("robot");
    sim.register(program, "p");
    sim.announce(
        robot,
        &entry("b", &[("tcp://robot:9999", MESSAGE_TRANSPORT)]),
    );
    sim.run_for(millis(100));
    let exact = sim.send(program, "p", &["b"], "");
    let pattern = sim.send(program, "p", &["[a-c]"], "");
    assert!(sim.run_until_quiet(secs(1)));
    for ticket in [exact, pattern] {
        assert_eq!(outcome(&sim, program, ticket), Outcome::Sent);
    }
    assert_eq!(sim.robot_letters(robot).len(), 2);
}

#[test]
fn what_a_link_brings_from_the_same_address_is_one_entry_whoever_comes_first() {
    for announced_first in [true, false] {
        let mut sim = Sim::new(1);
        let (here, there) = (sim.daemon("here"), sim.daemon("there"));
        let robot = sim.robot("robot");
        sim.register(here, "a");
        sim.register(there, "b");
        let same = entry("b", &[("tcp://there:4100", MESSAGE_TRANSPORT)]);
        if announced_first {
            sim.announce(robot, &same);
        }
        sim.add_peer(here, sim.address(there));
        sim.run_for(secs(1));
        if !announced_first {
            sim.announce(robot, &same);
        }
        for (node, source) in [(here, Source::Peer), (there, Source::Local)] {
            assert_eq!(count(&sim, node, "b"), 1);
            assert_eq!(sim.directory(node).find("b").unwrap().source, source);
        }
        assert_eq!(changes(&sim, here, ChangeKind::Conflict, "b"), 0);
        let ticket = sim.send(here, "a", &["b"], "by link");
        assert!(sim.run_until_quiet(secs(1)));
        assert_eq!(outcome(&sim, here, ticket), Outcome::Delivered);
        // The link's entry goes, and the announcement still holds.
        sim.crash(there);
        sim.run_for(secs(10));
        assert_eq!(count(&sim, here, "b"), 1);
        assert_eq!(sim.directory(here).find("b").unwrap().source, Source::Mdns);
    }
}

#[test]
fn an_agent_announced_at_the_address_of_a_linked_daemon_is_reached_over_the_link() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 2);
    let robot = sim.robot("robot");
    sim.announce(
        robot,
        &entry("late", &[("tcp://d1:4100", MESSAGE_TRANSPORT)]),
    );
    sim.forget(nodes[0]);
    let ticket = sim.send(nodes[0], "a", &["late"], "");
    assert!(sim.run_until_quiet(secs(1)));
    assert_eq!(outcome(&sim, nodes[0], ticket), Outcome::Unknown);
    assert_eq!(sim.collected(nodes[0]).dials, []);
}

#[test]
fn a_stranger_with_a_name_that_is_registered_here_is_a_conflict_and_changes_nothing() {
    for registered_first in [true, false] {
        let mut sim = Sim::new(1);
        let here = sim.daemon("here");
        let robot = sim.robot("robot");
        let stranger = entry("a", &[("tcp://robot:9999", MESSAGE_TRANSPORT)]);
        if registered_first {
            sim.register(here, "a");
        }
        sim.announce(robot, &stranger);
        if !registered_first {
            sim.register(here, "a");
        }
        sim.run_for(secs(2));
        assert_eq!(changes(&sim, here, ChangeKind::Conflict, "a"), 1);
        assert_eq!(count(&sim, here, "a"), 2);
        let record = sim.directory(here).find("a").unwrap();
        assert_eq!(record.source, Source::Local);
        let ticket = sim.send(here, "x", &["a"], "mine");
        assert_eq!(outcome(&sim, here, ticket), Outcome::Delivered);
        assert_eq!(sim.contents(here, "a"), ["mine"]);
        assert_eq!(sim.robot_accepted(robot), 0);
    }
}

#[test]
fn an_entry_that_moves_is_changed_and_letters_go_to_its_new_place() {
    let mut sim = Sim::new(1);
    let here = sim.daemon("here");
    let robots = [sim.robot("one"), sim.robot("two")];
    for (n, address) in ["tcp://one:9999", "tcp://two:9999"].into_iter().enumerate() {
        sim.announce(robots[n], &entry("b", &[(address, MESSAGE_TRANSPORT)]));
        let ticket = sim.send(here, "a", &["b"], "");
        assert!(sim.run_until_quiet(secs(1)));
        let via = sim.outcomes(here, ticket)[0].via.clone();
        assert_eq!(via, Some(Text::from(address)));
        assert_eq!(sim.robot_letters(robots[n]).len(), 1);
    }
    assert_eq!(changes(&sim, here, ChangeKind::Changed, "b"), 1);
    assert_eq!(changes(&sim, here, ChangeKind::Removed, "b"), 0);
}
