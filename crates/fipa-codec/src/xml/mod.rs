//! XML messages (FIPA SC00071E) and envelopes (FIPA SC00085J).
//!
//! Writing is strict; reading accepts what known peers write, text that JADE did not escape
//! included. Contents and texts that were read share the buffer of the input unless there are
//! references in them. Nothing is validated against a document type, no entity is ever expanded,
//! and a document type with declarations of its own is refused.
//!
//! An empty text and an absent one are the same in XML: both are read as absent, and neither is
//! written, except as the value of a user-defined parameter. A content that is not legal XML text
//! is written in Base64 with a parameter `X-JADE-Encoding` that says so; reading undoes that.

mod agents_reader;
mod agents_writer;
mod content;
mod cursor;
mod dates;
mod envelope_reader;
mod envelope_writer;
mod markup;
mod message_reader;
mod message_writer;
mod names;
mod options;
mod references;
mod tags;
mod text;
mod transcode;
mod values;
mod writer;

use bytes::Bytes;
use fipa_acl::{Envelope, Letter, Message};
use memchr::memmem;

use self::cursor::Cursor;
use self::names::Tag;
use self::options::WriteOptions;
use self::transcode::from_utf16;
use crate::{DecodeError, EncodeError, Fault, Limits, Output};

/// Reads a message (SC00071E) that fills the whole input; white space behind it is ignored.
pub fn decode_message(bytes: &Bytes, limits: &Limits) -> Result<Message, DecodeError> {
    let whole = |cursor: &mut Cursor<'_>| {
        let message = cursor.message()?;
        cursor.finish()?;
        Ok(message)
    };
    let (message, _) = decode(bytes, limits, |bytes| {
        strict_or_lenient(bytes, limits, whole, |_| Some(bytes.len()))
    })?;
    Ok(message)
}

/// Reads the message (SC00071E) at the beginning of the input, and tells how many octets it has:
/// it ends with its end tag.
pub fn decode_message_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    decode(bytes, limits, |bytes| {
        // What follows it is not searched for the end of a text in this one.
        let end = |octets: &[u8]| end_of(octets, b"</fipa-message>");
        strict_or_lenient(bytes, limits, |cursor| cursor.message(), end)
    })
}

/// Appends a message (SC00071E); on an error `out` is as before.
///
/// The performative must be one of the standard, and texts must be of characters that XML allows.
pub fn encode_message(message: &Message, out: &mut Output) -> Result<(), EncodeError> {
    encode_message_with(message, &WriteOptions::STRICT, out)
}

pub(crate) fn encode_message_with(
    message: &Message,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    out.reserve(message_writer::expected_len(message));
    out.all_or_nothing(|out| message_writer::write_message(message, options, out))
}

/// Reads the envelope (SC00085J) at the beginning of the input, and tells where its payload
/// begins: directly behind its end tag.
pub fn decode_envelope(bytes: &Bytes, limits: &Limits) -> Result<(Envelope, usize), DecodeError> {
    decode(bytes, limits, |bytes| {
        let end = |octets: &[u8]| end_of(octets, b"</envelope>");
        strict_or_lenient(bytes, limits, |cursor| cursor.envelope(), end)
    })
}

/// Reads a letter (SC00085J) that fills the whole input: what follows the envelope is the payload,
/// whatever its announced length is.
pub fn decode_letter(bytes: &Bytes, limits: &Limits) -> Result<Letter, DecodeError> {
    let (envelope, begin) = decode_envelope(bytes, limits)?;
    letter(envelope, bytes, begin..bytes.len(), limits)
}

/// Reads the letter (SC00085J) at the beginning of the input, and tells how many octets it has:
/// its payload ends at its announced length if there is one and the input is that long, else with
/// the input.
pub fn decode_letter_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Letter, usize), DecodeError> {
    let (envelope, begin) = decode_envelope(bytes, limits)?;
    let announced = envelope
        .payload_length()
        .and_then(|length| begin.checked_add(usize::try_from(length).ok()?));
    let end = announced
        .filter(|end| *end <= bytes.len())
        .unwrap_or(bytes.len());
    Ok((letter(envelope, bytes, begin..end, limits)?, end))
}

/// Appends an envelope (SC00085J); on an error `out` is as before.
///
/// No date can be relative, a stamp must say by whom it is, and texts and the transport behaviour
/// must be of characters that XML allows.
pub fn encode_envelope(envelope: &Envelope, out: &mut Output) -> Result<(), EncodeError> {
    encode_envelope_with(envelope, &WriteOptions::STRICT, out)
}

pub(crate) fn encode_envelope_with(
    envelope: &Envelope,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    out.reserve(ENVELOPE);
    out.all_or_nothing(|out| envelope_writer::write_envelope(envelope, options, out))
}

/// Appends a letter (SC00085J): its envelope, and directly behind it its payload. On an error
/// `out` is as before.
pub fn encode_letter(letter: &Letter, out: &mut Output) -> Result<(), EncodeError> {
    encode_letter_with(letter, &WriteOptions::STRICT, out)
}

pub(crate) fn encode_letter_with(
    letter: &Letter,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    encode_envelope_with(&letter.envelope, options, out)?;
    out.put_shared(&letter.payload);
    Ok(())
}

/// Whether the outermost element is an `envelope` (SC00085J); what is in it is not looked at.
pub fn is_envelope(bytes: &[u8]) -> bool {
    let limits = Limits::default();
    let text = match from_utf16(bytes, HEAD) {
        Some(transcoded) => transcoded.text,
        None => Bytes::copy_from_slice(bytes.get(..HEAD).unwrap_or(bytes)),
    };
    let root = Cursor::new(&text, &limits).root();
    root.is_ok_and(|root| root.tag == Tag::Envelope)
}

/// Octets of an ordinary envelope.
const ENVELOPE: usize = 1024;

/// Octets within which the outermost element begins, in whatever is worth looking at.
const HEAD: usize = 4096;

/// Reads UTF-16 as well: what is found out about its positions is said of the input.
fn decode<T>(
    bytes: &Bytes,
    limits: &Limits,
    read: impl FnOnce(&Bytes) -> Result<(T, usize), DecodeError>,
) -> Result<(T, usize), DecodeError> {
    let Some(transcoded) = from_utf16(bytes, limits.max_octets) else {
        return read(bytes);
    };
    match read(&transcoded.text) {
        Ok((value, used)) => Ok((value, transcoded.position(used))),
        Err(error) => Err(DecodeError {
            offset: transcoded.position(error.offset),
            ..error
        }),
    }
}

/// Reads as XML is; if that fails, as XML whose text was not escaped, up to the end that is found
/// for it. If that fails too, the first error counts.
fn strict_or_lenient<T>(
    bytes: &Bytes,
    limits: &Limits,
    read: impl Fn(&mut Cursor<'_>) -> Result<T, DecodeError>,
    end: impl FnOnce(&[u8]) -> Option<usize>,
) -> Result<(T, usize), DecodeError> {
    let mut cursor = Cursor::new(bytes, limits);
    let error = match read(&mut cursor) {
        Ok(value) => return Ok((value, cursor.at)),
        Err(error) => error,
    };
    if error.fault != Fault::Malformed {
        return Err(error);
    }
    let end = end(bytes).ok_or_else(|| error.clone())?;
    let mut cursor = Cursor::lenient(bytes, end, limits);
    match read(&mut cursor) {
        Ok(value) => Ok((value, cursor.at)),
        Err(_) => Err(error),
    }
}

fn end_of(octets: &[u8], end_tag: &[u8]) -> Option<usize> {
    memmem::find(octets, end_tag).map(|start| start + end_tag.len())
}

fn letter(
    envelope: Envelope,
    bytes: &Bytes,
    payload: std::ops::Range<usize>,
    limits: &Limits,
) -> Result<Letter, DecodeError> {
    if payload.end > limits.max_octets {
        return Err(DecodeError {
            offset: limits.max_octets,
            fault: Fault::Limit,
            what: "too long",
        });
    }
    let payload = bytes.slice(payload);
    Ok(Letter { envelope, payload })
}
