//! How often memory is taken for a letter that passes from one peer to another, its receipt
//! included. The only test of its process: it counts what all of that does.

use std::alloc::System;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{AgentId, Envelope, FipaTime, Representation, Slots, Text};
use fipa_codec::{Output as Encoded, bit_efficient};
use fipa_directory::{Entry, InstanceId, Now, Source, State};
use fipa_link::{
    DirectoryFrame, DirectoryItem, Frame, Hello, LetterFrame, Link, LinkConfig, Outcome,
    ReceiverOutcome, Role,
};
use fipa_mts::{Config, ConnId, Connected, Machine, Mts};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const SOURCE: ConnId = ConnId(1);
const SINK: ConnId = ConnId(2);

/// Letters that are read, and receipts that come back, at once.
const BATCH: u64 = 100;

/// The kind and the number of a frame, and where the next one begins.
fn frame_at(octets: &[u8]) -> Option<(u8, u64, usize)> {
    let (head, rest) = octets.split_first_chunk::<5>()?;
    let [l0, l1, l2, l3, kind] = *head;
    let length = u32::from_be_bytes([l0, l1, l2, l3]) as usize;
    Some((kind, u64::from_be_bytes(*rest.first_chunk()?), 4 + length))
}

/// A service between two peers, of which one has the agent `sink@robot`.
struct Middle {
    mts: Mts,
    now: Now,
    read: BytesMut,
    written: BytesMut,
    letters: Vec<u64>,
}

impl Middle {
    fn new() -> Middle {
        let now = Now {
            mono: Duration::from_secs(1000),
            unix_millis: 1_795_341_600_000,
        };
        let mut middle = Middle {
            mts: Mts::new(Config::new(InstanceId::from_bytes([5; 16]), "middle")),
            now,
            read: BytesMut::with_capacity(1 << 20),
            written: BytesMut::with_capacity(1 << 20),
            letters: Vec::with_capacity(BATCH as usize),
        };
        middle.greet(SOURCE, [8; 16], "source@robot");
        middle.greet(SINK, [9; 16], "sink@robot");
        middle
    }

    fn greet(&mut self, conn: ConnId, instance: [u8; 16], agent: &'static str) {
        let instance = InstanceId::from_bytes(instance);
        let hello = Hello {
            version: Hello::VERSION,
            role: Role::Daemon,
            instance,
            name: Text::from_static(agent),
            scope: Text::default(),
            endpoints: vec![Text::from_static("tcp://192.0.2.17:40001")],
            max_letter: 1 << 20,
            unix_millis: self.now.unix_millis,
            checks: false,
        };
        let mut link = Link::new(LinkConfig::new(hello), self.now);
        let put = DirectoryItem::Put {
            owner: instance,
            source: Source::Local,
            state: State::Alive,
            age_millis: 0,
            entry: Entry::new(agent),
        };
        let directory = DirectoryFrame {
            version: 1,
            snapshot: true,
            more: false,
            items: vec![put],
        };
        link.send(self.now, Frame::Directory(directory));
        self.mts.connected(
            self.now,
            Connected {
                conn,
                dialled: None,
                control: false,
                same_host: false,
                remote: Text::from_static("tcp://192.0.2.17:40001"),
                identity: None,
                lanes: false,
            },
        );
        let said = std::iter::from_fn(|| link.poll_transmit());
        said.for_each(|part| self.read.extend_from_slice(&part));
        self.hear(conn);
        self.drain(SOURCE);
        self.drain(SINK);
    }

    /// The service reads what was said to it.
    fn hear(&mut self, conn: ConnId) {
        self.mts.received(self.now, conn, &mut self.read);
        assert!(self.read.is_empty());
        self.read.clear();
        assert!(self.read.try_reclaim(1 << 20) || self.mts.letters_under_way() > 0);
        while self.mts.poll_output().is_some() {}
    }

    /// What the service says on a connection.
    fn drain(&mut self, conn: ConnId) {
        self.written.clear();
        while let Some(part) = self.mts.poll_transmit(self.now, conn) {
            self.written.extend_from_slice(&part);
        }
    }

    /// Passes a batch of letters from the source to the sink, and their receipts back.
    fn pass(&mut self, letters: &mut [u8], receipt: &mut [u8], first: u64) {
        let mut at = 0;
        for id in first..first + BATCH {
            let (_, _, octets) = frame_at(&letters[at..]).unwrap();
            letters[at + 5..at + 13].copy_from_slice(&id.to_be_bytes());
            at += octets;
        }
        self.read.reserve(letters.len());
        self.read.extend_from_slice(letters);
        self.hear(SOURCE);
        self.drain(SINK);
        self.letters.clear();
        let mut at = 0;
        while let Some((kind, id, octets)) = frame_at(&self.written[at..]) {
            assert_eq!(kind, 2);
            self.letters.push(id);
            at += octets;
        }
        assert_eq!(self.letters.len() as u64, BATCH);
        for id in &self.letters {
            receipt[5..13].copy_from_slice(&id.to_be_bytes());
            self.read.extend_from_slice(receipt);
        }
        self.hear(SINK);
        self.drain(SOURCE);
        let (mut at, mut receipts) = (0, 0);
        while let Some((kind, id, octets)) = frame_at(&self.written[at..]) {
            assert_eq!((kind, id), (3, first + receipts));
            receipts += 1;
            at += octets;
        }
        assert_eq!(receipts, BATCH);
        assert_eq!(self.mts.letters_under_way(), 0);
    }
}

/// A batch of letters of so many octets of payload, each in its frame.
fn letters(octets: usize) -> Vec<u8> {
    let envelope = Envelope::new(Slots {
        to: vec![AgentId::new("sink@robot")],
        from: Some(AgentId::new("source@robot")),
        acl_representation: Some(Representation::BitEfficient),
        payload_length: Some(octets as u64),
        date: Some(FipaTime::from_unix_millis(1_795_341_600_000)),
        intended_receiver: vec![AgentId::new("sink@robot")],
        ..Slots::default()
    });
    let mut head = Encoded::new();
    bit_efficient::encode_envelope(&envelope, &mut head).unwrap();
    let letter = [head.take_bytes(), Bytes::from(vec![b'x'; octets])].concat();
    let mut written = BytesMut::new();
    for id in 0..BATCH {
        let frame = Frame::Letter(LetterFrame {
            id,
            ttl_millis: 10_000,
            parts: Bytes::from(letter.clone()).into(),
        });
        let parts = frame.encode(&mut written);
        parts.iter().for_each(|p| written.extend_from_slice(p));
    }
    written.into()
}

fn receipt() -> Vec<u8> {
    let delivered = ReceiverOutcome {
        to: Text::from_static("sink@robot"),
        outcome: Outcome::Delivered,
        via: None,
        reason: Text::default(),
    };
    let mut written = BytesMut::new();
    Frame::Receipt {
        id: 0,
        outcomes: delivered.into(),
    }
    .encode(&mut written);
    written.into()
}

#[test]
fn a_letter_that_passes_takes_memory_once() {
    const BATCHES: u64 = 100;
    let (mut letters, mut receipt) = (letters(100), receipt());
    let mut middle = Middle::new();
    let mut number = 0;
    let mut pass = |batches: u64| {
        for _ in 0..batches {
            middle.pass(&mut letters, &mut receipt, number);
            number += BATCH;
        }
    };
    // What is remembered of letters reaches its full size.
    pass(170);
    let before = ALLOCATOR.stats();
    pass(BATCHES);
    let after = ALLOCATOR.stats();
    let taken = after.allocations - before.allocations + after.reallocations - before.reallocations;
    let each = taken as f64 / (BATCHES * BATCH) as f64;
    println!("memory is taken {each:.3} times a letter");
    assert!(each <= 1.0, "{each} times a letter");
}
