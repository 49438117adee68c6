//! Notices of failure: senders behind other services are told what became of their letters.
mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Message, Performative, Representation, Slots};
use fipa_codec::{
    Dialect, EnvelopeRepresentation, Limits, Output as Encoded, decode_letter, decode_payload,
    encode_letter_as, encode_message_as, payload_representation,
};
use fipa_directory::MESSAGE_TRANSPORT;
use fipa_mts::{Action, DeliveryFailure, Rule, Rules};
use fipa_sim::{NodeId, Sim, Then};

use support::{entry, lost, millis, recorded, secs};

/// How a robot of another make writes.
#[derive(Clone, Copy)]
enum Make {
    Cpp,
    Bridge,
}

impl Make {
    fn dialect(self) -> (Dialect, EnvelopeRepresentation, Representation) {
        match self {
            Make::Cpp => (
                Dialect::Cpp,
                EnvelopeRepresentation::BitEfficient,
                Representation::BitEfficient,
            ),
            Make::Bridge => (
                Dialect::JadeBridge,
                EnvelopeRepresentation::Xml,
                Representation::String,
            ),
        }
    }
}

/// A daemon, and the agent `x` of a robot that it knows.
fn here_and_robot(sim: &mut Sim, make: Make) -> (NodeId, NodeId) {
    let (here, robot) = (sim.daemon("here"), sim.robot("robot"));
    let signature = match make {
        Make::Cpp => MESSAGE_TRANSPORT,
        Make::Bridge => "JadeProxyAgent",
    };
    sim.announce(robot, &entry("x", &[("tcp://robot:9999", signature)]));
    (here, robot)
}

fn request() -> Message {
    Message::new(Performative::Request)
        .from_agent("x")
        .to("nobody")
        .protocol("fipa-request")
        .conversation_id("c-1")
        .reply_with("r-1")
        .content("(never looked into")
}

fn envelope(from: AgentId, to: &[&str], representation: Representation) -> Envelope {
    let to: Vec<AgentId> = to.iter().map(|name| AgentId::new(*name)).collect();
    Envelope::new(Slots {
        to: to.clone(),
        from: Some(from),
        acl_representation: Some(representation),
        date: Some(FipaTime::from_unix_millis(0)),
        intended_receiver: to,
        ..Slots::default()
    })
}

fn octets(make: Make, from: AgentId, to: &[&str], message: &Message) -> Bytes {
    let (dialect, form, representation) = make.dialect();
    let mut payload = Encoded::new();
    encode_message_as(dialect, &representation, message, &mut payload).unwrap();
    let payload = payload.take_bytes();
    let mut envelope = envelope(from, to, representation);
    envelope.base.payload_length = Some(payload.len() as u64);
    let mut octets = Encoded::new();
    encode_letter_as(dialect, form, &Letter { envelope, payload }, &mut octets).unwrap();
    octets.take_bytes()
}

/// Has the robot write a letter; all letters that have been written to it then. A service of ours
/// greets first where it does not know who listens.
fn written_back(sim: &mut Sim, robot: NodeId, to: NodeId, octets: Bytes) -> Vec<Letter> {
    let address = sim.address(to);
    sim.robot_writes(robot, address, octets, Then::Ends);
    sim.run_for(secs(15));
    let written = sim.robot_letters(robot).into_iter();
    written
        .filter(|octets| !octets.starts_with(&fipa_link::PREAMBLE))
        .map(|octets| decode_letter(&octets, &Limits::default()).unwrap())
        .collect()
}

fn message_in(letter: &Letter) -> Message {
    decode_payload(&letter.envelope, &letter.payload, &Limits::default()).unwrap()
}

fn reason_in(letter: &Letter) -> String {
    let failure = DeliveryFailure::of(&message_in(letter)).unwrap();
    failure.reason.to_string()
}

#[test]
fn the_sender_is_told_of_each_receiver_in_its_own_way_of_writing() {
    for make in [Make::Cpp, Make::Bridge] {
        let mut sim = Sim::new(1);
        let (here, robot) = here_and_robot(&mut sim, make);
        sim.register(here, "b");
        let to = ["nobody", "b", "nowhere"];
        let letter = octets(make, AgentId::new("x"), &to, &request());
        sim.robot_writes(robot, sim.address(here), letter, Then::Ends);
        assert!(sim.run_until_quiet(secs(5)));
        assert_eq!(sim.collected(here).mail["b"].len(), 1);
        let (_, form, representation) = make.dialect();
        let written = sim.robot_letters(robot);
        let mut receivers = Vec::new();
        for octets in &written {
            assert_eq!(EnvelopeRepresentation::detect(octets), Some(form));
            let letter = decode_letter(octets, &Limits::default()).unwrap();
            let (envelope, payload) = (&letter.envelope, &letter.payload);
            assert_eq!(
                payload_representation(envelope, payload),
                Some(representation.clone())
            );
            assert_eq!(envelope.from().unwrap().name, "here");
            assert_eq!(envelope.intended_receiver(), [AgentId::new("x")]);
            let stamps: Vec<_> = envelope.stamps().map(|stamp| stamp.by.as_str()).collect();
            assert_eq!(stamps, ["here"]);
            let notice = message_in(&letter);
            assert_eq!(notice.sender, Some(AgentId::new("here")));
            assert_eq!(notice.receiver, [AgentId::new("x")]);
            assert_eq!(notice.in_reply_to, Some("r-1".into()));
            assert_eq!(notice.conversation_id, Some("c-1".into()));
            assert_eq!(notice.protocol.as_deref(), Some("fipa-request"));
            assert_eq!(notice.language, Some("fipa-sl0".into()));
            assert_eq!(notice.ontology, Some("fipa-agent-management".into()));
            let name = DeliveryFailure::of(&notice).unwrap().receivers[0]
                .name
                .clone();
            assert_eq!(
                notice.content_str().unwrap(),
                format!(
                    "((action (agent-identifier :name here) (deliver (agent-identifier :name {name}))) \
                     (MTS-error (agent-identifier :name {name}) \
                     (internal-error \"no agent of this name is known\")))"
                )
            );
            receivers.push(name.to_string());
        }
        receivers.sort();
        assert_eq!(receivers, ["nobody", "nowhere"]);
    }
}

#[test]
fn who_may_not_send_is_told_once_a_letter_however_many_it_is_for() {
    let mut sim = Sim::new(1);
    let mut deny = Rule::deny([Action::Send]);
    deny.to = Some("agent.*".parse().unwrap());
    let rules = Rules::new([deny]);
    let (here, robot) = (
        sim.daemon_with("here", |config| config.rules = rules),
        sim.robot("robot"),
    );
    let to: Vec<String> = (0..100).map(|n| format!("agent{n}")).collect();
    let to: Vec<&str> = to.iter().map(String::as_str).chain(["nobody"]).collect();
    let from = AgentId::new("stranger").address(sim.address(robot).to_text());
    let letter = octets(Make::Cpp, from, &to, &request());
    let mut told: Vec<String> = written_back(&mut sim, robot, here, letter)
        .iter()
        .map(reason_in)
        .collect();
    told.sort();
    let denied = "rule 1 of the configuration denies stranger to send";
    assert_eq!(told, ["no agent of this name is known", denied]);
}

#[test]
fn a_sender_whom_only_its_address_tells_of_is_told_there() {
    let mut sim = Sim::new(1);
    let (here, robot) = (sim.daemon("here"), sim.robot("robot"));
    let address = sim.address(robot).to_text();
    let from = AgentId::new("stranger").address(address);
    let letter = octets(Make::Cpp, from, &["nobody"], &request());
    let told = written_back(&mut sim, robot, here, letter);
    assert_eq!(told.len(), 1);
    assert_eq!(reason_in(&told[0]), "no agent of this name is known");
}

#[test]
fn what_went_wrong_at_another_daemon_is_told_by_the_one_that_took_the_letter_in() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim, Make::Cpp);
    let there = sim.daemon_with("there", |config| config.mailbox_letters = 1);
    sim.register(there, "b");
    sim.set_reading(there, false);
    sim.add_peer(here, sim.address(there));
    sim.run_for(secs(1));
    let letter = octets(Make::Cpp, AgentId::new("x"), &["b"], &request());
    let first = written_back(&mut sim, robot, here, letter.clone());
    assert_eq!(first.len(), 0);
    let told = written_back(&mut sim, robot, here, letter);
    assert_eq!(reason_in(&told[0]), "the agent's mailbox is full");
}

#[test]
fn a_letter_that_may_have_arrived_is_not_called_undelivered_without_saying_so() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim, Make::Cpp);
    let there = sim.daemon("there");
    sim.register(there, "b");
    sim.add_peer(here, sim.address(there));
    sim.run_for(secs(1));
    sim.freeze(there);
    let letter = octets(Make::Cpp, AgentId::new("x"), &["b"], &request());
    sim.robot_writes(robot, sim.address(here), letter, Then::Ends);
    sim.run_for(secs(20));
    let told = sim.robot_letters(robot);
    let told = decode_letter(&told[0], &Limits::default()).unwrap();
    assert!(
        reason_in(&told).starts_with("timeout: "),
        "{}",
        reason_in(&told)
    );
}

#[test]
fn a_sender_that_does_not_want_to_know_and_a_failure_are_not_answered() {
    let failure = Message {
        performative: Performative::Failure,
        ..request()
    };
    let ignoring = request().user_defined("X-JADE-ignore-failure", "true");
    for make in [Make::Cpp, Make::Bridge] {
        for message in [&failure, &ignoring] {
            let mut sim = Sim::new(1);
            let (here, robot) = here_and_robot(&mut sim, make);
            let letter = octets(make, AgentId::new("x"), &["nobody"], message);
            assert_eq!(written_back(&mut sim, robot, here, letter).len(), 0);
            assert_eq!(lost(&sim, here).len(), 1);
        }
    }
}

#[test]
fn the_notice_of_another_service_to_nobody_is_not_answered() {
    let mut sim = Sim::new(1);
    let (here, robot) = (sim.daemon("here"), sim.robot("robot"));
    sim.announce(
        robot,
        &entry("mts-0", &[("tcp://robot:9999", MESSAGE_TRANSPORT)]),
    );
    let notice = recorded("mts/sent_02_to_agent-a.bin");
    assert_eq!(written_back(&mut sim, robot, here, notice).len(), 0);
    assert_eq!(lost(&sim, here).len(), 1);
}

#[test]
fn a_letter_that_travels_in_circles_is_not_answered() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim, Make::Cpp);
    let service = [("tcp://robot:9999", MESSAGE_TRANSPORT)];
    sim.announce(robot, &entry("y", &service));
    let letter = octets(Make::Cpp, AgentId::new("x"), &["y"], &request());
    sim.robot_writes(robot, sim.address(here), letter, Then::Ends);
    assert!(sim.run_until_quiet(secs(5)));
    let passed_on = sim.robot_letters(robot).remove(0);
    // The robot sends it back to where it has been, and gets nothing more.
    assert_eq!(written_back(&mut sim, robot, here, passed_on).len(), 1);
    let lost = lost(&sim, here);
    assert!(lost.len() == 1 && lost[0].contains("circles"), "{lost:?}");
}

#[test]
fn an_unreadable_payload_gives_no_notice_but_a_line_for_the_log() {
    let mut sim = Sim::new(1);
    let (here, robot) = here_and_robot(&mut sim, Make::Cpp);
    let (dialect, form, representation) = Make::Cpp.dialect();
    let letter = Letter {
        envelope: envelope(AgentId::new("x"), &["nobody"], representation),
        payload: Bytes::from_static(b"no message"),
    };
    let mut octets = Encoded::new();
    encode_letter_as(dialect, form, &letter, &mut octets).unwrap();
    assert_eq!(
        written_back(&mut sim, robot, here, octets.take_bytes()).len(),
        0
    );
    let lost = lost(&sim, here);
    assert_eq!(lost.len(), 2);
    assert!(lost[1].contains("its sender is not told"), "{lost:?}");
}

#[test]
fn a_notice_that_reaches_nobody_is_told_to_the_log_and_to_nobody_else() {
    let mut sim = Sim::new(1);
    let (here, robot) = (sim.daemon("here"), sim.robot("robot"));
    let letter = octets(Make::Cpp, AgentId::new("stranger"), &["nobody"], &request());
    assert_eq!(written_back(&mut sim, robot, here, letter).len(), 0);
    assert_eq!(lost(&sim, here).len(), 1);
    let told = sim.collected(here).notices.iter();
    let unsent = told.filter(|(_, notice)| notice.to_string().contains("could not be told"));
    assert_eq!(unsent.count(), 1);
    assert_eq!(sim.mts(here).letters_under_way(), 0);
}

#[test]
fn an_agent_of_ours_that_was_told_the_outcome_gets_no_notice() {
    let mut sim = Sim::new(1);
    let here = sim.daemon("here");
    sim.register(here, "a");
    let p = sim.program("p", here);
    sim.register(p, "p");
    sim.run_for(millis(100));
    for (node, name) in [(here, "a"), (p, "p")] {
        let ticket = sim.send(node, name, &["nobody"], "");
        sim.run_for(millis(100));
        assert!(!sim.outcomes(node, ticket)[0].outcome.is_success());
        assert_eq!(sim.contents(node, name), [""; 0]);
    }
}
