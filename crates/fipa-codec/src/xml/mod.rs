//! XML messages (FIPA SC00071E) and envelopes (FIPA SC00085J).
//!
//! Writing is strict unless a [`Dialect`] is given; reading accepts what known peers write, text
//! that JADE did not escape included. UTF-16 is read, and the charset that a declaration names.
//! Contents and longer texts that were read share the buffer of the input unless there are
//! references in them or they had to be transcoded. Nothing is validated against a document type,
//! no entity is ever expanded, and a document type with declarations of its own is refused.
//!
//! An empty text and an absent one are the same in XML: both are read as absent, and neither is
//! written, except as the value of a user-defined parameter. A content with much markup is written
//! in a CDATA section, which is shorter and needs no copy. A content that is not legal XML text
//! is written in Base64 with a parameter `X-JADE-Encoding` that says so; reading undoes that.

mod agents_reader;
mod agents_writer;
mod content;
mod cursor;
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
pub(crate) use self::options::{ContentForm, Layers, WriteOptions};
use self::transcode::{from_declared, from_utf16};
use crate::{DecodeError, Dialect, EncodeError, Fault, Limits, Output, letter};

/// Reads a message (SC00071E) that fills the whole input; white space behind it is ignored.
pub fn decode_message(bytes: &Bytes, limits: &Limits) -> Result<Message, DecodeError> {
    let (message, _) = decode(
        bytes,
        limits,
        |_| None,
        |bytes| Ok((decode_utf8_message(bytes, limits)?, bytes.len())),
    )?;
    Ok(message)
}

/// Reads the message (SC00071E) at the beginning of the input, and tells how many octets it has:
/// it ends with its end tag.
pub fn decode_message_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    decode(
        bytes,
        limits,
        |_| None,
        |bytes| decode_utf8_message_prefix(bytes, limits),
    )
}

/// Reads a message that was made UTF-8, whatever its declaration says; see [`decode_message`].
pub(crate) fn decode_utf8_message(bytes: &Bytes, limits: &Limits) -> Result<Message, DecodeError> {
    let whole = |cursor: &mut Cursor<'_>| {
        let message = cursor.message()?;
        cursor.finish()?;
        Ok(message)
    };
    let (message, _) = strict_or_lenient(bytes, limits, whole, |octets| Some(octets.len()))?;
    Ok(message)
}

/// Reads a message that was made UTF-8, whatever its declaration says; see
/// [`decode_message_prefix`].
pub(crate) fn decode_utf8_message_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    // What follows it is not searched for the end of a text in this one.
    let end = |octets: &[u8]| end_of(octets, b"</fipa-message>");
    strict_or_lenient(bytes, limits, |cursor| cursor.message(), end)
}

/// Appends a message (SC00071E); on an error `out` is as before.
///
/// The performative must be one of the standard, and texts must be of characters that XML allows.
pub fn encode_message(message: &Message, out: &mut Output) -> Result<(), EncodeError> {
    encode_message_as(Dialect::Standard, message, out)
}

/// Appends a message (SC00071E) as a peer needs it; on an error `out` is as before.
pub fn encode_message_as(
    dialect: Dialect,
    message: &Message,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let options = dialect.xml();
    out.reserve(message_writer::expected_len(message));
    out.all_or_nothing(|out| message_writer::write_message(message, options, out))
}

/// Reads the envelope (SC00085J) at the beginning of the input, and tells where its payload
/// begins: directly behind its end tag.
pub fn decode_envelope(bytes: &Bytes, limits: &Limits) -> Result<(Envelope, usize), DecodeError> {
    let end = |octets: &[u8]| end_of(octets, b"</envelope>");
    decode(bytes, limits, end, |bytes| {
        strict_or_lenient(bytes, limits, |cursor| cursor.envelope(), end)
    })
}

/// Reads a letter (SC00085J) that fills the whole input: what follows the envelope is the payload,
/// whatever its announced length is.
pub fn decode_letter(bytes: &Bytes, limits: &Limits) -> Result<Letter, DecodeError> {
    let (envelope, begin) = decode_envelope(bytes, limits)?;
    letter::around(envelope, bytes, begin..bytes.len(), limits)
}

/// Reads the letter (SC00085J) at the beginning of the input, and tells how many octets it has:
/// its payload ends at its announced length if there is one and the input is that long, else with
/// the input.
pub fn decode_letter_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Letter, usize), DecodeError> {
    let (envelope, begin) = decode_envelope(bytes, limits)?;
    letter::prefix(envelope, bytes, begin, limits)
}

/// Appends an envelope (SC00085J); on an error `out` is as before.
///
/// No date can be relative, a stamp must say by whom it is, and texts and the transport behaviour
/// must be of characters that XML allows.
pub fn encode_envelope(envelope: &Envelope, out: &mut Output) -> Result<(), EncodeError> {
    encode_envelope_as(Dialect::Standard, envelope, 0, out)
}

/// Appends an envelope (SC00085J) as a peer needs it; on an error `out` is as before.
///
/// `payload` counts the octets that will follow: some peers need the length where the envelope
/// does not state it.
pub fn encode_envelope_as(
    dialect: Dialect,
    envelope: &Envelope,
    payload: usize,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let options = dialect.xml();
    let payload = u64::try_from(payload).unwrap_or(u64::MAX);
    let write = |out: &mut Output| envelope_writer::write_envelope(envelope, payload, options, out);
    if options.plain_envelopes {
        let mut document = Output::new();
        document.reserve(ENVELOPE);
        write(&mut document)?;
        let document = document.take_bytes();
        match document.is_ascii() && memchr::memchr(b'\n', &document).is_none() {
            true => out.put_slice(&document),
            false => writer::write_plain(&String::from_utf8_lossy(&document), out),
        }
        return Ok(());
    }
    out.reserve(ENVELOPE);
    out.all_or_nothing(write)
}

/// Appends a letter (SC00085J): its envelope, and directly behind it its payload. On an error
/// `out` is as before.
pub fn encode_letter(letter: &Letter, out: &mut Output) -> Result<(), EncodeError> {
    encode_letter_as(Dialect::Standard, letter, out)
}

/// Appends a letter (SC00085J) as a peer needs it; on an error `out` is as before. The payload is
/// not touched.
pub fn encode_letter_as(
    dialect: Dialect,
    letter: &Letter,
    out: &mut Output,
) -> Result<(), EncodeError> {
    encode_envelope_as(dialect, &letter.envelope, letter.payload.len(), out)?;
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

/// Reads UTF-16 and the charsets that declarations name as well: what is found out about positions
/// is said of the input. What is behind `end`, if there is one, is in no charset.
fn decode<T>(
    bytes: &Bytes,
    limits: &Limits,
    end: impl FnOnce(&[u8]) -> Option<usize>,
    read: impl FnOnce(&Bytes) -> Result<(T, usize), DecodeError>,
) -> Result<(T, usize), DecodeError> {
    let transcoded = match from_utf16(bytes, limits.max_octets) {
        None => from_declared(bytes, end, limits.max_octets)?,
        transcoded => transcoded,
    };
    let Some(transcoded) = transcoded else {
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
