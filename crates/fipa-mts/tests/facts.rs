//! What people who look for a fault are told.
mod support;

use fipa_directory::InstanceId;
use fipa_link::{Facts, Frame, Role};
use fipa_mts::{Machine, Notice, Output, Registration};
use fipa_sim::Sim;

use support::{Raw, fleet, secs};

fn told(raw: &Raw) -> Vec<&Facts> {
    let facts = raw.heard.iter().filter_map(|frame| match frame {
        Frame::Facts(facts) => Some(facts),
        _ => None,
    });
    facts.collect()
}

#[test]
fn a_program_that_asks_is_told_and_a_daemon_is_not() {
    let mut raw = Raw::new(Role::Program);
    raw.say(Frame::AskFacts);
    let [facts] = told(&raw)[..] else {
        panic!("{:?}", raw.heard);
    };
    assert_eq!(facts.name, "here");
    assert_eq!(facts.instance, InstanceId::from_bytes([1; 16]));
    assert!(facts.peers.is_empty());

    let mut raw = Raw::new(Role::Daemon);
    raw.say(Frame::AskFacts);
    assert_eq!(told(&raw).len(), 0);
    assert_eq!(raw.mts.facts(raw.now).peers.len(), 1);
}

#[test]
fn linked_peers_are_told_with_when_they_were_heard_and_others_with_why_they_are_not_linked() {
    let mut sim = Sim::new(1);
    let nodes = fleet(&mut sim, 2);
    let nobody = "tcp://10.9.9.9:1".parse().unwrap();
    sim.add_peer(nodes[0], nobody);
    sim.run_for(secs(30));
    let facts = sim.mts(nodes[0]).facts(sim.now());
    let linked: Vec<_> = facts
        .peers
        .iter()
        .filter(|p| p.instance.is_some())
        .collect();
    assert_eq!(linked.len(), 1);
    assert_eq!(linked[0].instance, Some(sim.instance_of(nodes[1])));
    assert!(linked[0].announced);
    // A heartbeat comes each 10 s at least.
    assert!(linked[0].heard_millis.is_some_and(|ms| ms <= 10_100));
    let sought: Vec<_> = facts
        .peers
        .iter()
        .filter(|p| p.instance.is_none())
        .collect();
    assert_eq!(sought.len(), 1);
    assert_eq!(sought[0].addresses, ["tcp://10.9.9.9:1"]);
    assert_eq!(sought[0].heard_millis, None);
    assert!(!sought[0].error.is_empty());
}

#[test]
fn an_agent_is_left_out_until_it_is_announced_or_gone() {
    let mut raw = Raw::new(Role::Program);
    let now = raw.now;
    for (ticket, name) in [(1, "one"), (2, "two")] {
        raw.mts.register(now, ticket, Registration::new(name));
    }
    for name in ["one", "two", "nobody"] {
        raw.mts
            .not_announced(name.into(), "its name is too long".into());
    }
    raw.exchange();
    let notices = raw.outputs.iter().filter_map(|output| match output {
        Output::Notice(Notice::NotAnnounced { name, .. }) => Some(name.as_str()),
        _ => None,
    });
    assert_eq!(notices.collect::<Vec<_>>(), ["one", "two"]);
    let left_out = |raw: &Raw| raw.mts.facts(now).left_out.len();
    assert_eq!(left_out(&raw), 2);
    raw.mts.is_announced("one");
    assert_eq!(left_out(&raw), 1);
    raw.mts.deregister(now, "two");
    assert_eq!(left_out(&raw), 0);
}
