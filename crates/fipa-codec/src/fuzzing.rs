//! What holds for arbitrary octets, as plain functions: fuzz targets call them, and so does a test
//! with everything that was recorded.
//!
//! Each panics if it does not hold. Inputs are read with the default limits and with small ones.
//! What can be read and written again must be read from that as it was.

use std::fmt::Debug;

use bytes::Bytes;
use fipa_acl::{Envelope, FipaTime, Letter, Message, Representation, Slots, Text, Zone};

use crate::bit_efficient::CodeTable;
use crate::{DecodeError, EncodeError, Form, Limits, Output};
use crate::{bit_efficient, decode_payload, decode_payload_as, detect, string, xml};

/// Limits that ordinary inputs exceed.
const SMALL: Limits = Limits {
    max_octets: 100,
    max_depth: 2,
    max_items: 5,
    max_layers: 2,
};

/// A bit-efficient message.
pub fn bit_efficient_message(data: &[u8]) {
    BIT_EFFICIENT.hold(data);
}

/// A bit-efficient envelope and its payload.
pub fn bit_efficient_letter(data: &[u8]) {
    BIT_EFFICIENT_LETTER.hold(data);
}

/// Bit-efficient messages, one behind the other, with a code table.
pub fn code_table(data: &[u8]) {
    let octets = Bytes::copy_from_slice(data);
    for entries in TABLES {
        let messages = read_with_table(&octets, entries, &Limits::default());
        read_with_table(&octets, entries, &SMALL);
        come_back_with_table(&messages, entries);
    }
}

/// The smallest code table, and one whose numbers have two octets.
const TABLES: [usize; 2] = [256, 257];

/// The messages up to the first one that cannot be read.
fn read_with_table(octets: &Bytes, entries: usize, limits: &Limits) -> Vec<Message> {
    let mut table = new_table(entries);
    let mut messages = Vec::new();
    let mut at = 0;
    while at < octets.len() {
        let rest = octets.slice(at..);
        let read = bit_efficient::decode_message_prefix_with(&rest, limits, &mut table);
        assert!(
            table.len() <= entries,
            "more entries than there is room for"
        );
        let used = match read {
            Ok((message, used)) => {
                messages.push(message);
                used
            }
            Err(error) => {
                assert!(error.offset <= rest.len(), "an error behind the end");
                if let Some(broken) = table.broken().cloned() {
                    let again = bit_efficient::decode_message_with(&rest, limits, &mut table);
                    assert_eq!(again, Err(broken), "a broken table is used");
                }
                break;
            }
        };
        assert!(0 < used && used <= rest.len(), "a position that is none");
        at += used;
    }
    messages
}

/// Writes with a new table what can be written, and reads it with another one.
fn come_back_with_table(messages: &[Message], entries: usize) {
    let (mut here, mut there) = (new_table(entries), new_table(entries));
    let mut out = Output::new();
    for message in messages {
        let before = here.len();
        if bit_efficient::encode_message_with(message, &mut here, &mut out).is_err() {
            assert!(out.is_empty(), "an error leaves octets");
            assert_eq!(here.len(), before, "an error leaves entries");
            continue;
        }
        let octets = out.take_bytes();
        let limits = Limits::default();
        let again = bit_efficient::decode_message_with(&octets, &limits, &mut there);
        let mut expected = message.clone();
        message_in_utc(&mut expected);
        assert_eq!(again, Ok(expected), "it changed: {octets:?}");
        assert_eq!(here.len(), there.len(), "the tables differ");
    }
}

fn new_table(entries: usize) -> CodeTable {
    CodeTable::new(entries).unwrap_or_else(|error| panic!("{error}"))
}

/// A message in string form.
pub fn string_message(data: &[u8]) {
    STRING.hold(data);
}

/// An XML message.
pub fn xml_message(data: &[u8]) {
    XML.hold(data);
}

/// An XML envelope and its payload.
pub fn xml_letter(data: &[u8]) {
    XML_LETTER.hold(data);
}

/// A message in the form that it seems to have, written in every form that can hold it.
pub fn roundtrip(data: &[u8]) {
    let octets = Bytes::copy_from_slice(data);
    let notation = match detect(&octets) {
        Form::BitEfficientMessage => &BIT_EFFICIENT,
        Form::String => &STRING,
        _ => &XML,
    };
    let Ok(message) = (notation.decode)(&octets, &Limits::default()) else {
        return;
    };
    // What comes back the first time can differ: XML does not tell a text from the list that it
    // stands for, and coded numbers have no small `e`.
    for other in [&BIT_EFFICIENT, &STRING, &XML] {
        if let Some(message) = other.again(&message) {
            other.come_back(&message);
        }
    }
}

/// The payload of a letter; the first octet chooses its representation and its charset.
pub fn payload(data: &[u8]) {
    let Some((choice, octets)) = data.split_first() else {
        return;
    };
    let payload = Bytes::copy_from_slice(octets);
    let [representation, charset] = [choice % 4, choice / 4].map(usize::from);
    let envelope = Envelope::new(Slots {
        acl_representation: REPRESENTATIONS.get(representation).cloned(),
        payload_encoding: CHARSETS.get(charset).map(|name| Text::from(*name)),
        ..Slots::default()
    });
    for limits in [Limits::default(), SMALL] {
        if let Err(error) = decode_payload(&envelope, &payload, &limits) {
            assert!(error.offset <= payload.len(), "an error behind the end");
        }
        for representation in &REPRESENTATIONS {
            let read = decode_payload_as(representation, &envelope, &payload, &limits);
            if let Ok((_, used)) = read {
                assert!(used <= payload.len(), "a position behind the end");
            }
        }
    }
}

const REPRESENTATIONS: [Representation; 3] = [
    Representation::BitEfficient,
    Representation::String,
    Representation::Xml,
];

#[rustfmt::skip]
const CHARSETS: [&str; 12] = [
    "US-ASCII", "UTF-8", "UTF-16", "UTF-16LE", "UTF-16BE", "UTF-32", "UTF-32LE", "ISO-8859-1",
    "windows-1252", "Shift_JIS", "GB18030", "nobody knows this",
];

type Decode<T> = fn(&Bytes, &Limits) -> Result<T, DecodeError>;

/// How something is read and written.
struct Notation<T> {
    decode: Decode<T>,
    decode_prefix: Decode<(T, usize)>,
    encode: fn(&T, &mut Output) -> Result<(), EncodeError>,
    /// Makes the same what the notation does not tell apart.
    level: fn(&mut T),
}

const BIT_EFFICIENT: Notation<Message> = Notation {
    decode: bit_efficient::decode_message,
    decode_prefix: bit_efficient::decode_message_prefix,
    encode: bit_efficient::encode_message,
    level: message_in_utc,
};

const BIT_EFFICIENT_LETTER: Notation<Letter> = Notation {
    decode: bit_efficient::decode_letter,
    decode_prefix: bit_efficient::decode_letter_prefix,
    encode: bit_efficient::encode_letter,
    level: letter_in_utc,
};

const STRING: Notation<Message> = Notation {
    decode: string::decode_message,
    decode_prefix: string::decode_message_prefix,
    encode: string::encode_message,
    level: message_in_utc,
};

const XML: Notation<Message> = Notation {
    decode: xml::decode_message,
    decode_prefix: xml::decode_message_prefix,
    encode: xml::encode_message,
    level: message_in_utc,
};

const XML_LETTER: Notation<Letter> = Notation {
    decode: xml::decode_letter,
    decode_prefix: xml::decode_letter_prefix,
    encode: xml::encode_letter,
    level: letter_in_utc,
};

impl<T: Clone + Debug + PartialEq> Notation<T> {
    fn hold(&self, data: &[u8]) {
        let octets = Bytes::copy_from_slice(data);
        if let Some(value) = self.read(&octets) {
            self.come_back(&value);
        }
    }

    /// Reads it in every way.
    fn read(&self, octets: &Bytes) -> Option<T> {
        let generous = (self.decode)(octets, &Limits::default());
        let frugal = (self.decode)(octets, &SMALL);
        if frugal.is_ok() {
            assert_eq!(frugal, generous, "limits change what is read");
        }
        for result in [&generous, &frugal] {
            let offset = result.as_ref().err().map_or(0, |error| error.offset);
            assert!(offset <= octets.len(), "an error behind the end");
        }
        for limits in [Limits::default(), SMALL] {
            let used = match (self.decode_prefix)(octets, &limits) {
                Ok((_, used)) => used,
                Err(error) => error.offset,
            };
            assert!(used <= octets.len(), "a position behind the end");
        }
        generous.ok()
    }

    /// What can be written is read as it was.
    fn come_back(&self, value: &T) {
        if let Some(again) = self.again(value) {
            let mut expected = value.clone();
            (self.level)(&mut expected);
            assert_eq!(again, expected, "it changed");
            let octets = self.written(value);
            assert_eq!(self.written(&again), octets, "it is written differently");
        }
    }

    /// Writes what can be written, and reads it.
    fn again(&self, value: &T) -> Option<T> {
        let octets = self.written(value)?;
        let again = (self.decode)(&octets, &Limits::default());
        Some(again.unwrap_or_else(|error| panic!("{error}: {octets:?}, which is {value:?}")))
    }

    /// Writes it behind something that stays as it is.
    fn written(&self, value: &T) -> Option<Bytes> {
        let mut out = Output::new();
        out.put_slice(b"before");
        let written = (self.encode)(value, &mut out);
        let all = out.take_bytes();
        assert_eq!(all.slice(..6), "before");
        if written.is_err() {
            assert_eq!(all.len(), 6, "an error leaves octets");
        }
        written.ok().map(|()| all.slice(6..))
    }
}

fn message_in_utc(message: &mut Message) {
    message.reply_by.iter_mut().for_each(in_utc);
}

fn letter_in_utc(letter: &mut Letter) {
    let Envelope { base, overlays } = &mut letter.envelope;
    overlays.iter_mut().chain([base]).for_each(slots_in_utc);
}

fn slots_in_utc(slots: &mut Slots) {
    slots.date.iter_mut().for_each(in_utc);
    let stamps = slots.received.iter_mut();
    stamps.for_each(|stamp| in_utc(&mut stamp.date));
}

/// Times are written in UTC, whatever they said.
fn in_utc(time: &mut FipaTime) {
    if let FipaTime::Absolute { zone, .. } = time {
        *zone = Zone::Utc;
    }
}
