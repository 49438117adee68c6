//! Sequences of messages with code tables, and a second reading of what is written.

mod support;

use bytes::Bytes;
use fipa_acl::Message;
use fipa_codec::bit_efficient::{
    CodeTable, decode_message_with, encode_message, encode_message_with,
};
use fipa_codec::{Limits, Output, arbitrary};
use proptest::prelude::*;

/// The table as the standard describes it, without any haste: for each number the code of its
/// kind, its octets, and when it was used.
struct Model {
    entries: Vec<Option<(u8, Vec<u8>, u64)>>,
    now: u64,
    added: usize,
}

impl Model {
    fn new(size: usize) -> Model {
        Model {
            entries: vec![None; size],
            now: 0,
            added: 0,
        }
    }

    fn look_up(&mut self, number: usize) -> (u8, Vec<u8>) {
        self.now += 1;
        let (kind, octets, used) = self.entries[number].as_mut().unwrap();
        *used = self.now;
        (*kind, octets.clone())
    }

    fn add(&mut self, kind: u8, octets: &[u8]) {
        let known = |entry: &(u8, Vec<u8>, u64)| entry.0 == kind && entry.1 == octets;
        assert!(!self.entries.iter().flatten().any(known), "already there");
        if self.entries.iter().all(Option::is_some) {
            for _ in 0..self.entries.len() >> 3 {
                let used = |entry: &Option<(u8, Vec<u8>, u64)>| {
                    entry.as_ref().map_or(u64::MAX, |entry| entry.2)
                };
                *self.entries.iter_mut().min_by_key(|e| used(e)).unwrap() = None;
            }
        }
        self.now += 1;
        let free = self.entries.iter().position(Option::is_none).unwrap();
        self.entries[free] = Some((kind, octets.to_vec(), self.now));
        self.added += 1;
    }
}

/// Writes a message without its indexes.
struct Expander<'a> {
    rest: &'a [u8],
    model: &'a mut Model,
    plain: Vec<u8>,
}

impl Expander<'_> {
    fn copy(&mut self, count: usize) -> Vec<u8> {
        let (octets, rest) = self.rest.split_at(count);
        self.rest = rest;
        self.plain.extend_from_slice(octets);
        octets.to_vec()
    }

    fn message(&mut self) {
        let first = self.rest[0];
        let added = self.model.added;
        self.copy(2);
        self.plain[0] = 0xfa;
        if self.copy(1) == [0] {
            self.token();
        }
        loop {
            match self.copy(1)[0] {
                0x00 => {
                    self.token();
                    self.token();
                }
                0x01 => break,
                0x02 => self.agent(),
                0x03 | 0x08 => self.agents(),
                0x04 => self.content(),
                0x06 if self.rest[0] < 0x24 => drop(self.copy(10)),
                0x06 => drop(self.copy(11)),
                _ => self.token(),
            }
        }
        let grew = self.model.added > added;
        assert_eq!(first, if grew { 0xfb } else { 0xfc });
    }

    fn agents(&mut self) {
        while self.copy(1) == [0x02] {
            self.agent_behind_its_code();
        }
    }

    fn agent(&mut self) {
        assert_eq!(self.copy(1), [0x02]);
        self.agent_behind_its_code();
    }

    fn agent_behind_its_code(&mut self) {
        self.token();
        loop {
            match self.copy(1)[0] {
                0x01 => return,
                0x02 => {
                    while self.rest[0] != 0x01 {
                        self.token();
                    }
                    self.copy(1);
                }
                0x03 => self.agents(),
                _ => {
                    self.token();
                    self.token();
                }
            }
        }
    }

    fn content(&mut self) {
        let code = self.copy(1)[0];
        let len = self.counted(code);
        self.copy(len);
    }

    fn counted(&mut self, code: u8) -> usize {
        let octets = self.copy([1, 2, 0, 4][usize::from(code - 0x16)]);
        octets
            .iter()
            .fold(0, |n, octet| n << 8 | usize::from(*octet))
    }

    /// A word, a string, a number or a list.
    fn token(&mut self) {
        match self.rest[0] {
            code @ (0x10 | 0x14) => {
                self.copy(1);
                let len = self.rest.iter().position(|octet| *octet == 0).unwrap();
                let octets = self.copy(len);
                self.copy(1);
                self.model.add(code, &octets);
            }
            code @ (0x16 | 0x17 | 0x19) => {
                self.copy(1);
                let len = self.counted(code);
                let octets = self.copy(len);
                self.model.add(0x16, &octets);
            }
            0x12 => while self.copy(1)[0] & 15 != 0 {},
            0x60 => {
                self.copy(1);
                while self.rest[0] != 0x40 {
                    self.token();
                }
                self.copy(1);
            }
            code => self.index(code),
        }
    }

    fn index(&mut self, code: u8) {
        let wide = self.model.entries.len() > 256;
        let number = match wide {
            true => usize::from(self.rest[1]) << 8 | usize::from(self.rest[2]),
            false => usize::from(self.rest[1]),
        };
        self.rest = &self.rest[2 + usize::from(wide)..];
        let (kind, octets) = self.model.look_up(number);
        match (code, kind) {
            (0x11, 0x10) | (0x15, 0x14) => {
                self.plain.push(kind);
                self.plain.extend_from_slice(&octets);
                self.plain.push(0);
            }
            (0x18, 0x16) => {
                let len = u8::try_from(octets.len()).unwrap();
                self.plain.extend_from_slice(&[0x16, len]);
                self.plain.extend_from_slice(&octets);
            }
            _ => panic!("code {code:02x} for a text of kind {kind:02x}"),
        }
    }
}

fn plain(message: &Message) -> Bytes {
    let mut out = Output::new();
    encode_message(message, &mut out).unwrap();
    out.take_bytes()
}

/// The message many times over, so that a table overflows.
fn crowded(mut messages: Vec<Message>) -> Vec<Message> {
    for (n, message) in messages.iter_mut().enumerate() {
        let names = (0..60).map(|i| format!("agent{}", (n * 17 + i * i) % 700).into());
        message.receiver.extend(names);
    }
    messages
}

fn sequences() -> impl Strategy<Value = Vec<Message>> {
    let messages = || prop::collection::vec(arbitrary::message(), 1..30);
    prop_oneof![messages(), messages().prop_map(crowded)]
}

fn sizes() -> impl Strategy<Value = usize> {
    prop::sample::select(vec![256, 257, 300, 1024])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn sequences_come_back_as_they_were(messages in sequences(), size in sizes()) {
        let mut there = CodeTable::new(size).unwrap();
        let mut here = CodeTable::new(size).unwrap();
        let mut model = Model::new(size);
        let mut out = Output::new();
        for message in &messages {
            encode_message_with(message, &mut there, &mut out).unwrap();
            let octets = out.take_bytes();
            let decoded = decode_message_with(&octets, &Limits::default(), &mut here);
            prop_assert_eq!(decoded.as_ref(), Ok(message));
            let mut expander = Expander {
                rest: &octets,
                model: &mut model,
                plain: Vec::new(),
            };
            expander.message();
            prop_assert_eq!(expander.plain, plain(message));
            prop_assert!(expander.rest.is_empty());
            let entries = model.entries.iter().flatten().count();
            prop_assert_eq!((there.len(), here.len()), (entries, entries));
        }
    }

    #[test]
    fn changed_octets_do_no_harm(
        messages in prop::collection::vec(arbitrary::message(), 1..5),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let mut there = CodeTable::new(256).unwrap();
        let mut here = CodeTable::new(256).unwrap();
        let mut out = Output::new();
        for message in &messages {
            encode_message_with(message, &mut there, &mut out).unwrap();
            let mut octets = out.take_bytes().to_vec();
            for (index, octet) in &changes {
                let at = index.index(octets.len());
                octets[at] = *octet;
            }
            let broken = here.broken().cloned();
            let decoded = decode_message_with(&octets.into(), &Limits::default(), &mut here);
            if let Some(error) = broken {
                prop_assert_eq!(decoded, Err(error));
            }
        }
    }

    #[test]
    fn truncated_messages_break_the_table(message in arbitrary::message()) {
        let mut out = Output::new();
        encode_message_with(&message, &mut CodeTable::new(256).unwrap(), &mut out).unwrap();
        let octets = out.take_bytes();
        for len in (1..octets.len()).step_by(octets.len() / 50 + 1) {
            let mut here = CodeTable::new(256).unwrap();
            let octets = octets.slice(..len);
            let error = decode_message_with(&octets, &Limits::default(), &mut here).unwrap_err();
            prop_assert!(error.what.contains("must be reset"));
        }
    }
}
