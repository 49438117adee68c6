//! Links between daemons: made, doubled, broken, made again.
mod support;

use std::time::Duration;

use fipa_directory::{ChangeKind, Entry};
use fipa_link::{DirectoryFrame, DirectoryItem, Frame, Outcome, Role};
use fipa_mts::{Machine, Notice, Output, RegisterError, Registration};
use fipa_sim::{Network, NodeId, Sim};

use support::{PARTNER, Raw, changes, millis, outcome, pair, reason, secs};

fn linked(sim: &Sim, one: NodeId, two: NodeId) -> bool {
    sim.mts(one).is_linked(sim.instance_of(two)) && sim.mts(two).is_linked(sim.instance_of(one))
}

fn gone(sim: &Sim, node: NodeId) -> usize {
    let notices = sim.collected(node).notices.iter();
    notices
        .filter(|(_, n)| matches!(n, Notice::PeerGone { .. }))
        .count()
}

/// Two daemons that dial each other in the same moment, with letters sent meanwhile.
fn both_dial(seed: u64) {
    let mut sim = Sim::new(seed);
    sim.set_network(Network {
        latency: millis(3),
        jitter: millis(20),
        split: true,
        octets_per_second: None,
    });
    let (one, two) = (sim.daemon("one"), sim.daemon("two"));
    sim.register(one, "a");
    sim.register(two, "b");
    sim.add_peer(one, sim.address(two));
    sim.add_peer(two, sim.address(one));
    let mut sent = Vec::new();
    for n in 0..60 {
        sim.run_for(millis(5));
        for (node, from, to) in [(one, "a", "b"), (two, "b", "a")] {
            if sim.directory(node).find(to).is_some() {
                sent.push((node, sim.send(node, from, &[to], &format!("{n}"))));
            }
        }
    }
    assert!(sim.run_until_quiet(secs(5)), "seed {seed}");
    assert!(sent.len() > 40);
    for (node, ticket) in &sent {
        assert_eq!(outcome(&sim, *node, *ticket), Outcome::Delivered);
    }
    let got = sim.contents(one, "a").len() + sim.contents(two, "b").len();
    assert_eq!(got, sent.len(), "seed {seed}");
    assert_eq!(sim.streams(one, two), 1, "seed {seed}");
    for (node, name) in [(one, "b"), (two, "a")] {
        assert_eq!(changes(&sim, node, ChangeKind::Added, name), 1);
        assert_eq!(changes(&sim, node, ChangeKind::Changed, name), 0);
        assert_eq!(changes(&sim, node, ChangeKind::Removed, name), 0);
    }
    // And there it stays.
    sim.forget(one);
    sim.forget(two);
    sim.run_for(secs(120));
    assert_eq!(sim.collected(one).dials, []);
    assert_eq!(sim.collected(two).dials, []);
    assert!(linked(&sim, one, two));
}

#[test]
fn two_daemons_that_dial_each_other_end_with_one_link_and_lose_nothing() {
    (0..100).for_each(both_dial);
}

#[test]
fn discovery_makes_one_link_however_often_it_is_told() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    for _ in 0..5 {
        sim.discover_all();
        sim.run_for(millis(100));
    }
    assert!(linked(&sim, one, two));
    assert_eq!(sim.streams(one, two), 1);
    assert_eq!(sim.collected(one).dials, []);
}

#[test]
fn a_daemon_that_is_its_own_peer_notices_and_dials_itself_once() {
    let mut sim = Sim::new(1);
    let one = sim.daemon("one");
    sim.add_peer(one, sim.address(one));
    sim.run_for(secs(300));
    assert_eq!(sim.collected(one).dials.len(), 1);
    assert_eq!(sim.streams(one, one), 0);
    assert!(sim.run_until_quiet(secs(1)));
}

#[test]
fn daemons_of_different_scopes_have_no_link() {
    let mut sim = Sim::new(1);
    let one = sim.daemon_with("one", |config| config.scope = "red".into());
    let two = sim.daemon_with("two", |config| config.scope = "blue".into());
    sim.register(two, "b");
    sim.add_peer(one, sim.address(two));
    sim.run_for(secs(60));
    assert!(!sim.mts(one).is_linked(sim.instance_of(two)));
    assert!(!sim.mts(two).is_linked(sim.instance_of(one)));
    assert!(sim.directory(one).is_empty());
    let dials = sim.collected(one).dials.len();
    assert!((8..15).contains(&dials), "{dials} dials in a minute");
    sim.run_for(secs(3600));
    let told = sim.collected(one).notices.iter().filter(|(_, notice)| {
        matches!(notice, Notice::LinkFailed { reason, .. } if reason.contains("another scope"))
    });
    assert_eq!(told.count(), 1, "{:?}", sim.collected(one).notices);
    let dials = sim.collected(one).dials.len();
    assert!((60..140).contains(&dials), "{dials} dials in an hour");
}

#[test]
fn the_agents_of_a_crashed_daemon_leave_after_the_grace() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    let crashed = sim.now().mono;
    sim.crash(two);
    // Before anybody has noticed.
    let ticket = sim.send(one, "a", &["b"], "");
    sim.run_for(millis(1900));
    assert!(sim.directory(one).find("b").is_some());
    assert_eq!(changes(&sim, one, ChangeKind::Changed, "b"), 1, "suspect");
    sim.run_for(millis(200));
    assert!(sim.directory(one).find("b").is_none());
    assert_eq!(outcome(&sim, one, ticket), Outcome::Timeout);
    assert!(reason(&sim, one, ticket).contains("d1 is gone"));
    let told = sim.collected(one).outcomes[&ticket].at - crashed;
    assert!(told < millis(2100), "{told:?}");
    // mDNS still announces it, so the network is asked, and it is forgotten.
    sim.run_for(secs(2));
    sim.forget(one);
    sim.run_for(secs(60));
    assert_eq!(sim.collected(one).dials, []);
}

#[test]
fn a_restarted_daemon_is_back_within_a_second_by_its_peers_seed() {
    let mut sim = Sim::new(1);
    let (one, two) = (sim.daemon("one"), sim.daemon("two"));
    sim.add_peer(one, sim.address(two));
    for pause in [millis(0), millis(500), secs(1), secs(5), secs(120)] {
        sim.register(two, "b");
        sim.run_for(secs(5));
        assert!(sim.directory(one).find("b").is_some());
        sim.crash(two);
        sim.run_for(pause);
        sim.restart(two);
        sim.register(two, "b");
        // The pause between two dials is two seconds at most.
        let within = if pause < secs(2) {
            millis(1000)
        } else {
            millis(2010)
        };
        sim.run_for(within);
        let found = sim.directory(one).find("b").map(|record| record.owner);
        assert_eq!(found, Some(sim.instance_of(two)), "after {pause:?}");
        assert_eq!(sim.names(one), ["b"], "after {pause:?}");
    }
}

#[test]
fn a_restarted_daemon_is_back_within_a_second_by_discovery() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.crash(two);
    sim.run_for(secs(30));
    assert_eq!(sim.names(one), ["a"]);
    sim.restart(two);
    sim.register(two, "b");
    sim.discover(two);
    sim.run_for(secs(1));
    assert_eq!(sim.names(one), ["a", "b"]);
}

#[test]
fn a_restart_within_the_grace_replaces_the_run_before() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.restart(two);
    sim.register(two, "b2");
    sim.run_for(millis(100));
    assert_eq!(sim.names(one), ["a", "b2"]);
}

#[test]
fn a_daemon_that_lost_its_power_is_back_as_soon_as_it_is() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.power_off(two);
    sim.run_for(secs(3));
    assert_eq!(sim.names(one), ["a", "b"], "nobody knows yet");
    sim.restart(two);
    sim.register(two, "b");
    sim.add_peer(two, sim.address(one));
    sim.run_for(millis(100));
    let ticket = sim.send(one, "a", &["b"], "hello");
    sim.run_for(millis(500));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
    assert_eq!(sim.contents(two, "b"), ["hello"]);
    assert_eq!(sim.names(one), ["a", "b"]);
}

#[test]
fn a_link_that_breaks_and_comes_back_changes_no_entry_and_loses_no_letter() {
    for delay in 0..12 {
        let mut sim = Sim::new(delay);
        let (one, two) = pair(&mut sim);
        let tickets: Vec<u64> = (0..20)
            .map(|n| {
                sim.run_for(Duration::from_micros(300));
                sim.send(one, "a", &["b"], &format!("{n}"))
            })
            .collect();
        // In the middle of letters and receipts.
        sim.run_for(Duration::from_micros(150 * delay));
        sim.reset(one, two);
        assert!(sim.run_until_quiet(secs(5)));
        for ticket in tickets {
            assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
        }
        let mut got = sim.contents(two, "b");
        got.sort_by_key(|text| text.parse::<u32>().unwrap());
        let all: Vec<String> = (0..20).map(|n| n.to_string()).collect();
        assert_eq!(got, all);
        for (node, name) in [(one, "b"), (two, "a")] {
            assert_eq!(changes(&sim, node, ChangeKind::Removed, name), 0);
            assert_eq!(changes(&sim, node, ChangeKind::Added, name), 0);
        }
        assert_eq!(gone(&sim, one) + gone(&sim, two), 0);
    }
}

#[test]
fn a_link_that_only_one_side_has_lost_is_replaced_at_once() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    for (loser, other) in [(one, two), (two, one)] {
        // The way back is cut meanwhile: the end of the stream never arrives.
        sim.lose(loser, other);
        sim.run_for(millis(50));
        assert!(linked(&sim, one, two));
        assert_eq!(sim.streams(one, two), 1);
        for (node, from, to) in [(one, "a", "b"), (two, "b", "a")] {
            let ticket = sim.send(node, from, &[to], "");
            sim.run_for(millis(50));
            assert_eq!(outcome(&sim, node, ticket), Outcome::Delivered);
        }
    }
    assert_eq!(gone(&sim, one) + gone(&sim, two), 0);
    let dials = sim.collected(one).dials.len() + sim.collected(two).dials.len();
    assert!(dials <= 4, "{dials} dials");
}

#[test]
fn a_daemon_that_is_shut_down_takes_its_agents_along_at_once() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.shutdown(two);
    sim.run_for(millis(10));
    assert!(sim.directory(one).find("b").is_none());
    assert!(!sim.is_up(two));
    assert_eq!(gone(&sim, one), 1);
    assert_eq!(changes(&sim, one, ChangeKind::Changed, "b"), 0);
    sim.forget(one);
    sim.run_for(secs(60));
    assert_eq!(sim.collected(one).dials, []);
}

#[test]
fn a_peer_whose_address_somebody_else_has_now_is_dialled_again_when_it_is_back() {
    let mut sim = Sim::new(1);
    let address: fipa_directory::Address = "tcp://10.0.0.7:4100".parse().unwrap();
    let (one, two) = pair(&mut sim);
    let own = address.clone();
    let moved = sim.daemon_with("moved", move |config| config.endpoints = vec![own]);
    sim.register(moved, "m");
    sim.discover_all();
    sim.run_for(secs(1));
    assert!(linked(&sim, one, moved));
    sim.power_off(moved);
    let squatter = sim.daemon_with("squatter", move |config| config.endpoints = vec![address]);
    sim.register(squatter, "s");
    sim.reset(one, two);
    sim.run_for(secs(90));
    assert!(sim.directory(one).find("m").is_none());
    let third = sim.daemon("third");
    sim.discover(third);
    sim.run_for(secs(1));
    assert!(linked(&sim, one, third));
}

#[test]
fn a_large_letter_on_a_slow_network_does_not_look_like_silence() {
    let mut sim = Sim::new(1);
    sim.set_network(Network {
        octets_per_second: Some(1 << 20),
        ..Network::default()
    });
    let (one, two) = pair(&mut sim);
    let large = "x".repeat(40 << 20);
    let ticket = sim.send_within(one, "a", &["b"], &large, secs(100));
    sim.run_for(secs(45));
    assert_eq!(outcome(&sim, one, ticket), Outcome::Delivered);
    assert_eq!(sim.contents(two, "b").len(), 1);
    assert_eq!(sim.collected(one).notices, []);
    assert_eq!(sim.collected(two).notices, []);
}

#[test]
fn a_snapshot_in_parts_is_whole_when_changes_come_over_another_link_meanwhile() {
    let mut sim = Sim::new(1);
    sim.set_network(Network {
        octets_per_second: Some(200_000),
        ..Network::default()
    });
    let (one, two) = (sim.daemon("one"), sim.daemon("two"));
    for n in 0..1200 {
        sim.register(two, &format!("agent{n:04}"));
    }
    sim.add_peer(one, sim.address(two));
    sim.add_peer(two, sim.address(one));
    for n in 0..100 {
        sim.run_for(millis(20));
        sim.register(two, &format!("later{n:04}"));
        sim.deregister(two, &format!("agent{n:04}"));
    }
    sim.run_for(secs(10));
    assert_eq!(sim.names(one), sim.names(two));
    assert_eq!(sim.names(one).len(), 1200);
    let removed = sim.collected(one).changes.iter();
    let removed = removed.filter(|(_, c)| c.kind == ChangeKind::Removed);
    assert!(removed.count() <= 100);
}

#[test]
fn a_second_snapshot_that_is_older_changes_nothing() {
    let mut raw = Raw::new(Role::Daemon);
    let snapshot = |version, names: &[&str]| {
        let put = |name: &&str| DirectoryItem::Put {
            owner: PARTNER,
            source: fipa_directory::Source::Local,
            state: fipa_directory::State::Alive,
            age_millis: 0,
            entry: Entry::new(*name),
        };
        Frame::Directory(DirectoryFrame {
            version,
            snapshot: true,
            more: false,
            items: names.iter().map(put).collect(),
        })
    };
    raw.say(snapshot(5, &["b"]));
    raw.say(snapshot(4, &["c"]));
    assert!(raw.mts.directory().find("b").is_some());
    assert!(raw.mts.directory().find("c").is_none());
}

fn put(name: &str) -> DirectoryItem {
    DirectoryItem::Put {
        owner: PARTNER,
        source: fipa_directory::Source::Local,
        state: fipa_directory::State::Alive,
        age_millis: 0,
        entry: Entry::new(name),
    }
}

#[test]
fn what_is_told_in_parts_is_known_when_it_is_whole() {
    let mut raw = Raw::new(Role::Daemon);
    let part = |version, snapshot, more, name| {
        Frame::Directory(DirectoryFrame {
            version,
            snapshot,
            more,
            items: vec![put(name)],
        })
    };
    raw.say(part(1, true, true, "a"));
    assert!(raw.mts.directory().is_empty());
    raw.say(part(1, false, false, "b"));
    assert_eq!(raw.mts.directory().len(), 2);
    raw.say(part(2, false, true, "c"));
    raw.say(part(2, false, true, "d"));
    assert_eq!(raw.mts.directory().len(), 2);
    raw.say(part(2, false, false, "e"));
    assert_eq!(raw.mts.directory().len(), 5);
}

#[test]
fn a_directory_that_is_too_large_for_a_frame_is_told_in_parts() {
    let mut raw = Raw::new(Role::Program);
    let now = raw.now;
    for n in 0..60 {
        let registration = Registration {
            description: "x".repeat(60_000).into(),
            ..Registration::new(format!("agent{n}"))
        };
        raw.mts.register(now, n, registration);
    }
    raw.say(Frame::Watch);
    let parts: Vec<&DirectoryFrame> = raw
        .heard
        .iter()
        .filter_map(|frame| match frame {
            Frame::Directory(part) => Some(part),
            _ => None,
        })
        .collect();
    assert_eq!(parts.len(), 4);
    let flags: Vec<(bool, bool)> = parts.iter().map(|p| (p.snapshot, p.more)).collect();
    let expected = [(true, true), (false, true), (false, true), (false, false)];
    assert_eq!(flags, expected);
    assert_eq!(parts.iter().map(|p| p.items.len()).sum::<usize>(), 60);
}

#[test]
fn an_agent_whose_entry_would_not_fit_is_refused() {
    let mut raw = Raw::new(Role::Daemon);
    let now = raw.now;
    let registration = Registration {
        description: "x".repeat(100_000).into(),
        ..Registration::new("verbose")
    };
    raw.mts.register(now, 1, registration);
    raw.exchange();
    let refused = raw.outputs.iter().any(|output| match output {
        Output::Registered { result, .. } => matches!(result, Err(RegisterError::Refused(_))),
        _ => false,
    });
    assert!(refused && raw.mts.directory().is_empty());
}
