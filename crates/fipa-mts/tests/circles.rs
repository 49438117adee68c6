//! Letters that would travel in circles.
mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Received, Representation, Slots, Text};
use fipa_codec::bit_efficient;
use fipa_directory::{Entry, InstanceId, MESSAGE_TRANSPORT, Source, State};
use fipa_link::{DirectoryFrame, DirectoryItem, Frame, Outcome, Role};
use fipa_mts::{Machine, Registration};
use fipa_sim::Sim;

use support::{PARTNER, Raw, outcome, secs};

/// A letter for `b` that bears these stamps.
fn stamped(stamps: impl IntoIterator<Item = String>) -> Bytes {
    let mut envelope = Envelope::new(Slots {
        to: vec![AgentId::new("b")],
        from: Some(AgentId::new("a")),
        acl_representation: Some(Representation::BitEfficient),
        date: Some(FipaTime::from_unix_millis(0)),
        ..Slots::default()
    });
    for id in stamps {
        envelope.overlays.push(Slots {
            received: Some(Received {
                by: Text::from("someone"),
                from: None,
                date: FipaTime::from_unix_millis(0),
                id: Some(Text::from(id)),
                via: None,
                user_defined: Vec::new(),
            }),
            ..Slots::default()
        });
    }
    let mut octets = fipa_codec::Output::new();
    bit_efficient::encode_envelope(&envelope, &mut octets).unwrap();
    octets.take_bytes()
}

/// A service to which its partner has told that it holds `b`.
fn told_of_b() -> Raw {
    let mut raw = Raw::new(Role::Daemon);
    raw.say(Frame::Directory(DirectoryFrame {
        version: 1,
        snapshot: true,
        more: false,
        items: vec![DirectoryItem::Put {
            owner: PARTNER,
            source: Source::Local,
            state: State::Alive,
            age_millis: 0,
            entry: Entry::new("b"),
        }],
    }));
    assert!(raw.mts.directory().find("b").is_some());
    raw
}

fn letters(raw: &Raw) -> usize {
    let letters = raw.heard.iter();
    letters.filter(|f| matches!(f, Frame::Letter(_))).count()
}

#[test]
fn a_ring_of_seeds_delivers_once_and_comes_to_an_end() {
    let mut sim = Sim::new(1);
    let nodes = [sim.daemon("one"), sim.daemon("two"), sim.daemon("three")];
    for n in 0..3 {
        let next = sim.address(nodes[(n + 1) % 3]);
        sim.add_peer(nodes[n], next);
    }
    sim.register(nodes[0], "a");
    sim.register(nodes[1], "b");
    sim.register(nodes[2], "c");
    sim.run_for(secs(1));
    let to_b = sim.send(nodes[0], "a", &["b"], "one");
    let to_all = sim.send(nodes[2], "c", &[".*"], "two");
    assert!(sim.run_until_quiet(secs(1)));
    assert_eq!(outcome(&sim, nodes[0], to_b), Outcome::Delivered);
    assert_eq!(sim.outcomes(nodes[2], to_all).len(), 2);
    assert_eq!(sim.contents(nodes[1], "b"), ["one", "two"]);
    assert_eq!(sim.contents(nodes[0], "a"), ["two"]);
    assert_eq!(sim.mts(nodes[0]).letters_under_way(), 0);
}

#[test]
fn a_letter_that_comes_back_is_refused_and_not_passed_on() {
    let mut raw = told_of_b();
    let own = InstanceId::from_bytes([1; 16]);
    raw.letter(1, stamped([format!("{own}:17")]));
    let (_, outcome, reason) = &raw.receipt(1)[0];
    assert_eq!(*outcome, Outcome::Refused);
    assert!(reason.contains("came back to here"), "{reason}");
    assert_eq!(letters(&raw), 0);
}

#[test]
fn a_stale_entry_makes_a_letter_bounce_once_at_most() {
    let mut raw = told_of_b();
    raw.letter(1, stamped([]));
    // Passed on to whom the directory names, who is the one that it came from.
    assert_eq!(letters(&raw), 1);
    let Some(Frame::Letter(passed_on)) = raw.heard.iter().find(|f| matches!(f, Frame::Letter(_)))
    else {
        unreachable!()
    };
    let octets = passed_on.parts.iter().next().unwrap().clone();
    raw.letter(2, octets);
    assert_eq!(raw.receipt(2)[0].1, Outcome::Refused);
    assert_eq!(letters(&raw), 1);
}

#[test]
fn a_letter_ends_after_32_stamps() {
    let other = InstanceId::from_bytes([7; 16]);
    let stamps = |count: u64| (0..count).map(move |n| format!("{other}:{n}"));
    let mut raw = told_of_b();
    raw.letter(1, stamped(stamps(31)));
    assert_eq!(letters(&raw), 1);
    raw.letter(2, stamped(stamps(32)));
    let (_, outcome, reason) = &raw.receipt(2)[0];
    assert_eq!(*outcome, Outcome::Refused);
    assert!(reason.contains("32 services"), "{reason}");
    assert_eq!(letters(&raw), 1);
}

#[test]
fn receivers_from_a_peer_are_no_patterns() {
    let mut raw = Raw::new(Role::Daemon);
    let now = raw.now;
    raw.mts.register(now, 1, Registration::new("bb"));
    raw.letter(1, stamped([]));
    assert_eq!(raw.receipt(1)[0].1, Outcome::Unknown);
}

#[test]
fn a_letter_that_is_no_letter_is_refused_and_the_link_stays() {
    let mut raw = Raw::new(Role::Daemon);
    raw.letter(1, "what is this");
    let (_, outcome, reason) = &raw.receipt(1)[0];
    assert_eq!(*outcome, Outcome::Refused);
    assert!(reason.contains("envelope cannot be read"), "{reason}");
    assert!(!raw.closed);
}

#[test]
fn what_a_peer_says_of_the_agents_of_others_is_passed_over() {
    let mut raw = told_of_b();
    let now = raw.now;
    raw.mts.register(now, 1, Registration::new("mine"));
    let here = InstanceId::from_bytes([1; 16]);
    let third = InstanceId::from_bytes([3; 16]);
    let put = |owner, name: &str| DirectoryItem::Put {
        owner,
        source: Source::Local,
        state: State::Alive,
        age_millis: 0,
        entry: Entry {
            kind: Text::from_static(MESSAGE_TRANSPORT),
            ..Entry::new(name)
        },
    };
    let remove = |owner, name: &str| DirectoryItem::Remove {
        owner,
        name: Text::from(name),
    };
    for snapshot in [false, true] {
        raw.say(Frame::Directory(DirectoryFrame {
            version: 2 + u64::from(snapshot),
            snapshot,
            more: false,
            items: vec![
                put(third, "spoofed"),
                put(here, "spoofed"),
                remove(here, "mine"),
                put(PARTNER, "b"),
                put(PARTNER, "c"),
            ],
        }));
        let mut names: Vec<_> = raw.mts.directory().iter().map(|r| &r.entry.name).collect();
        names.sort();
        assert_eq!(names, ["b", "c", "mine"]);
    }
}

#[test]
fn late_and_doubled_parts_of_a_directory_change_nothing() {
    let mut raw = told_of_b();
    let remove = |version| {
        Frame::Directory(DirectoryFrame {
            version,
            snapshot: false,
            more: false,
            items: vec![DirectoryItem::Remove {
                owner: PARTNER,
                name: Text::from("b"),
            }],
        })
    };
    raw.say(remove(1));
    assert!(raw.mts.directory().find("b").is_some());
    raw.say(remove(2));
    assert!(raw.mts.directory().find("b").is_none());
}
