//! A link over a connection with lanes: letters of each urgency on a stream of their own.

mod support;

use std::collections::BTreeMap;

use bytes::{Bytes, BytesMut};
use fipa_acl::{AgentId, Envelope, Letter, Representation, Slots, Text};
use fipa_directory::{Entry, InstanceId, Now, Source, State};
use fipa_link::{DirectoryFrame, DirectoryItem, Frame, Hello, Link, LinkConfig, Role};
use fipa_mts::{Config, ConnId, Connected, Machine, Mts, Registration, Submission, Urgency};

use self::support::secs;

const CONN: ConnId = ConnId(1);
const PARTNER: InstanceId = InstanceId::from_bytes([9; 16]);

/// A service, and a partner that knows how to speak on lanes.
struct Pair {
    mts: Mts,
    partner: Link,
    now: Now,
    tickets: u64,
}

impl Pair {
    fn new() -> Pair {
        let now = Now {
            mono: secs(1000),
            unix_millis: 1_795_341_600_000,
        };
        let mut mts = Mts::new(Config::new(InstanceId::from_bytes([1; 16]), "here"));
        mts.register(now, 1, Registration::new("a"));
        mts.connected(
            now,
            Connected {
                conn: CONN,
                dialled: None,
                control: false,
                same_host: false,
                remote: Text::from_static("quic://10.0.0.7:50000"),
                identity: None,
                lanes: true,
            },
        );
        let mut config = LinkConfig::new(Hello {
            version: Hello::VERSION,
            role: Role::Daemon,
            instance: PARTNER,
            name: Text::from("partner"),
            scope: Text::default(),
            endpoints: Vec::new(),
            max_letter: 100 << 20,
            unix_millis: now.unix_millis,
            checks: false,
        });
        config.lanes = true;
        let mut partner = Link::new(config, now);
        partner.send(
            now,
            Frame::Directory(DirectoryFrame {
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
            }),
        );
        Pair {
            mts,
            partner,
            now,
            tickets: 0,
        }
    }

    /// A service that has greeted.
    fn greeted() -> Pair {
        let mut pair = Pair::new();
        pair.tell_main();
        let mut said = BytesMut::new();
        while let Some(part) = pair.mts.poll_transmit(pair.now, CONN) {
            said.extend_from_slice(&part);
        }
        while pair.partner.receive(pair.now, &mut said).unwrap().is_some() {}
        pair
    }

    fn tell_main(&mut self) {
        let mut octets = BytesMut::new();
        while let Some(part) = self.partner.poll_transmit() {
            octets.extend_from_slice(&part);
        }
        self.mts.received(self.now, CONN, &mut octets);
        assert!(octets.is_empty());
    }

    fn send(&mut self, urgency: u8, octets: usize) {
        self.tickets += 1;
        let letter = letter("a", "b", urgency, octets);
        let submission = Submission::new(self.tickets, letter, secs(10));
        self.mts.submit(self.now, submission);
    }

    /// The payloads' sizes of what is written on a lane now.
    fn written_on(&mut self, urgency: usize) -> usize {
        let lane = Urgency::ALL[urgency];
        let next = || self.mts.poll_transmit_on(self.now, CONN, lane);
        std::iter::from_fn(next).map(|part| part.len()).sum()
    }
}

fn letter(from: &str, to: &str, urgency: u8, octets: usize) -> Letter {
    let to = vec![AgentId::new(to)];
    Letter {
        envelope: Envelope::new(Slots {
            to: to.clone(),
            from: Some(AgentId::new(from)),
            acl_representation: Some(Representation::BitEfficient),
            date: Some(fipa_acl::FipaTime::from_unix_millis(0)),
            intended_receiver: to,
            user_defined: vec![(Text::from("Priority"), Text::from(urgency.to_string()))],
            ..Slots::default()
        }),
        payload: Bytes::from(vec![b'x'; octets]),
    }
}

#[test]
fn letters_of_each_urgency_go_on_a_lane_of_their_own() {
    let mut pair = Pair::greeted();
    for (urgency, octets) in [(0, 1000), (1, 2000), (2, 3000)] {
        pair.send(urgency, octets);
    }
    let mut written = BTreeMap::new();
    for urgency in 0..Urgency::COUNT {
        written.insert(urgency, pair.written_on(urgency) / 1000);
    }
    assert_eq!(written, BTreeMap::from([(0, 1), (1, 2), (2, 3)]));
    assert!(pair.mts.poll_transmit(pair.now, CONN).is_none());
}

#[test]
fn an_urgent_letter_passes_those_that_fill_their_lane() {
    let mut pair = Pair::greeted();
    for _ in 0..10 {
        pair.send(0, 600_000);
    }
    while pair.mts.poll_output().is_some() {}
    assert!(pair.mts.poll_transmit(pair.now, CONN).is_none());
    pair.send(2, 50);
    assert!(
        pair.mts.poll_output().is_some(),
        "there is something to write"
    );
    assert!((50..1000).contains(&pair.written_on(2)));
    assert!(
        pair.written_on(0) > 6_000_000,
        "each makes room for the next"
    );
}

#[test]
fn a_letter_that_comes_before_the_hello_is_kept_where_it_is() {
    let mut pair = Pair::new();
    let mut head = fipa_codec::Output::new();
    let letter = letter("b", "a", 1, 100);
    fipa_codec::bit_efficient::encode_envelope(&letter.envelope, &mut head).unwrap();
    let octets = [&head.take_bytes()[..], &letter.payload].concat();
    let frame = fipa_link::LetterFrame {
        id: 1,
        ttl_millis: 1000,
        parts: Bytes::from(octets).into(),
    };
    pair.partner.send_letter(pair.now, 1, frame);
    let mut lane = BytesMut::new();
    while let Some(part) = pair.partner.poll_transmit_on(1) {
        lane.extend_from_slice(&part);
    }
    let come = lane.len();
    let urgency = Urgency::ALL[1];
    assert!(!pair.mts.received_on(pair.now, CONN, urgency, &mut lane));
    assert_eq!(lane.len(), come);
    pair.tell_main();
    assert!(pair.mts.received_on(pair.now, CONN, urgency, &mut lane));
    assert!(lane.is_empty());
    assert_eq!(pair.mts.take_mail("a").unwrap().payload.len(), 100);
}
