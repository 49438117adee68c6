//! Letters on streams of their own, which come in any order between each other.

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{InstanceId, Now};
use fipa_link::{
    DirectoryFrame, Event, Frame, Hello, LANES, LetterFrame, Link, LinkConfig, LinkError, Role,
};
use proptest::prelude::*;

const STREAMS: usize = 1 + LANES;

fn link(n: u8) -> Link {
    let mut config = LinkConfig::new(Hello {
        version: Hello::VERSION,
        role: Role::Daemon,
        instance: InstanceId::from_bytes([n; 16]),
        name: Text::from(format!("daemon{n}")),
        scope: Text::default(),
        endpoints: Vec::new(),
        max_letter: 1 << 20,
        unix_millis: 0,
        checks: n == 3,
    });
    config.lanes = true;
    Link::new(config, now())
}

fn now() -> Now {
    Now::default().plus(Duration::from_secs(1))
}

fn fact(version: u64) -> Frame {
    Frame::Directory(DirectoryFrame {
        version,
        snapshot: false,
        more: false,
        items: Vec::new(),
    })
}

fn letter(id: u64, octets: usize) -> LetterFrame {
    LetterFrame {
        id,
        ttl_millis: 1000,
        parts: Bytes::from(vec![7; octets]).into(),
    }
}

/// What is written on each stream.
fn written(link: &mut Link) -> [BytesMut; STREAMS] {
    std::array::from_fn(|stream| {
        let mut octets = BytesMut::new();
        let next = |link: &mut Link| match stream.checked_sub(1) {
            None => link.poll_transmit(),
            Some(lane) => link.poll_transmit_on(lane),
        };
        while let Some(part) = next(link) {
            octets.extend_from_slice(&part);
        }
        octets
    })
}

/// The end that reads, with what it has not taken yet.
struct Reader {
    link: Link,
    rest: [BytesMut; STREAMS],
    events: Vec<Event>,
}

impl Reader {
    fn new() -> Reader {
        Reader {
            link: link(2),
            rest: Default::default(),
            events: Vec::new(),
        }
    }

    /// Takes octets of one stream, and offers again what others have left.
    fn take(&mut self, stream: usize, octets: &[u8]) -> Result<(), LinkError> {
        self.rest[stream].extend_from_slice(octets);
        for stream in [stream].into_iter().chain(0..STREAMS).chain(0..STREAMS) {
            let rest = &mut self.rest[stream];
            let mut next = || match stream.checked_sub(1) {
                None => self.link.receive(now(), rest),
                Some(lane) => self.link.receive_on(now(), lane, rest),
            };
            while let Some(event) = next()? {
                self.events.push(event);
            }
        }
        Ok(())
    }
}

/// What the sender does.
#[derive(Clone, Debug)]
enum Step {
    Fact,
    Receipt,
    Letter(usize, usize),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        1 => Just(Step::Fact),
        1 => Just(Step::Receipt),
        3 => (0..LANES, prop_oneof![0..50_usize, 20_000..60_000_usize])
            .prop_map(|(lane, octets)| Step::Letter(lane, octets)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn however_streams_run_ahead_of_each_other_what_has_to_be_in_order_is(
        steps in prop::collection::vec(step(), 0..20),
        cuts in prop::collection::vec((0..STREAMS, 1..40_000_usize), 0..60),
    ) {
        let mut sender = link(1);
        for (id, step) in (1..).zip(&steps) {
            match step {
                Step::Fact => sender.send(now(), fact(id)),
                Step::Receipt => sender.send_receipt(now(), id, &[]),
                Step::Letter(lane, octets) => {
                    sender.send_letter(now(), *lane, letter(id, *octets));
                }
            }
        }
        sender.goodbye(now(), "done");
        let mut streams = written(&mut sender);
        let mut reader = Reader::new();
        let rest = (0..STREAMS).rev().map(|stream| (stream, usize::MAX));
        for (stream, octets) in cuts.into_iter().chain(rest) {
            let octets = octets.min(streams[stream].len());
            let piece = streams[stream].split_to(octets);
            reader.take(stream, &piece).unwrap();
        }
        let mut facts = 0;
        let mut last = [0; LANES];
        let mut come = 0;
        for event in &reader.events[1..] {
            match event {
                Event::Frame(Frame::Directory(fact)) => {
                    prop_assert!(fact.version > facts);
                    facts = fact.version;
                }
                Event::Frame(Frame::Letter(letter)) => {
                    let Step::Letter(lane, octets) = &steps[letter.id as usize - 1] else {
                        panic!("{letter:?} was not sent");
                    };
                    prop_assert_eq!(letter.parts.octets(), *octets);
                    prop_assert!(letter.id > last[*lane], "the order of a lane");
                    last[*lane] = letter.id;
                    let before = (1..letter.id).zip(&steps);
                    let told = before.filter(|(_, step)| matches!(step, Step::Fact));
                    prop_assert!(told.last().is_none_or(|(id, _)| facts >= id));
                    come += 1;
                }
                _ => {}
            }
        }
        prop_assert!(matches!(reader.events.first(), Some(Event::Opened(_))));
        let sent = steps.iter().filter(|step| matches!(step, Step::Letter(..)));
        prop_assert_eq!(come, sent.count());
        let goodbye = Event::Frame(Frame::Goodbye("done".into()));
        prop_assert_eq!(reader.events.last(), Some(&goodbye));
    }

    #[test]
    fn arbitrary_octets_on_lanes_never_panic(
        pieces in prop::collection::vec((0..STREAMS, prop::collection::vec(any::<u8>(), 0..100)), 0..8),
        greeted: bool,
    ) {
        let mut reader = Reader::new();
        if greeted {
            let [hello, ..] = written(&mut link(1));
            reader.take(0, &hello).unwrap();
        }
        for (stream, octets) in pieces {
            let _ = reader.take(stream, &octets);
        }
    }
}

#[test]
fn an_urgent_letter_waits_for_no_other_and_no_receipt() {
    let mut sender = link(1);
    let [hello, ..] = written(&mut sender);
    let mut reader = Reader::new();
    reader.take(0, &hello).unwrap();
    sender.send_receipt(now(), 9, &[]);
    sender.send_letter(now(), 0, letter(1, 100_000));
    sender.send_letter(now(), 2, letter(2, 10));
    assert!(sender.queued_on(0) > 100_000 && sender.queued_on(2) < 100);
    let [_, _, _, urgent] = written(&mut sender);
    reader.take(3, &urgent).unwrap();
    let Some(Event::Frame(Frame::Letter(come))) = reader.events.last() else {
        panic!("{:?}", reader.events);
    };
    assert_eq!(come.id, 2);
}

#[test]
fn a_letter_waits_for_the_hello_and_for_what_was_told_before_it() {
    let mut sender = link(1);
    sender.send(now(), fact(1));
    sender.send_letter(now(), 1, letter(1, 10));
    let [main, _, lane, _] = written(&mut sender);
    let mut reader = Reader::new();
    reader.take(2, &lane).unwrap();
    assert!(reader.events.is_empty() && reader.link.is_held(1));
    let (hello, told) = main.split_at(main.len() - 1);
    reader.take(0, hello).unwrap();
    assert!(matches!(reader.events[..], [Event::Opened(_)]));
    assert!(reader.link.is_held(1));
    reader.take(0, told).unwrap();
    assert!(!reader.link.is_held(1));
    assert_eq!(reader.events.len(), 3, "{:?}", reader.events);
}

#[test]
fn nothing_but_letters_is_taken_on_a_lane() {
    let mut sender = link(1);
    let [mut main, ..] = written(&mut sender);
    let mut reader = Reader::new();
    reader.take(0, &main).unwrap();
    main.clear();
    fact(1).encode(&mut main);
    assert_eq!(reader.take(1, &main), Err(LinkError::Order));
}

#[test]
fn a_letter_that_waits_for_nothing_is_not_taken_before_the_hello() {
    let mut octets = BytesMut::new();
    let parts = Frame::Letter(letter(1, 10)).encode(&mut octets);
    parts.iter().for_each(|part| octets.extend_from_slice(part));
    assert_eq!(Reader::new().take(1, &octets), Err(LinkError::Order));
}
