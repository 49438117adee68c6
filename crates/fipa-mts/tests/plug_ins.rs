//! Letters by transports that are plugged in: handed over whole, one by one.
mod support;

use std::time::Duration;

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Representation, Slots, Text};
use fipa_codec::{Limits, decode_letter};
use fipa_directory::{InstanceId, MESSAGE_TRANSPORT, Now};
use fipa_link::{Frame, Outcome, ReceiverOutcome, Role};
use fipa_mts::{
    Config, Machine, Mts, Notice, Output, PostFailure, Registration, SentLetter, Submission,
    TakenOver,
};

use support::{Raw, entry, recorded, secs};

/// A service that has UDT plugged in, with the agent `a`.
struct Service {
    mts: Mts,
    now: Now,
}

impl Service {
    fn new(schemes: &[&'static str]) -> Service {
        let mut config = Config::new(InstanceId::from_bytes([7; 16]), "robot1");
        config.schemes = schemes.iter().map(|s| Text::from_static(s)).collect();
        config.endpoints = ["tcp://10.0.0.5:4100", "udt://10.0.0.5:4101"]
            .map(|address| address.parse().unwrap())
            .into();
        let mut mts = Mts::new(config);
        mts.register(Now::default(), 0, Registration::new("a"));
        Service {
            mts,
            now: Now::default(),
        }
    }

    fn outputs(&mut self) -> Vec<Output> {
        std::iter::from_fn(|| self.mts.poll_output()).collect()
    }

    fn submit(&mut self, to: impl Into<AgentId>) {
        let envelope = Envelope::new(Slots {
            to: vec![to.into()],
            from: Some(AgentId::new("a")),
            acl_representation: Some(Representation::BitEfficient),
            date: Some(FipaTime::from_unix_millis(0)),
            ..Slots::default()
        });
        let payload = Bytes::from_static(b"hello");
        let letter = Letter { envelope, payload };
        self.mts
            .submit(self.now, Submission::new(1, letter, secs(10)));
    }

    /// The letters that are to be handed over.
    fn sent(&mut self) -> Vec<SentLetter> {
        let outputs = self.outputs().into_iter();
        let sent = outputs.filter_map(|output| match output {
            Output::Send(letter) => Some(*letter),
            _ => None,
        });
        sent.collect()
    }

    fn only_sent(&mut self) -> SentLetter {
        let mut sent = self.sent();
        assert_eq!(sent.len(), 1, "{sent:?}");
        sent.remove(0)
    }

    fn answer(&mut self, letter: &SentLetter, result: Result<(), PostFailure>) {
        let result = result.map(|()| TakenOver::default());
        self.mts.posted(self.now, letter.post, result);
    }

    fn outcome(&mut self) -> ReceiverOutcome {
        let outputs = self.outputs().into_iter();
        let mut outcomes = outputs.filter_map(|output| match output {
            Output::Outcome { outcomes, .. } => Some(outcomes),
            _ => None,
        });
        outcomes.next().expect("no outcome").remove(0)
    }

    /// What is told of letters that are lost.
    fn lost(&mut self) -> Vec<String> {
        let outputs = self.outputs().into_iter();
        let lost = outputs.filter_map(|output| match output {
            Output::Notice(notice @ Notice::LetterLost { .. }) => Some(notice.to_string()),
            _ => None,
        });
        lost.collect()
    }

    fn came(&mut self, letter: impl Into<Bytes>) {
        let from = Text::from_static("udt://10.0.0.9:4711");
        self.mts.letter_came(self.now, from, letter.into(), "udt");
    }
}

fn unreached() -> Result<(), PostFailure> {
    Err(PostFailure::Unreached("nobody is there".to_owned()))
}

#[test]
fn an_announced_agent_at_such_an_address_is_sent_its_letter_whole() {
    let mut service = Service::new(&["udt"]);
    let b = entry("b", &[("udt://10.0.0.9:9999", MESSAGE_TRANSPORT)]);
    service.mts.neighbour_found(service.now, b);
    service.submit("b");
    let sent = service.only_sent();
    assert_eq!(sent.address.to_string(), "udt://10.0.0.9:9999");
    assert_eq!(sent.timeout, secs(10));
    let letter = decode_letter(&sent.letter, &Limits::default()).unwrap();
    assert_eq!(letter.payload, "hello");
    assert_eq!(letter.envelope.intended_receiver(), [AgentId::new("b")]);
    service.answer(&sent, Ok(()));
    let told = service.outcome();
    assert_eq!(told.outcome, Outcome::Sent);
    assert_eq!(told.via.as_deref(), Some("udt://10.0.0.9:9999"));
}

#[test]
fn an_address_in_the_agent_identifier_is_enough() {
    let mut service = Service::new(&["udt"]);
    service.submit(AgentId::new("b").address("udt://10.0.0.9:9999"));
    let sent = service.only_sent();
    service.answer(&sent, Ok(()));
    assert_eq!(service.outcome().outcome, Outcome::Sent);
}

#[test]
fn letters_for_one_receiver_are_handed_over_one_after_the_other() {
    let mut service = Service::new(&["udt"]);
    let b = entry("b", &[("udt://10.0.0.9:9999", MESSAGE_TRANSPORT)]);
    service.mts.neighbour_found(service.now, b);
    service.submit("b");
    service.submit("b");
    let first = service.only_sent();
    service.answer(&first, Ok(()));
    assert_ne!(service.only_sent().post, first.post);
}

#[test]
fn who_is_not_reached_is_tried_twice_and_then_at_the_next_place() {
    let mut service = Service::new(&["udt"]);
    let places = [
        ("udt://10.0.0.9:9999", MESSAGE_TRANSPORT),
        ("udt://10.0.0.8:9999", MESSAGE_TRANSPORT),
    ];
    service
        .mts
        .neighbour_found(service.now, entry("b", &places));
    service.submit("b");
    for place in ["10.0.0.9", "10.0.0.9", "10.0.0.8", "10.0.0.8"] {
        let sent = service.only_sent();
        assert_eq!(sent.address.host(), Some(place));
        service.answer(&sent, unreached());
    }
    let told = service.outcome();
    assert_eq!(told.outcome, Outcome::Timeout);
    assert!(told.reason.contains("10.0.0.8:9999: nobody is there"));
}

#[test]
fn a_letter_that_may_have_arrived_is_not_sent_again() {
    let mut service = Service::new(&["udt"]);
    service.submit(AgentId::new("b").address("udt://10.0.0.9:9999"));
    let sent = service.only_sent();
    let failure = PostFailure::Unanswered("it fell silent".to_owned());
    service.answer(&sent, Err(failure));
    let told = service.outcome();
    assert_eq!(told.outcome, Outcome::Timeout);
    assert!(told.reason.ends_with("it fell silent"), "{told:?}");
}

#[test]
fn without_the_plug_in_such_an_address_is_none() {
    let mut service = Service::new(&[]);
    service.submit(AgentId::new("b").address("udt://10.0.0.9:9999"));
    assert_eq!(service.outcome().outcome, Outcome::Unknown);
    let b = entry("b", &[("udt://10.0.0.9:9999", MESSAGE_TRANSPORT)]);
    service.mts.neighbour_found(service.now, b);
    service.submit("b");
    let told = service.outcome();
    assert_eq!(told.outcome, Outcome::Refused);
    assert_eq!(
        told.reason,
        "udt://10.0.0.9:9999: there is no such transport here"
    );
}

#[test]
fn our_agents_are_listed_at_such_endpoints_and_peers_are_not_told_to_dial_them() {
    let service = Service::new(&["udt"]);
    let record = service.mts.directory().iter().next().unwrap();
    let locations: Vec<&str> = record
        .entry
        .locations
        .iter()
        .map(|location| location.address.as_str())
        .collect();
    assert_eq!(locations, ["tcp://10.0.0.5:4100", "udt://10.0.0.5:4101"]);

    let mut raw = Raw::new(Role::Daemon);
    let endpoints = service.mts.config().endpoints.clone();
    raw.mts.set_endpoints(raw.now, endpoints);
    raw.exchange();
    let told = raw.heard.iter().find_map(|frame| match frame {
        Frame::Platforms(platforms) => Some(&platforms[0].addresses),
        _ => None,
    });
    assert_eq!(told.unwrap(), &["tcp://10.0.0.5:4100"]);
}

#[test]
fn a_letter_that_came_whole_is_taken_in_or_told_to_be_lost() {
    let mut service = Service::new(&["udt"]);
    service
        .mts
        .register(service.now, 0, Registration::new("agent-b"));
    let letter = recorded("mts/sent_00_to_agent-b.bin");
    service.came(letter.clone());
    assert!(service.mts.take_mail("agent-b").is_some());
    assert_eq!(service.lost(), [] as [String; 0]);
    service.came(recorded("mts/sent_02_to_agent-a.bin"));
    // Whoever moves may turn up within a second.
    service.now.mono += Duration::from_secs(30);
    service.mts.handle_timeout(service.now);
    service.came("no letter");
    service.came(letter.slice(..20));
    let lost = service.lost();
    assert!(lost.len() >= 2, "{lost:?}");
    for lost in lost {
        assert!(lost.contains("from udt://10.0.0.9:4711 is lost"), "{lost}");
    }
}
