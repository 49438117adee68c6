//! HIAC devices in the fleet, with a station in memory and a simulated clock.

use std::collections::BTreeMap;
use std::time::Duration;

use fipa_acl::{Message, Performative, Text};
use fipa_gateway::{HiacGateway, HiacNames, HiacOutput};
use hiac::content::MessageKind;
use hiac::station::{Event, LinkConfig, LinkId, Options, Role, Station, StationConfig, Workgroup};
use hiac::{Address, Content, Mask};

const DRIVE: &str = "drive@robot1";
const LINK: LinkId = LinkId(1);

fn address(text: &str) -> Address {
    text.parse().unwrap()
}

/// The daemon's station with its gateway, and a device that employs nobody.
struct Robot {
    now: Duration,
    own: Station,
    gateway: HiacGateway,
    device: Station,
    heard: Vec<Event>,
}

impl Robot {
    fn new(abilities: u8) -> Robot {
        let own = address("20:C4:D2:00");
        let alias = address("20:C4:D2:20");
        let config = StationConfig {
            address: Some(own),
            workgroups: vec![Workgroup {
                address: own,
                mask: Mask::new(0xFF).unwrap(),
            }],
            aliases: vec![alias],
            ..StationConfig::default()
        };
        let names = HiacNames {
            aliases: BTreeMap::from([(alias, Text::from("operator@station"))]),
            ..HiacNames::default()
        };
        let device = StationConfig {
            name: Some("drive".to_owned()),
            abilities,
            ..StationConfig::default()
        };
        let mut robot = Robot {
            now: Duration::ZERO,
            own: Station::new(config),
            gateway: HiacGateway::new("robot1", names),
            device: Station::new(device),
            heard: Vec::new(),
        };
        let now = robot.now;
        robot
            .device
            .add_link(now, LINK, LinkConfig::stream(Role::Employee));
        robot
            .own
            .add_link(now, LINK, LinkConfig::stream(Role::Employer));
        assert_eq!(
            robot.settle(),
            [HiacOutput::Register {
                name: Text::from(DRIVE),
                description: "HIAC device 20:C4:D2:01".to_owned(),
            }]
        );
        robot.heard.clear();
        robot
    }

    /// Carries everything, and says what the gateway wants done.
    fn settle(&mut self) -> Vec<HiacOutput> {
        let mut moved = true;
        while moved {
            moved = false;
            if let Some(octets) = self.own.poll_transmit(LINK) {
                self.own.transmitted(self.now, LINK);
                self.device.received(self.now, LINK, &octets);
                moved = true;
            }
            if let Some(octets) = self.device.poll_transmit(LINK) {
                self.device.transmitted(self.now, LINK);
                self.own.received(self.now, LINK, &octets);
                moved = true;
            }
            while let Some(event) = self.own.poll_event() {
                self.gateway.event(self.now, &mut self.own, event);
                moved = true;
            }
            self.heard
                .extend(std::iter::from_fn(|| self.device.poll_event()));
        }
        std::iter::from_fn(|| self.gateway.poll_output()).collect()
    }

    fn deliver(&mut self, message: &Message) -> Vec<HiacOutput> {
        self.gateway
            .deliver(self.now, &mut self.own, DRIVE, message);
        self.settle()
    }

    fn pass(&mut self, time: Duration) -> Vec<HiacOutput> {
        let mut outputs = Vec::new();
        let end = self.now + time;
        while self.now < end {
            self.now += Duration::from_millis(100);
            self.own.handle_timeout(self.now);
            self.device.handle_timeout(self.now);
            self.gateway.handle_timeout(self.now, &mut self.own);
            outputs.extend(self.settle());
        }
        outputs
    }

    fn device_says(&mut self, to: &str, content: &Content<'_>) -> Vec<HiacOutput> {
        let sent = self
            .device
            .send(self.now, None, address(to), content, Options::CONFIRMED);
        sent.unwrap();
        self.settle()
    }

    /// The last message that the device heard.
    fn heard(&self) -> (MessageKind, Vec<u8>, hiac::station::Sender, u8) {
        let message = |event: &Event| match event {
            Event::Message {
                from,
                kind,
                reference,
                octets,
            } => Some((*kind, octets.clone(), *from, *reference)),
            _ => None,
        };
        self.heard
            .iter()
            .rev()
            .find_map(message)
            .expect("a message")
    }
}

fn message(performative: Performative, content: &str) -> Message {
    Message::new(performative)
        .from_agent("m@robot2")
        .to(DRIVE)
        .content(content.as_bytes().to_vec())
        .conversation_id("c-1")
}

fn answer(message: &Message, performative: Performative, content: &str) -> HiacOutput {
    let mut answer = message.reply(performative).from_agent(DRIVE);
    if !content.is_empty() {
        answer = answer.content(content.as_bytes().to_vec());
    }
    HiacOutput::Send(Box::new(answer))
}

fn said(kind: MessageKind, reference: u8, octets: &[u8]) -> Content<'_> {
    Content::Message {
        kind,
        reference,
        octets,
    }
}

#[test]
fn a_request_is_a_command_agreed_to_when_written_and_done_when_confirmed() {
    for abilities in [3, 0] {
        let mut robot = Robot::new(abilities);
        let request = message(Performative::Request, "stop");
        assert_eq!(
            robot.deliver(&request),
            [
                answer(&request, Performative::Agree, ""),
                answer(&request, Performative::Inform, "done"),
            ]
        );
        let (kind, octets, _, reference) = robot.heard();
        assert_eq!(
            (kind, &octets[..], reference),
            (MessageKind::Command, &b"stop"[..], 0)
        );
    }
}

#[test]
fn a_query_is_a_question_and_its_answer_an_inform() {
    let mut robot = Robot::new(3);
    let query = message(Performative::QueryRef, "where");
    assert_eq!(robot.deliver(&query), []);
    let (kind, _, from, reference) = robot.heard();
    assert_eq!(kind, MessageKind::Question);
    robot
        .device
        .reply(robot.now, &from, MessageKind::Answer, reference, b"3 4")
        .unwrap();
    assert_eq!(
        robot.settle(),
        [answer(&query, Performative::Inform, "3 4")]
    );
}

#[test]
fn silence_refusal_and_loss_are_failures() {
    let mut robot = Robot::new(3);
    let query = message(Performative::QueryIf, "where");
    robot.deliver(&query);
    let failed = answer(&query, Performative::Failure, "no answer came in time");
    assert_eq!(robot.pass(Duration::from_secs(6)), [failed]);

    let subscription = message(Performative::Subscribe, "");
    robot.deliver(&subscription);
    robot.deliver(&query);
    robot.own.remove_link(robot.now, LINK);
    let outputs = robot.settle();
    assert!(outputs.contains(&answer(
        &query,
        Performative::Failure,
        "the connection was lost"
    )));
    assert!(outputs.contains(&answer(
        &subscription,
        Performative::Failure,
        "the device is gone"
    )));
    assert!(outputs.contains(&HiacOutput::Deregister(Text::from(DRIVE))));
    let late = answer(&query, Performative::Failure, "the device is gone");
    assert_eq!(robot.deliver(&query), [late]);
}

#[test]
fn a_subscriber_hears_signals_information_and_warnings_until_it_cancels() {
    let mut robot = Robot::new(3);
    let subscription = message(Performative::Subscribe, "");
    assert_eq!(
        robot.deliver(&subscription),
        [answer(&subscription, Performative::Agree, "")]
    );
    let signal = Content::Signal {
        number: 7,
        arguments: &[0x0A, 0xFF],
    };
    let own = "20:C4:D2:00";
    assert_eq!(
        robot.device_says(own, &signal),
        [answer(&subscription, Performative::Inform, "7 0aff")]
    );
    assert_eq!(
        robot.device_says(own, &said(MessageKind::Warning, 0, b"hot")),
        [answer(&subscription, Performative::Inform, "hot")]
    );
    let cancel = message(Performative::Cancel, "");
    assert_eq!(
        robot.deliver(&cancel),
        [answer(&cancel, Performative::Inform, "cancelled")]
    );
    assert_eq!(robot.device_says(own, &signal), []);
    assert_eq!(
        robot.deliver(&cancel),
        [answer(&cancel, Performative::Failure, "nothing to cancel")]
    );
}

#[test]
fn a_device_asks_an_agent_by_its_alias_and_is_answered_or_warned() {
    let mut robot = Robot::new(3);
    let alias = address("20:C4:D2:20");
    let ask = |robot: &mut Robot| {
        let now = robot.now;
        let asked = robot
            .device
            .question(now, None, alias, b"may I?", Options::CONFIRMED);
        let ticket = asked.unwrap();
        let outputs = robot.settle();
        let [HiacOutput::Send(query)] = &outputs[..] else {
            panic!("{outputs:?}");
        };
        assert_eq!(query.performative, Performative::QueryRef);
        assert_eq!(query.receiver[0].name.as_str(), "operator@station");
        (ticket, (**query).clone())
    };
    let answered = |robot: &Robot, ticket| {
        let told = |event: &Event| match event {
            Event::Answered {
                ticket: known,
                kind,
                octets,
            } if *known == ticket => Some((*kind, String::from_utf8_lossy(octets).into_owned())),
            _ => None,
        };
        robot.heard.iter().find_map(told)
    };
    let (ticket, query) = ask(&mut robot);
    let inform = query
        .reply(Performative::Inform)
        .from_agent("operator@station");
    robot.deliver(&inform.content("yes"));
    assert_eq!(
        answered(&robot, ticket),
        Some((MessageKind::Answer, "yes".to_owned()))
    );

    let (ticket, query) = ask(&mut robot);
    let refusal = query
        .reply(Performative::Refuse)
        .from_agent("operator@station");
    robot.deliver(&refusal.content("no"));
    assert_eq!(
        answered(&robot, ticket),
        Some((MessageKind::Warning, "refuse no".to_owned()))
    );

    let (ticket, query) = ask(&mut robot);
    robot
        .gateway
        .undelivered(robot.now, &mut robot.own, &query, "unknown");
    robot.settle();
    assert_eq!(
        answered(&robot, ticket),
        Some((MessageKind::Warning, "unknown".to_owned()))
    );

    let (ticket, _) = ask(&mut robot);
    robot.pass(Duration::from_secs(5));
    assert_eq!(
        answered(&robot, ticket),
        Some((MessageKind::Warning, "no answer came in time".to_owned()))
    );

    let outputs = robot.device_says("20:C4:D2:20", &said(MessageKind::Information, 0, b"dry"));
    let [HiacOutput::Send(inform)] = &outputs[..] else {
        panic!("{outputs:?}");
    };
    assert_eq!(inform.performative, Performative::Inform);
    assert_eq!(inform.content.as_deref(), Some(&b"dry"[..]));
}

#[test]
fn an_address_that_is_neither_device_nor_alias_is_not_there() {
    let mut robot = Robot::new(3);
    let now = robot.now;
    let to = address("20:C4:D2:21");
    let content = said(MessageKind::Information, 0, b"x");
    // The colleague's connection is asked for first, and nobody answers that.
    let ticket = robot
        .device
        .send(now, None, to, &content, Options::CONFIRMED)
        .unwrap();
    robot.pass(Duration::from_secs(6));
    let failed = |event: &Event| matches!(event, Event::Failed(known, _) if *known == ticket);
    assert!(robot.heard.iter().any(failed));
}
