//! Programs that attach agents to a daemon.
mod support;

use fipa_acl::Text;
use fipa_directory::ChangeKind;
use fipa_link::{Frame, Outcome, Role};
use fipa_mts::{Machine, Notice, RegisterError};
use fipa_sim::{NodeId, Sim};

use support::{Raw, changes, fleet, millis, outcome, pair, reason, secs};

/// Two daemons, and a program at each with the agents `p` and `q`.
fn programs(sim: &mut Sim) -> [NodeId; 4] {
    let nodes = fleet(sim, 2);
    let (one, two) = (nodes[0], nodes[1]);
    let (p, q) = (sim.program("p", one), sim.program("q", two));
    sim.register(p, "p");
    sim.register(q, "q");
    sim.run_for(secs(1));
    [one, two, p, q]
}

/// Everything in a directory but the time since when it is known.
fn entries(sim: &Sim, node: NodeId) -> Vec<String> {
    let records = sim.directory(node).iter();
    let mut entries: Vec<String> = records
        .map(|r| format!("{:?} {:?} {:?} {:?}", r.entry, r.owner, r.source, r.state))
        .collect();
    entries.sort();
    entries
}

fn notices(sim: &Sim, node: NodeId) -> Vec<&Notice> {
    let notices = sim.collected(node).notices.iter();
    notices.map(|(_, notice)| notice).collect()
}

#[test]
fn a_program_attaches_agents_that_everybody_can_reach() {
    let mut sim = Sim::new(1);
    let [one, _, p, q] = programs(&mut sim);
    let other = sim.program("other", one);
    let ticket = sim.register(other, "other");
    sim.run_for(millis(100));
    assert_eq!(sim.collected(other).registrations[&ticket], Ok(()));
    for (node, to, at) in [(p, "other", other), (p, "q", q), (one, "q", q), (q, "p", p)] {
        let ticket = sim.send(node, "sender", &[to], "hello");
        assert!(sim.run_until_quiet(secs(1)));
        assert_eq!(outcome(&sim, node, ticket), Outcome::Delivered);
        assert_eq!(sim.contents(at, to).last().unwrap(), "hello");
    }
    assert_eq!(sim.contents(q, "q").len(), 2);
}

#[test]
fn a_name_that_another_connection_holds_is_refused() {
    let mut sim = Sim::new(1);
    let [one, _, p, _] = programs(&mut sim);
    let other = sim.program("other", one);
    let taken = sim.register(other, "p");
    let own = sim.register(p, "p");
    let bad = sim.register(other, "two words");
    sim.run_for(millis(100));
    let told = &sim.collected(other).registrations;
    let why = "the name p is held by another connection";
    assert_eq!(told[&taken], Err(RegisterError::Refused(why.into())));
    assert!(matches!(told[&bad], Err(RegisterError::Name(_))));
    assert!(matches!(
        sim.collected(p).registrations[&own],
        Err(RegisterError::Held(_))
    ));
    // It still works for the one who has it.
    let ticket = sim.send(other, "x", &["p"], "");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, other, ticket), Outcome::Delivered);
    assert_eq!(sim.contents(p, "p").len(), 1);
}

#[test]
fn a_program_that_ends_takes_its_agents_along_and_letters_to_them_are_told() {
    for crash in [true, false] {
        let mut sim = Sim::new(1);
        let [one, two, p, q] = programs(&mut sim);
        sim.freeze(p);
        let far = sim.send(q, "q", &["p"], "");
        let near = sim.send(one, "x", &["p"], "");
        sim.run_for(secs(1));
        assert_eq!((sim.told(q, far), sim.told(one, near)), (None, None));
        if crash {
            sim.crash(p);
        } else {
            sim.thaw(p);
            sim.shutdown(p);
        }
        sim.run_for(millis(100));
        for node in [one, two, q] {
            assert_eq!(sim.names(node), ["q"]);
        }
        if crash {
            assert_eq!(outcome(&sim, q, far), Outcome::Timeout);
            assert_eq!(outcome(&sim, one, near), Outcome::Timeout);
            assert!(reason(&sim, q, far).contains("its program ended"));
        }
        assert!(!sim.is_up(p));
    }
}

#[test]
fn a_program_that_is_shut_down_does_not_look_for_its_daemon_again() {
    let mut sim = Sim::new(1);
    let [one, _, p, _] = programs(&mut sim);
    sim.shutdown(p);
    sim.forget(p);
    // In the very moment in which the daemon ends as well.
    sim.crash(one);
    sim.run_for(secs(10));
    assert_eq!(sim.collected(p).dials, []);
}

#[test]
fn the_directory_of_a_program_is_that_of_its_daemon() {
    let mut sim = Sim::new(1);
    let [one, two, p, q] = programs(&mut sim);
    let same = |sim: &mut Sim| {
        sim.run_for(millis(100));
        assert_eq!(entries(sim, p), entries(sim, one));
        assert_eq!(entries(sim, q), entries(sim, two));
    };
    same(&mut sim);
    for n in 0..700 {
        sim.register(two, &format!("agent{n}"));
    }
    same(&mut sim);
    assert_eq!(sim.names(p).len(), 702);
    sim.deregister(two, "agent7");
    same(&mut sim);
    let late = sim.program("late", one);
    sim.run_for(millis(100));
    assert_eq!(entries(&sim, late), entries(&sim, one));
    sim.freeze(two);
    sim.send(p, "p", &["q"], "");
    sim.run_for(secs(9));
    assert_eq!(entries(&sim, p), entries(&sim, one));
    assert!(entries(&sim, p).iter().any(|e| e.contains("Suspect")));
    sim.crash(two);
    sim.run_for(secs(3));
    assert_eq!(entries(&sim, p), entries(&sim, one));
    assert_eq!(sim.names(p), ["p"]);
}

#[test]
fn programs_attach_again_when_their_daemon_is_started_anew() {
    let mut sim = Sim::new(1);
    let [one, two, p, q] = programs(&mut sim);
    let under_way = sim.send(p, "p", &["q"], "under way");
    sim.crash(one);
    sim.run_for(millis(50));
    assert_eq!(outcome(&sim, p, under_way), Outcome::Timeout);
    assert!(reason(&sim, p, under_way).contains("the daemon went away"));
    let waiting = sim.send(p, "p", &["q"], "waits for the daemon");
    let late = sim.register(p, "p2");
    sim.run_for(secs(5));
    assert!(matches!(
        notices(&sim, p)[..],
        [_, Notice::DaemonLost { .. }]
    ));
    sim.restart(one);
    sim.discover(one);
    sim.run_for(secs(1));
    assert_eq!(sim.names(one), ["p", "p2", "q"]);
    assert_eq!(sim.names(two), ["p", "p2", "q"]);
    assert_eq!(entries(&sim, p), entries(&sim, one));
    assert_eq!(sim.collected(p).registrations[&late], Ok(()));
    assert!(sim.told(p, waiting).is_some());
    let ticket = sim.send(q, "q", &["p"], "again");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, q, ticket), Outcome::Delivered);
    assert_eq!(sim.contents(p, "p"), ["again"]);
    assert!(matches!(notices(&sim, p).last(), Some(Notice::DaemonUp)));
}

#[test]
fn a_daemon_that_is_away_for_too_long_is_given_up() {
    let mut sim = Sim::new(1);
    let one = sim.daemon("one");
    let p = sim.program_with("p", one, |config| config.patience = secs(5));
    sim.register(p, "p");
    sim.run_for(secs(1));
    sim.crash(one);
    sim.run_for(millis(10));
    let waiting = sim.send(p, "p", &["q"], "");
    let asked = sim.register(p, "late");
    sim.run_for(millis(4800));
    assert_eq!(sim.told(p, waiting), None);
    sim.run_for(millis(300));
    assert!(matches!(
        notices(&sim, p).last(),
        Some(Notice::DaemonGivenUp { .. })
    ));
    assert_eq!(outcome(&sim, p, waiting), Outcome::Timeout);
    let told = &sim.collected(p).registrations;
    assert_eq!(told[&asked], Err(RegisterError::NoDaemon));
    sim.forget(p);
    sim.run_for(secs(60));
    assert_eq!(sim.collected(p).dials, []);
    let after = sim.send(p, "p", &["q"], "");
    assert_eq!(outcome(&sim, p, after), Outcome::Timeout);
}

#[test]
fn a_program_without_a_daemon_gives_up_at_once() {
    let mut sim = Sim::new(1);
    let one = sim.daemon("one");
    sim.crash(one);
    let p = sim.program("p", one);
    let ticket = sim.register(p, "p");
    sim.run_for(millis(10));
    let told = &sim.collected(p).registrations;
    assert_eq!(told[&ticket], Err(RegisterError::NoDaemon));
    assert_eq!(sim.collected(p).dials.len(), 1);
}

#[test]
fn an_agent_that_is_detached_is_gone_and_its_name_is_free() {
    let mut sim = Sim::new(1);
    let [one, two, p, q] = programs(&mut sim);
    sim.deregister(p, "p");
    sim.run_for(millis(100));
    for node in [one, two, p, q] {
        assert_eq!(sim.names(node), ["q"]);
    }
    let ticket = sim.send(q, "q", &["p"], "");
    // It might have been on its way to another place.
    sim.run_for(millis(1000));
    assert_eq!(outcome(&sim, q, ticket), Outcome::Unknown);
    let other = sim.program("other", two);
    let ticket = sim.register(other, "p");
    sim.run_for(millis(100));
    assert_eq!(sim.collected(other).registrations[&ticket], Ok(()));
}

#[test]
fn an_agent_that_is_detached_before_the_answer_came_is_gone_as_well() {
    let mut sim = Sim::new(1);
    let [one, _, p, _] = programs(&mut sim);
    sim.register(p, "brief");
    sim.deregister(p, "brief");
    sim.run_for(millis(100));
    assert_eq!(sim.names(one), ["p", "q"]);
}

#[test]
fn a_program_cannot_detach_what_it_does_not_hold() {
    let mut raw = Raw::new(Role::Program);
    let now = raw.now;
    raw.mts
        .register(now, 1, fipa_mts::Registration::new("mine"));
    raw.say(Frame::Detach {
        request: 7,
        name: Text::from("mine"),
    });
    let refused = raw
        .heard
        .iter()
        .any(|frame| matches!(frame, Frame::Answer { request: 7, refusal } if !refusal.is_empty()));
    assert!(refused);
    assert!(raw.mts.directory().find("mine").is_some());
}

#[test]
fn a_program_on_the_socket_of_peers_is_sent_away() {
    let mut sim = Sim::new(1);
    let one = sim.daemon("one");
    let address = sim.address(one);
    let p = sim.program_with("p", one, |config| config.control = address);
    let ticket = sim.register(p, "p");
    sim.run_for(secs(1));
    assert_ne!(sim.collected(p).registrations.get(&ticket), Some(&Ok(())));
    assert!(sim.directory(one).is_empty());
}

#[test]
fn the_answer_of_the_daemon_comes_before_the_program_gives_up() {
    let mut sim = Sim::new(1);
    let [_, two, p, _] = programs(&mut sim);
    sim.freeze(two);
    let begun = sim.now().mono;
    let ticket = sim.send_within(p, "p", &["q"], "", secs(3));
    sim.run_for(secs(5));
    let told = &sim.collected(p).outcomes[&ticket];
    assert_eq!(told.outcomes[0].to, "q");
    assert!(reason(&sim, p, ticket).contains("d1 gave no receipt"));
    assert!(told.at <= begun + secs(3) + millis(10), "{:?}", told.at);
}

#[test]
fn a_frozen_daemon_is_waited_for_and_its_programs_stay() {
    let mut sim = Sim::new(1);
    let [one, two, p, _] = programs(&mut sim);
    sim.freeze(one);
    let ticket = sim.send(p, "p", &["q"], "");
    sim.run_for(secs(3));
    sim.thaw(one);
    sim.run_for(secs(1));
    assert_eq!(outcome(&sim, p, ticket), Outcome::Delivered);
    assert_eq!(changes(&sim, two, ChangeKind::Removed, "p"), 0);
}

#[test]
fn a_letter_without_an_outcome_at_the_daemon_ends_at_the_program() {
    let mut sim = Sim::new(1);
    let (one, _) = pair(&mut sim);
    let p = sim.program("p", one);
    sim.run_for(millis(100));
    sim.freeze(one);
    let begun = sim.now().mono;
    let ticket = sim.send_within(p, "p", &["b"], "", secs(3));
    sim.run_for(secs(5));
    assert_eq!(outcome(&sim, p, ticket), Outcome::Timeout);
    let told = sim.collected(p).outcomes[&ticket].at - begun;
    assert!(told < secs(4), "{told:?}");
}

#[test]
fn a_program_that_calls_again_keeps_its_agents_though_its_earlier_end_comes_late() {
    let mut sim = Sim::new(1);
    let [one, two, p, q] = programs(&mut sim);
    let mail = sim.send(q, "q", &["p"], "before");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, q, mail), Outcome::Delivered);
    sim.lose(p, one);
    sim.run_for(secs(1));
    for node in [one, two, p] {
        assert_eq!(sim.names(node), ["p", "q"]);
    }
    let mail = sim.send(q, "q", &["p"], "after");
    sim.run_for(millis(100));
    assert_eq!(outcome(&sim, q, mail), Outcome::Delivered);
    assert_eq!(sim.contents(p, "p"), ["before", "after"]);
    assert_eq!(sim.streams(one, p), 1);
}
