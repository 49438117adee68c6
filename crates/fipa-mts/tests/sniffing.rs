//! What watchers are told of.
mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, Text};
use fipa_codec::bit_efficient;
use fipa_link::{Frame, Inside, Outcome, Passed, Role, Sniffed};
use fipa_mts::{Machine, Registration, Submission};
use fipa_sim::{NodeId, Sim};

use support::{Raw, fleet, millis, pair, secs};

/// Everything but the marks, which stand at the begin and at the end.
fn told(sim: &Sim, node: NodeId) -> Vec<&Sniffed> {
    let mark = |told: &&Sniffed| matches!(told.passed, Passed::Begin | Passed::End);
    let told = sim.collected(node).sniffed.iter();
    told.filter(|one| !mark(one)).collect()
}

/// The payload of a letter, and each outcome with its receiver.
fn letter(sniffed: &Sniffed) -> (String, Vec<(String, Outcome)>) {
    let Passed::Letter {
        outcomes, parts, ..
    } = &sniffed.passed
    else {
        panic!("{sniffed:?} is no letter");
    };
    let octets: Vec<u8> = parts.iter().flatten().copied().collect();
    let octets = Bytes::from(octets);
    let (_, payload) = bit_efficient::decode_envelope(&octets, &Default::default()).unwrap();
    let payload = String::from_utf8(octets[payload..].to_vec()).unwrap();
    let outcomes = outcomes.iter().map(|o| (o.to.to_string(), o.outcome));
    (payload, outcomes.collect())
}

fn letters(sim: &Sim, node: NodeId) -> Vec<(String, Vec<(String, Outcome)>)> {
    told(sim, node).into_iter().map(letter).collect()
}

#[test]
fn every_service_on_the_way_tells_of_a_letter_with_its_outcome() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    let watcher = sim.program("watcher", two);
    sim.run_for(millis(100));
    sim.sniff(one, true);
    sim.sniff(watcher, true);
    sim.run_for(millis(100));
    for content in ["1", "2", "3"] {
        sim.send(one, "a", &["b"], content);
    }
    sim.send(one, "a", &["nobody"], "4");
    assert!(sim.run_until_quiet(secs(1)));
    let delivered = |content: &str| {
        let outcomes = vec![("b".to_owned(), Outcome::Delivered)];
        (content.to_owned(), outcomes)
    };
    let mut wanted = ["1", "2", "3"].map(delivered).to_vec();
    assert_eq!(letters(&sim, watcher), wanted);
    // That one does not wait for a receipt.
    let unknown = vec![("nobody".to_owned(), Outcome::Unknown)];
    wanted.insert(0, ("4".to_owned(), unknown));
    assert_eq!(letters(&sim, one), wanted);
    let numbers = |node| {
        told(&sim, node)
            .iter()
            .map(|t| t.number)
            .collect::<Vec<_>>()
    };
    assert_eq!(numbers(one), [4, 1, 2, 3]);
    assert_eq!(numbers(watcher), [1, 2, 3]);
    let from = |node| match &told(&sim, node)[2].passed {
        Passed::Letter { from, via, .. } => (from.to_string(), via.to_string()),
        other => panic!("{other:?}"),
    };
    assert_eq!(from(one), (String::new(), String::new()));
    assert_eq!(from(watcher), ("d0".to_owned(), "tcp".to_owned()));
}

#[test]
fn what_is_under_way_when_the_watch_ends_is_told_without_outcomes() {
    let mut sim = Sim::new(1);
    let (one, two) = pair(&mut sim);
    sim.sniff(one, true);
    sim.freeze(two);
    sim.send(one, "a", &["b"], "under way");
    sim.run_for(millis(100));
    assert_eq!(letters(&sim, one), []);
    sim.sniff(one, false);
    sim.run_for(millis(100));
    assert_eq!(letters(&sim, one), [("under way".to_owned(), Vec::new())]);
    assert_eq!(
        sim.collected(one).sniffed.last().unwrap().passed,
        Passed::End
    );
    assert!(!sim.mts(one).is_watched());
}

#[test]
fn a_program_that_watches_goes_on_when_its_daemon_is_back() {
    let mut sim = Sim::new(1);
    let one = fleet(&mut sim, 1)[0];
    let watcher = sim.program("watcher", one);
    sim.run_for(millis(100));
    sim.sniff(watcher, true);
    sim.run_for(millis(100));
    sim.crash(one);
    sim.run_for(millis(500));
    sim.restart(one);
    sim.run_for(secs(1));
    sim.send(one, "a", &["nobody"], "again");
    sim.run_for(millis(100));
    assert_eq!(letters(&sim, watcher).len(), 1);
    sim.crash(watcher);
    sim.run_for(millis(500));
    assert!(!sim.mts(one).is_watched());
}

#[test]
fn only_programs_watch() {
    let mut peer = Raw::new(Role::Daemon);
    peer.say(Frame::Sniff(true));
    assert!(!peer.mts.is_watched());
    let mut program = Raw::new(Role::Program);
    program.say(Frame::Sniff(true));
    assert!(program.mts.is_watched());
}

/// A letter of an agent that is not registered.
fn submission(sim: &Sim, ticket: u64, payload: Bytes) -> Submission {
    let letter = sim.letter("a", vec![AgentId::new("b")], payload);
    Submission::new(ticket, letter, secs(10))
}

#[test]
fn a_watcher_that_does_not_read_loses_letters_and_delays_none() {
    let sim = Sim::new(1);
    let mut raw = Raw::new(Role::Program);
    raw.mts.register(raw.now, 0, Registration::new("b"));
    raw.say(Frame::Sniff(true));
    raw.heard.clear();
    let large = Bytes::from(vec![b'x'; 1 << 20]);
    for ticket in 0..20 {
        // One octet too much for what the watcher takes.
        let payload = large.slice(usize::from(ticket > 0) * 4096..);
        raw.mts.submit(raw.now, submission(&sim, ticket, payload));
        assert!(raw.mts.take_mail("b").is_some(), "letter {ticket}");
    }
    raw.exchange();
    let came = raw.heard.len();
    assert!((8..12).contains(&came), "{came} letters");
    raw.mts
        .submit(raw.now, submission(&sim, 99, Bytes::from_static(b"last")));
    raw.exchange();
    let lost = raw.heard.iter().map(|frame| match frame {
        Frame::Sniffed(sniffed) => sniffed.lost,
        other => panic!("{other:?}"),
    });
    // The first was too large, the last of them found no room.
    let lost: Vec<u64> = lost.collect();
    assert_eq!(lost[0], 1);
    assert!(lost[1..came].iter().all(|lost| *lost == 0), "{lost:?}");
    assert_eq!(lost.iter().sum::<u64>() as usize + lost.len(), 21);
}

#[test]
fn a_letter_is_told_as_the_very_octets_that_came() {
    let sim = Sim::new(1);
    let mut raw = Raw::new(Role::Program);
    raw.mts.register(raw.now, 0, Registration::new("b"));
    raw.mts.sniff(raw.now, true);
    let payload = Bytes::from(vec![b'x'; 100_000]);
    raw.mts
        .submit(raw.now, submission(&sim, 1, payload.clone()));
    raw.exchange();
    let told = raw.outputs.iter().filter_map(|output| match output {
        fipa_mts::Output::Sniffed(sniffed) => Some(&sniffed.passed),
        _ => None,
    });
    let [Passed::Begin, Passed::Letter { parts, .. }] = told.collect::<Vec<_>>()[..] else {
        panic!("{:?}", raw.outputs);
    };
    assert_eq!(parts.iter().last().unwrap().as_ptr(), payload.as_ptr());
}

#[test]
fn messages_of_devices_stand_between_the_letters() {
    let mut raw = Raw::new(Role::Program);
    let inside = Inside {
        protocol: Text::from("text"),
        incoming: true,
        place: Text::from("udp://127.0.0.1:5000"),
        form: Text::from("{}"),
    };
    raw.mts.passed_inside(raw.now, inside.clone());
    raw.say(Frame::Sniff(true));
    raw.mts.passed_inside(raw.now, inside.clone());
    raw.exchange();
    let [Frame::Sniffed(begin), Frame::Sniffed(told)] = &raw.heard[..] else {
        panic!("{:?}", raw.heard);
    };
    assert_eq!(begin.passed, Passed::Begin);
    assert_eq!((told.number, &told.passed), (1, &Passed::Inside(inside)));
}
