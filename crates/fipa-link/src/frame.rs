use bytes::{BufMut, Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{Entry, InstanceId, Location, Source, State};

use crate::check;
use crate::wire::{FrameError, Reader, put_list, put_octets, put_text};
use crate::{
    AskCallBack, CalledBack, Facts, Hello, KnownPlatform, Outcomes, Parts, ReceiverOutcome, Sniffed,
};

/// One frame of a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Frame {
    /// Who speaks.
    Hello(Hello),
    /// A letter.
    Letter(LetterFrame),
    /// What became of the letter with this number.
    Receipt {
        /// The number of the letter.
        id: u64,
        /// One outcome a receiver.
        outcomes: Outcomes,
    },
    /// A program asks to register an agent.
    Attach {
        /// Ties the answer to the request.
        request: u64,
        /// The agent's name.
        name: Text,
        /// The service type.
        kind: Text,
        /// Free text for people.
        description: Text,
    },
    /// A program asks to deregister an agent.
    Detach {
        /// Ties the answer to the request.
        request: u64,
        /// The agent's name.
        name: Text,
    },
    /// The answer to a request; an empty `refusal` means that it was done.
    Answer {
        /// The request.
        request: u64,
        /// Why not.
        refusal: Text,
    },
    /// A program asks for the directory, as snapshot and changes.
    Watch,
    /// A part of the directory.
    Directory(DirectoryFrame),
    /// Asks for a pong with the same number.
    Ping(u64),
    /// The answer to a ping.
    Pong(u64),
    /// The link is about to be closed, and why; or which one of several between two stays.
    Goodbye(Text),
    /// Platforms that the speaker has open links with: what is new since it told last.
    Platforms(Vec<KnownPlatform>),
    /// What is revoked in the fleet: a list that the fleet key has signed, as it is (X.509 CRL, DER).
    Revoked(Bytes),
    /// What follows on this stream is not to be taken before so many frames have come on others: on
    /// a lane, of facts on the main stream; on the main stream, of letters on the lanes.
    After(u64),
    /// A program asks what there is to know for somebody who looks for a fault.
    AskFacts,
    /// The answer to that.
    Facts(Facts),
    /// A program begins (true) or ends (false) to watch what passes; on the control socket only.
    Sniff(bool),
    /// What passed, for a program that watches.
    Sniffed(Box<Sniffed>),
    /// Somebody asks whether others reach a service.
    AskCallBack(AskCallBack),
    /// The answer to that.
    CalledBack(CalledBack),
    /// A kind that this version does not know; it is passed over.
    Unknown(u8),
}

/// A letter on a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LetterFrame {
    /// Counts the letters of a sender; the receipt carries it. A letter that is sent again over a
    /// new link keeps its number.
    pub id: u64,
    /// Milliseconds within which the sender wants the receipt.
    pub ttl_millis: u32,
    /// The encoded letter, in parts that follow each other. Of one that was received the first part
    /// is all, or 16 KiB at least.
    pub parts: Parts,
}

/// A part of a directory. The parts of one owner are numbered without gaps over all its links, so
/// that late or doubled ones are recognised.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DirectoryFrame {
    /// The number of the last change that is contained.
    pub version: u64,
    /// Whether this begins a snapshot: what it does not hold is not there.
    pub snapshot: bool,
    /// Whether more parts of the snapshot follow.
    pub more: bool,
    /// Entries and removals.
    pub items: Vec<DirectoryItem>,
}

/// An item of a [`DirectoryFrame`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DirectoryItem {
    /// An entry, new or changed.
    Put {
        /// Who vouches for it.
        owner: InstanceId,
        /// How it came to be known.
        source: Source,
        /// How sure it is.
        state: State,
        /// For how many milliseconds it has been known.
        age_millis: u64,
        /// The entry.
        entry: Entry,
    },
    /// An entry is gone.
    Remove {
        /// Who vouched for it.
        owner: InstanceId,
        /// The agent's name.
        name: Text,
    },
}

/// Octets up to which a part before the last is written together with the frame's head.
const SMALL_PART: usize = 512;

/// Octets of a letter up to which it is written together with the frame's head.
pub(crate) const COPIED: usize = 4 << 10;

const SOURCES: [Source; 4] = [Source::Local, Source::Mdns, Source::Peer, Source::Ams];
const STATES: [State; 3] = [State::Alive, State::Suspect, State::Gone];

impl LetterFrame {
    /// Writes what was put before the letter on its way, if that is small; the rest is returned. A
    /// part of its own costs more than a copy of so little.
    fn put_overlays(mut self, out: &mut BytesMut) -> Parts {
        while let Some(part) = self.parts.take_small(SMALL_PART) {
            out.put_slice(&part);
        }
        self.parts
    }
}

impl Frame {
    const HELLO: u8 = 1;

    /// The kind of a letter's frame.
    pub(crate) const LETTER: u8 = 2;

    /// The kind of the frame that tells what became of a letter.
    pub(crate) const RECEIPT: u8 = 3;

    /// The kind of the frame that ends a link.
    pub(crate) const GOODBYE: u8 = 11;

    /// The kind of the frame that holds a letter for a watcher.
    pub(crate) const SNIFFED: u8 = 23;

    /// Appends the frame to `out`, save for the parts of a letter that are returned: they follow,
    /// as they are.
    pub fn encode(self, out: &mut BytesMut) -> Parts {
        self.encode_as(out, false)
    }

    /// The same, with or without checksums.
    pub(crate) fn encode_as(self, out: &mut BytesMut, checked: bool) -> Parts {
        let body = check::begin(out, self.kind(), checked);
        let letter = self.put_body(out);
        check::finish(out, body, checked, &letter);
        letter
    }

    /// Appends a [`Frame::Receipt`].
    pub(crate) fn encode_receipt(
        id: u64,
        outcomes: &[ReceiverOutcome],
        out: &mut BytesMut,
        checked: bool,
    ) {
        let body = check::begin(out, Frame::RECEIPT, checked);
        put_receipt(id, outcomes, out);
        check::finish(out, body, checked, &Parts::default());
    }

    /// Appends a [`Frame::Receipt`] whose outcomes are written already.
    pub(crate) fn encode_written_receipt(
        id: u64,
        outcomes: &[u8],
        out: &mut BytesMut,
        checked: bool,
    ) {
        let body = check::begin(out, Frame::RECEIPT, checked);
        out.put_u64(id);
        out.put_slice(outcomes);
        check::finish(out, body, checked, &Parts::default());
    }

    /// Appends a [`Frame::Letter`] with something in front of the letter; what is returned follows.
    pub(crate) fn encode_letter(
        (id, ttl_millis): (u64, u32),
        front: &[u8],
        letter: &Bytes,
        out: &mut BytesMut,
        checked: bool,
    ) -> Parts {
        let body = check::begin(out, Frame::LETTER, checked);
        out.put_u64(id);
        out.put_u32(ttl_millis);
        out.put_slice(front);
        let letter = match letter.len() <= COPIED {
            true => {
                out.put_slice(letter);
                Parts::default()
            }
            false => Parts::from(letter.clone()),
        };
        check::finish(out, body, checked, &letter);
        letter
    }

    /// Appends a [`Frame::Letter`] with all its parts.
    pub(crate) fn encode_copied(letter: &LetterFrame, out: &mut BytesMut, checked: bool) {
        let body = check::begin(out, Frame::LETTER, checked);
        out.put_u64(letter.id);
        out.put_u32(letter.ttl_millis);
        letter.parts.iter().for_each(|part| out.put_slice(part));
        check::finish(out, body, checked, &Parts::default());
    }

    /// Reads a frame from its kind and body. A letter shares the body's buffer.
    pub fn decode(kind: u8, body: Bytes) -> Result<Frame, FrameError> {
        if kind == Frame::HELLO {
            return Hello::read(body).map(Frame::Hello);
        }
        let mut r = Reader::new(body, name_of(kind));
        Ok(match kind {
            Frame::LETTER => Frame::Letter(LetterFrame {
                id: r.u64()?,
                ttl_millis: r.u32()?,
                parts: r.rest().into(),
            }),
            Frame::RECEIPT => Frame::Receipt {
                id: r.u64()?,
                outcomes: r.list(ReceiverOutcome::read)?,
            },
            4 => Frame::Attach {
                request: r.u64()?,
                name: r.text()?,
                kind: r.text()?,
                description: r.text()?,
            },
            5 => Frame::Detach {
                request: r.u64()?,
                name: r.text()?,
            },
            6 => Frame::Answer {
                request: r.u64()?,
                refusal: r.text()?,
            },
            7 => Frame::Watch,
            8 => Frame::Directory(DirectoryFrame::read(r)?),
            9 => Frame::Ping(r.u64()?),
            10 => Frame::Pong(r.u64()?),
            Frame::GOODBYE => Frame::Goodbye(r.text()?),
            12 => Frame::Platforms(r.list(KnownPlatform::read)?),
            13 => Frame::Revoked(r.octets()?),
            14 => Frame::After(r.u64()?),
            20 => Frame::AskFacts,
            21 => Frame::Facts(Facts::read(r)?),
            22 => Frame::Sniff(r.u8()? != 0),
            Frame::SNIFFED => Frame::Sniffed(Box::new(Sniffed::read(r)?)),
            24 => Frame::AskCallBack(AskCallBack::read(r)?),
            25 => Frame::CalledBack(CalledBack::read(r)?),
            other => Frame::Unknown(other),
        })
    }

    fn kind(&self) -> u8 {
        match self {
            Frame::Hello(_) => Frame::HELLO,
            Frame::Letter(_) => Frame::LETTER,
            Frame::Receipt { .. } => Frame::RECEIPT,
            Frame::Attach { .. } => 4,
            Frame::Detach { .. } => 5,
            Frame::Answer { .. } => 6,
            Frame::Watch => 7,
            Frame::Directory(_) => 8,
            Frame::Ping(_) => 9,
            Frame::Pong(_) => 10,
            Frame::Goodbye(_) => Frame::GOODBYE,
            Frame::Platforms(_) => 12,
            Frame::Revoked(_) => 13,
            Frame::After(_) => 14,
            Frame::AskFacts => 20,
            Frame::Facts(_) => 21,
            Frame::Sniff(_) => 22,
            Frame::Sniffed(_) => Frame::SNIFFED,
            Frame::AskCallBack(_) => 24,
            Frame::CalledBack(_) => 25,
            Frame::Unknown(kind) => *kind,
        }
    }

    /// Writes the body, save for the parts of a letter that are returned.
    fn put_body(self, out: &mut BytesMut) -> Parts {
        match self {
            Frame::Hello(hello) => hello.put(out),
            Frame::Letter(letter) => {
                out.put_u64(letter.id);
                out.put_u32(letter.ttl_millis);
                return letter.put_overlays(out);
            }
            Frame::Receipt { id, outcomes } => put_receipt(id, &outcomes, out),
            Frame::Attach {
                request,
                name,
                kind,
                description,
            } => {
                out.put_u64(request);
                put_text(out, &name);
                put_text(out, &kind);
                put_text(out, &description);
            }
            Frame::Detach { request, name } => {
                out.put_u64(request);
                put_text(out, &name);
            }
            Frame::Answer { request, refusal } => {
                out.put_u64(request);
                put_text(out, &refusal);
            }
            Frame::Directory(directory) => directory.put(out),
            Frame::Ping(number) | Frame::Pong(number) | Frame::After(number) => {
                out.put_u64(number);
            }
            Frame::Goodbye(reason) => put_text(out, &reason),
            Frame::Revoked(list) => put_octets(out, &list),
            Frame::Platforms(platforms) => put_list(out, &platforms, KnownPlatform::put),
            Frame::Facts(facts) => facts.put(out),
            Frame::Sniff(on) => out.put_u8(u8::from(on)),
            Frame::Sniffed(sniffed) => return sniffed.put(out),
            Frame::AskCallBack(ask) => ask.put(out),
            Frame::CalledBack(called) => called.put(out),
            Frame::Watch | Frame::AskFacts | Frame::Unknown(_) => {}
        }
        Parts::default()
    }
}

fn put_receipt(id: u64, outcomes: &[ReceiverOutcome], out: &mut BytesMut) {
    out.put_u64(id);
    put_list(out, outcomes, ReceiverOutcome::put);
}

fn name_of(kind: u8) -> &'static str {
    match kind {
        Frame::LETTER => "letter",
        Frame::RECEIPT => "receipt",
        4 => "attach",
        5 => "detach",
        6 => "answer",
        8 => "directory",
        9 => "ping",
        10 => "pong",
        Frame::GOODBYE => "goodbye",
        12 => "platforms",
        13 => "revoked",
        14 => "after",
        21 => "facts",
        22 => "sniff",
        Frame::SNIFFED => "sniffed",
        24 => "ask call back",
        25 => "called back",
        _ => "unknown",
    }
}

impl DirectoryFrame {
    fn put(&self, out: &mut BytesMut) {
        out.put_u64(self.version);
        out.put_u8(u8::from(self.snapshot) | u8::from(self.more) << 1);
        put_list(out, &self.items, |out, item| match item {
            DirectoryItem::Put {
                owner,
                source,
                state,
                age_millis,
                entry,
            } => {
                out.put_u8(0);
                out.put_slice(owner.as_bytes());
                out.put_u8(*source as u8);
                out.put_u8(*state as u8);
                out.put_u64(*age_millis);
                put_entry(out, entry);
            }
            DirectoryItem::Remove { owner, name } => {
                out.put_u8(1);
                out.put_slice(owner.as_bytes());
                put_text(out, name);
            }
        });
    }

    fn read(mut r: Reader) -> Result<DirectoryFrame, FrameError> {
        let version = r.u64()?;
        let flags = r.u8()?;
        Ok(DirectoryFrame {
            version,
            snapshot: flags & 1 != 0,
            more: flags & 2 != 0,
            items: r.list(read_item)?,
        })
    }
}

fn read_item(r: &mut Reader) -> Result<DirectoryItem, FrameError> {
    Ok(match r.u8()? {
        0 => DirectoryItem::Put {
            owner: r.instance()?,
            source: *SOURCES.get(usize::from(r.u8()?)).ok_or(r.undefined())?,
            state: *STATES.get(usize::from(r.u8()?)).ok_or(r.undefined())?,
            age_millis: r.u64()?,
            entry: read_entry(r)?,
        },
        1 => DirectoryItem::Remove {
            owner: r.instance()?,
            name: r.text()?,
        },
        _ => return Err(r.undefined()),
    })
}

fn put_entry(out: &mut BytesMut, entry: &Entry) {
    put_text(out, &entry.name);
    put_text(out, &entry.kind);
    put_list(out, &entry.locations, |out, location| {
        put_text(out, &location.address);
        put_text(out, &location.signature);
    });
    put_text(out, &entry.description);
    out.put_i64(entry.timestamp);
}

fn read_entry(r: &mut Reader) -> Result<Entry, FrameError> {
    Ok(Entry {
        name: r.text()?,
        kind: r.text()?,
        locations: r.list(|r| {
            Ok(Location {
                address: r.text()?,
                signature: r.text()?,
            })
        })?,
        description: r.text()?,
        timestamp: r.i64()?,
    })
}
