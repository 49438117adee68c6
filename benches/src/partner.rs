//! A partner of a daemon that does next to nothing: it writes letters that it has ready, and
//! confirms those that it gets.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, SystemTime};

use bytes::{Bytes, BytesMut};
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Representation, Slots, Text};
use fipa_codec::{Output, bit_efficient};
use fipa_directory::{Entry, InstanceId, MESSAGE_TRANSPORT, Now, Source, State};
use fipa_link::{
    DirectoryFrame, DirectoryItem, Event, Frame, Hello, LetterFrame, Link, LinkConfig,
    ReceiverOutcome, Role,
};

/// Kinds of frames.
const LETTER: u8 = 2;
const RECEIPT: u8 = 3;

/// Octets that are read or written at once.
const CHUNK: usize = 64 << 10;

/// A message transport service of which only the socket is real.
#[derive(Debug)]
pub struct Partner {
    stream: TcpStream,
    unread: Vec<u8>,
    /// Octets of a frame that are still to come and of no interest.
    skipped: usize,
}

impl Partner {
    /// Greets the daemon at `tcp://…` as a service of this name that has this agent.
    pub fn greet(endpoint: &str, name: &'static str, agent: &'static str) -> Partner {
        let address = endpoint.strip_prefix("tcp://").expect("an address");
        let stream = TcpStream::connect(address).expect("the daemon");
        stream.set_nodelay(true).expect("a socket");
        let mut partner = Partner {
            stream,
            unread: Vec::new(),
            skipped: 0,
        };
        let mut instance = [0; 16];
        instance[..name.len()].copy_from_slice(name.as_bytes());
        let hello = Hello {
            version: Hello::VERSION,
            role: Role::Daemon,
            instance: InstanceId::from_bytes(instance),
            name: Text::from_static(name),
            scope: Text::default(),
            endpoints: Vec::new(),
            max_letter: 256 << 20,
            unix_millis: unix_millis(),
            // Letters are written and read without a link here.
            checks: false,
        };
        let instance = hello.instance;
        let mut link = Link::new(LinkConfig::new(hello), Now::default());
        link.send(Now::default(), directory(instance, agent));
        while let Some(part) = link.poll_transmit() {
            partner.stream.write_all(&part).expect("written");
        }
        let mut received = BytesMut::new();
        loop {
            let mut some = [0; 1024];
            let octets = partner.stream.read(&mut some).expect("the daemon");
            assert!(octets > 0, "the daemon closed the link");
            received.extend_from_slice(&some[..octets]);
            let event = link.receive(Now::default(), &mut received);
            if let Some(Event::Opened(_)) = event.expect("a link") {
                partner.unread = received.into();
                return partner;
            }
        }
    }

    /// Another handle on the same stream, for a thread that only writes.
    pub fn writer(&self) -> TcpStream {
        self.stream.try_clone().expect("a handle")
    }

    /// Waits for so many receipts.
    pub fn await_receipts(&mut self, count: usize, mut each: impl FnMut()) {
        let mut seen = 0;
        while seen < count {
            self.read(|kind, _| {
                if kind == RECEIPT {
                    seen += 1;
                    each();
                }
            });
        }
    }

    /// Takes so many letters and confirms them.
    pub fn take_letters(&mut self, count: usize, agent: &'static str) {
        let mut seen = 0;
        let mut answers = BytesMut::new();
        while seen < count {
            self.read(|kind, number| {
                if kind == LETTER {
                    seen += 1;
                    confirm(number, agent, &mut answers);
                }
            });
            self.stream.write_all(&answers).expect("written");
            answers.clear();
        }
    }

    /// Reads once, and tells the kind and the number of each frame that began.
    fn read(&mut self, mut begun: impl FnMut(u8, u64)) {
        let mut unread = std::mem::take(&mut self.unread);
        let begin = unread.len();
        unread.resize(CHUNK, 0);
        let octets = self.stream.read(&mut unread[begin..]);
        let octets = octets.expect("the daemon");
        assert!(octets > 0, "the daemon closed the link");
        let mut rest = &unread[..begin + octets];
        loop {
            rest = &rest[self.skip(rest.len())..];
            let Some((head, number)) = rest.split_first_chunk::<5>() else {
                break;
            };
            let [l0, l1, l2, l3, kind] = *head;
            let length = u32::from_be_bytes([l0, l1, l2, l3]) as usize;
            let number = match number.first_chunk() {
                Some(number) => u64::from_be_bytes(*number),
                None if length > 8 => break,
                None => 0,
            };
            begun(kind, number);
            self.skipped = 4 + length;
        }
        self.unread = rest.to_vec();
    }

    /// Octets of these that belong to a frame which has begun before.
    fn skip(&mut self, octets: usize) -> usize {
        let skipped = octets.min(self.skipped);
        self.skipped -= skipped;
        skipped
    }
}

fn confirm(id: u64, agent: &'static str, out: &mut BytesMut) {
    let outcome = ReceiverOutcome {
        to: Text::from_static(agent),
        outcome: fipa_link::Outcome::Delivered,
        via: None,
        reason: Text::default(),
    };
    let outcomes = outcome.into();
    Frame::Receipt { id, outcomes }.encode(out);
}

fn directory(owner: InstanceId, agent: &'static str) -> Frame {
    let entry = Entry {
        name: Text::from_static(agent),
        kind: Text::from_static(MESSAGE_TRANSPORT),
        locations: Vec::new(),
        description: Text::default(),
        timestamp: unix_millis(),
    };
    Frame::Directory(DirectoryFrame {
        version: 1,
        snapshot: true,
        more: false,
        items: vec![DirectoryItem::Put {
            owner,
            source: Source::Local,
            state: State::Alive,
            age_millis: 0,
            entry,
        }],
    })
}

/// A letter for this agent of so many octets, behind the head of its frame. Its number is put at
/// [`NUMBER`].
pub fn letter_frame(agent: &'static str, octets: usize) -> Vec<u8> {
    let head = letter(agent, 0).len();
    frame(letter(agent, octets - head))
}

/// The same with so many octets of payload: what its envelope takes comes on top.
pub fn payload_frame(agent: &'static str, octets: usize) -> Vec<u8> {
    frame(letter(agent, octets))
}

fn letter(agent: &'static str, payload: usize) -> Bytes {
    let envelope = Envelope::new(Slots {
        to: vec![AgentId::new(agent)],
        from: Some(AgentId::new("source@bench")),
        acl_representation: Some(Representation::BitEfficient),
        payload_length: Some(payload as u64),
        date: Some(FipaTime::from_unix_millis(unix_millis())),
        intended_receiver: vec![AgentId::new(agent)],
        ..Slots::default()
    });
    let letter = Letter {
        envelope,
        payload: Bytes::from(vec![b'x'; payload]),
    };
    let mut out = Output::new();
    bit_efficient::encode_letter(&letter, &mut out).expect("can be written");
    out.take_bytes()
}

fn frame(letter: Bytes) -> Vec<u8> {
    let mut frame = BytesMut::new();
    let parts = Frame::Letter(LetterFrame {
        id: 0,
        ttl_millis: 60_000,
        parts: letter.into(),
    })
    .encode(&mut frame);
    parts.iter().for_each(|part| frame.extend_from_slice(part));
    frame.into()
}

/// Where in a frame the number of the letter is.
pub const NUMBER: std::ops::Range<usize> = 5..13;

fn unix_millis() -> i64 {
    let since = SystemTime::UNIX_EPOCH.elapsed();
    since.unwrap_or(Duration::ZERO).as_millis() as i64
}
