//! Letters for robots that are known but away.
mod support;

use std::time::Duration;

use fipa_acl::{Letter, Message, Performative};
use fipa_codec::{Output, bit_efficient, decode_payload};
use fipa_link::Outcome;
use fipa_mts::{DeliveryFailure, Notice, OutboxConfig};
use fipa_sim::{NodeId, Sim};

use support::{millis, outcome, reason, secs};

fn with_outbox(sim: &mut Sim, name: &str, set: impl FnOnce(&mut OutboxConfig)) -> NodeId {
    let mut limits = OutboxConfig::default();
    set(&mut limits);
    sim.daemon_with(name, |config| config.outbox = Some(limits))
}

/// Two daemons that store, with the agents `a` and `b`; that of `b` is known, and has crashed.
fn away(sim: &mut Sim, set: impl FnOnce(&mut OutboxConfig)) -> (NodeId, NodeId) {
    let here = with_outbox(sim, "here", set);
    let there = with_outbox(sim, "there", |_| ());
    sim.register(here, "a");
    sim.register(there, "b");
    sim.discover_all();
    sim.run_for(secs(1));
    sim.crash(there);
    sim.run_for(secs(5));
    (here, there)
}

fn come_back(sim: &mut Sim, node: NodeId) {
    sim.restart(node);
    sim.register(node, "b");
    sim.discover_all();
    sim.run_for(secs(10));
}

fn stored(sim: &Sim, node: NodeId, ticket: u64) -> bool {
    outcome(sim, node, ticket) == Outcome::Timeout
        && reason(sim, node, ticket).starts_with("stored")
}

/// The notices of stored letters that were dropped.
fn dropped(sim: &Sim, node: NodeId) -> Vec<String> {
    let notices = sim.collected(node).notices.iter();
    let dropped = notices.filter(|(_, n)| matches!(n, Notice::StoredLetterDropped { .. }));
    dropped.map(|(_, notice)| notice.to_string()).collect()
}

fn numbers(range: std::ops::Range<usize>) -> Vec<String> {
    range.map(|n| n.to_string()).collect()
}

#[test]
fn letters_for_a_robot_that_is_away_are_stored_and_delivered_in_order_when_it_is_back() {
    let mut sim = Sim::new(1);
    let (here, there) = away(&mut sim, |_| ());
    // The shorter a letter waits, the sooner it is stored; that is not their order.
    let sent = |n: u64| secs(20 - n % 7);
    let letters: Vec<u64> = (0..50)
        .map(|n| sim.send_within(here, "a", &["b"], &n.to_string(), sent(n)))
        .collect();
    sim.run_for(secs(12));
    assert_eq!(sim.told(here, letters[0]), None);
    sim.run_for(secs(10));
    assert!(letters.iter().all(|ticket| stored(&sim, here, *ticket)));
    assert_eq!(sim.letters_on_disk(here), 50);
    come_back(&mut sim, there);
    assert_eq!(sim.contents(there, "b"), numbers(0..50));
    assert_eq!(sim.letters_on_disk(here), 0);
    assert_eq!(sim.mts(here).letters_stored(), 0);
}

#[test]
fn a_robot_that_is_back_before_the_deadline_gets_the_letter_and_nothing_is_stored() {
    let mut sim = Sim::new(2);
    let (here, there) = away(&mut sim, |_| ());
    let first = sim.send(here, "a", &["b"], "0");
    sim.run_for(secs(9));
    // It is on the disk already, to be safe in time.
    assert_eq!(sim.letters_on_disk(here), 1);
    let second = sim.send(here, "a", &["b"], "1");
    sim.restart(there);
    sim.register(there, "b");
    sim.discover_all();
    sim.run_for(secs(5));
    for ticket in [first, second] {
        assert_eq!(outcome(&sim, here, ticket), Outcome::Delivered);
    }
    assert_eq!(sim.contents(there, "b"), numbers(0..2));
    assert_eq!(sim.letters_on_disk(here), 0);
}

#[test]
fn letters_survive_a_crash_of_the_daemon_and_later_ones_go_behind_them() {
    let mut sim = Sim::new(3);
    let (here, there) = away(&mut sim, |_| ());
    let first = sim.send(here, "a", &["b"], "0");
    sim.run_for(secs(11));
    assert!(stored(&sim, here, first));
    sim.restart(here);
    sim.register(here, "a");
    assert_eq!(sim.mts(here).letters_stored(), 1);
    // The receiver is known by the letter that waits for it.
    let second = sim.send(here, "a", &["b"], "1");
    sim.run_for(secs(11));
    assert!(stored(&sim, here, second));
    come_back(&mut sim, there);
    assert_eq!(sim.contents(there, "b"), numbers(0..2));
}

#[test]
fn the_receiver_may_turn_up_at_another_platform() {
    let mut sim = Sim::new(4);
    let (here, _) = away(&mut sim, |_| ());
    let ticket = sim.send(here, "a", &["b"], "0");
    sim.run_for(secs(11));
    assert!(stored(&sim, here, ticket));
    let third = sim.daemon("third");
    sim.register(third, "b");
    sim.discover_all();
    sim.run_for(secs(2));
    assert_eq!(sim.contents(third, "b"), ["0"]);
    let fourth = sim.send(here, "a", &["c"], "1");
    sim.run_for(secs(2));
    assert_eq!(outcome(&sim, here, fourth), Outcome::Unknown);
}

#[test]
fn a_full_disk_or_a_full_outbox_makes_an_ordinary_timeout_that_is_never_delivered() {
    let mut sim = Sim::new(5);
    let (here, there) = away(&mut sim, |limits| limits.letters = 2);
    sim.set_disk_full(here, true);
    let lost = sim.send(here, "a", &["b"], "0");
    sim.run_for(secs(11));
    assert_eq!(outcome(&sim, here, lost), Outcome::Timeout);
    assert_eq!(
        reason(&sim, here, lost),
        "b is away, and the letter could not be stored: the disk is full"
    );
    sim.set_disk_full(here, false);
    let sent: Vec<u64> = (1..4)
        .map(|n: u64| sim.send(here, "a", &["b"], &n.to_string()))
        .collect();
    sim.run_for(secs(11));
    let kept: Vec<bool> = sent.iter().map(|t| stored(&sim, here, *t)).collect();
    assert_eq!(kept, [true, true, false]);
    assert_eq!(
        reason(&sim, here, sent[2]),
        "b is away, and the letter could not be stored: 2 letters for its robot are stored already"
    );
    come_back(&mut sim, there);
    assert_eq!(sim.contents(there, "b"), numbers(1..3));
}

#[test]
fn octets_are_limited_for_a_peer_and_in_all() {
    for (octets, total) in [(1000, 1 << 20), (1 << 20, 1000)] {
        let mut sim = Sim::new(6);
        let (here, _) = away(&mut sim, |limits| {
            (limits.octets, limits.total_octets) = (octets, total);
        });
        let content = "x".repeat(400);
        let sent: Vec<u64> = (0..3)
            .map(|_| sim.send(here, "a", &["b"], &content))
            .collect();
        sim.run_for(secs(11));
        let kept = sent.iter().filter(|ticket| stored(&sim, here, **ticket));
        assert_eq!(kept.count(), 1);
    }
}

#[test]
fn a_letter_that_is_too_old_is_dropped_and_that_is_told() {
    let mut sim = Sim::new(7);
    let (here, there) = away(&mut sim, |limits| limits.age = secs(60));
    let ticket = sim.send(here, "a", &["b"], "0");
    sim.run_for(secs(11));
    assert!(stored(&sim, here, ticket));
    sim.run_for(secs(70));
    let said = dropped(&sim, here);
    assert!(
        said.len() == 1
            && said[0].ends_with("from a for b is dropped: b was away for longer than 60 s"),
        "{said:?}"
    );
    assert_eq!(sim.letters_on_disk(here), 0);
    come_back(&mut sim, there);
    assert_eq!(sim.contents(there, "b"), [""; 0]);
}

#[test]
fn a_stored_letter_waits_for_a_receiver_that_is_back_and_does_not_read() {
    let mut sim = Sim::new(7);
    let here = with_outbox(&mut sim, "here", |_| ());
    let there = sim.daemon_with("there", |config| config.mailbox_letters = 1);
    sim.register(here, "a");
    sim.register(there, "b");
    sim.discover_all();
    sim.run_for(secs(1));
    sim.crash(there);
    sim.run_for(secs(5));
    for n in 0..3 {
        sim.send(here, "a", &["b"], &n.to_string());
    }
    sim.run_for(secs(11));
    sim.restart(there);
    sim.set_reading(there, false);
    sim.register(there, "b");
    sim.discover_all();
    sim.run_for(secs(60));
    assert_eq!(dropped(&sim, here), [""; 0]);
    assert_eq!(sim.mts(here).letters_stored(), 2);
    sim.set_reading(there, true);
    sim.run_for(secs(60));
    assert_eq!(sim.contents(there, "b"), numbers(0..3));
    assert_eq!(sim.letters_on_disk(here), 0);
}

#[test]
fn a_program_that_comes_back_is_told_what_was_dropped_meanwhile_though_it_may_have_arrived() {
    let mut sim = Sim::new(9);
    let (here, _) = away(&mut sim, |limits| limits.age = secs(60));
    let program = sim.program_with("p", here, |config| config.patience = secs(1_000_000));
    sim.register(program, "q");
    sim.run_for(secs(1));
    let message = Message::new(Performative::Inform).from_agent("q").to("b");
    let mut payload = Output::new();
    bit_efficient::encode_message(&message, &mut payload).unwrap();
    let to = vec![fipa_acl::AgentId::new("b")];
    let letter = sim.letter("q", to, payload.take_bytes());
    let ticket = sim.submit(program, letter, secs(5));
    sim.run_for(secs(7));
    assert!(stored(&sim, program, ticket));
    sim.crash(here);
    sim.run_for(secs(70));
    // The letter is too old as soon as its daemon is there, and the program is not yet.
    sim.restart(here);
    assert_eq!(dropped(&sim, here).len(), 1);
    assert_eq!(sim.letters_on_disk(here), 1);
    sim.run_for(secs(30));
    let mail = &sim.collected(program).mail["q"];
    let limits = fipa_codec::Limits::default();
    let told = decode_payload(&mail[0].envelope, &mail[0].payload, &limits).unwrap();
    let failure = DeliveryFailure::of(&told).unwrap();
    // An earlier run of the daemon may have sent it.
    assert_eq!(failure.reason, "timeout: b was away for longer than 60 s");
    assert_eq!(mail.len(), 1);
    assert_eq!(sim.letters_on_disk(here), 0);
}

/// A letter around a message that is not wanted after so long.
fn wanted_for(sim: &Sim, span: Duration) -> (Letter, i64) {
    let at = sim.now().plus(span).unix_millis;
    let message = Message::new(Performative::Request)
        .from_agent("a")
        .to("b")
        .reply_by(fipa_acl::FipaTime::from_unix_millis(at));
    let mut payload = Output::new();
    bit_efficient::encode_message(&message, &mut payload).unwrap();
    let to = vec![fipa_acl::AgentId::new("b")];
    (sim.letter("a", to, payload.take_bytes()), at)
}

#[test]
fn a_letter_whose_reply_by_has_passed_is_not_sent() {
    let mut sim = Sim::new(8);
    let (here, there) = away(&mut sim, |_| ());
    // The deadline is that of the message: there is nothing to store.
    let (letter, at) = wanted_for(&sim, secs(5));
    let soon = sim.submit_with(here, letter, secs(10), |s| s.reply_by = Some(at));
    let (letter, at) = wanted_for(&sim, secs(60));
    let later = sim.submit_with(here, letter, secs(10), |s| s.reply_by = Some(at));
    sim.run_for(secs(11));
    assert_eq!(outcome(&sim, here, soon), Outcome::Expired);
    assert!(stored(&sim, here, later));
    sim.run_for(secs(50));
    come_back(&mut sim, there);
    assert_eq!(sim.contents(there, "b"), [""; 0]);
    let said = dropped(&sim, here);
    assert!(
        said.len() == 1 && said[0].ends_with("dropped: reply-by has passed"),
        "{said:?}"
    );
    // Who was told that it is stored is told that it is not delivered, of this letter alone.
    let told: Vec<DeliveryFailure> = sim.collected(here).mail["a"]
        .iter()
        .filter_map(|letter| {
            let limits = fipa_codec::Limits::default();
            let message = decode_payload(&letter.envelope, &letter.payload, &limits).ok()?;
            DeliveryFailure::of(&message)
        })
        .collect();
    let told: Vec<String> = told.iter().map(DeliveryFailure::to_string).collect();
    assert_eq!(
        told,
        ["here could not deliver it to b: reply-by has passed"]
    );
}

#[test]
fn a_letter_that_arrived_and_was_stored_for_want_of_a_receipt_is_not_delivered_again() {
    // The way back is cut before the receipt comes; then the sender's daemon crashes as well.
    for crash in [false, true] {
        let mut sim = Sim::new(9);
        let here = with_outbox(&mut sim, "here", |_| ());
        let there = sim.daemon("there");
        sim.register(here, "a");
        sim.register(there, "b");
        sim.discover_all();
        sim.run_for(secs(1));
        let ticket = sim.send(here, "a", &["b"], "0");
        while sim.contents(there, "b").is_empty() {
            sim.run_for(Duration::from_micros(10));
        }
        sim.cut(here, there);
        sim.run_for(secs(30));
        assert!(stored(&sim, here, ticket));
        if crash {
            sim.restart(here);
            sim.register(here, "a");
            sim.run_for(secs(900));
        }
        sim.mend(here);
        sim.discover_all();
        sim.run_for(secs(60));
        assert_eq!(sim.letters_on_disk(here), 0);
        assert_eq!(sim.contents(there, "b"), ["0"]);
    }
}

#[test]
fn an_attached_agent_that_got_a_letter_does_not_get_it_again_after_a_crash_of_its_daemon() {
    let mut sim = Sim::new(10);
    let here = with_outbox(&mut sim, "here", |_| ());
    let there = sim.daemon("there");
    sim.run_for(millis(10));
    let program = sim.program("program", there);
    sim.register(here, "a");
    sim.register(program, "b");
    sim.discover_all();
    sim.run_for(secs(1));
    let ticket = sim.send(here, "a", &["b"], "0");
    while sim.contents(program, "b").is_empty() {
        sim.run_for(Duration::from_micros(10));
    }
    sim.crash(there);
    sim.run_for(secs(11));
    assert!(stored(&sim, here, ticket));
    sim.restart(there);
    sim.discover_all();
    sim.run_for(secs(10));
    assert_eq!(sim.letters_on_disk(here), 0);
    assert_eq!(sim.contents(program, "b"), ["0"]);
}

#[test]
fn an_agent_that_is_unknown_or_of_this_platform_is_not_waited_for() {
    let mut sim = Sim::new(11);
    let (here, _) = away(&mut sim, |_| ());
    sim.register(here, "c");
    sim.run_for(secs(1));
    sim.deregister(here, "c");
    sim.run_for(secs(2));
    for name in ["c", "nobody", "agent.*"] {
        let ticket = sim.send(here, "a", &[name], "0");
        sim.run_for(secs(11));
        assert_eq!(outcome(&sim, here, ticket), Outcome::Unknown, "{name}");
    }
    assert_eq!(sim.letters_on_disk(here), 0);
}

#[test]
fn a_robot_that_comes_back_gets_a_few_letters_at_a_time() {
    let mut sim = Sim::new(12);
    let (here, there) = away(&mut sim, |_| ());
    (0..100).for_each(|n| {
        sim.send(here, "a", &["b"], &n.to_string());
    });
    sim.run_for(secs(11));
    sim.restart(there);
    sim.register(there, "b");
    sim.discover_all();
    let mut most = 0;
    while sim.contents(there, "b").len() < 100 {
        sim.run_for(millis(1));
        most = most.max(sim.mts(here).letters_under_way());
    }
    assert!((1..=8).contains(&most), "{most} at once");
    assert_eq!(sim.contents(there, "b"), numbers(0..100));
}

#[test]
fn without_an_outbox_nothing_waits() {
    let mut sim = Sim::new(13);
    let (here, there) = support::pair(&mut sim);
    sim.crash(there);
    sim.run_for(secs(5));
    let ticket = sim.send(here, "a", &["b"], "0");
    sim.run_for(secs(11));
    assert_eq!(outcome(&sim, here, ticket), Outcome::Unknown);
    assert_eq!(sim.mts(here).letters_stored(), 0);
}
