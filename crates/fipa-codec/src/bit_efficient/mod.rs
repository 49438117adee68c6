//! Bit-efficient messages (FIPA SC00069G) and envelopes (FIPA SC00088D).
//!
//! Writing is strict; reading accepts what known peers write. Texts and contents that were read
//! share the buffer of the input. No code table is used: a message that announces one is read as
//! long as nothing is taken from it.

mod agents;
mod codes;
mod envelope_reader;
mod envelope_writer;
mod expressions;
mod message_reader;
mod message_writer;
mod reader;
mod values;
mod writer;

use bytes::Bytes;
use fipa_acl::{Envelope, Letter, Message, Slots};

use self::reader::Reader;
use crate::{DecodeError, EncodeError, Fault, Limits, Output};

/// Reads a message (SC00069G section 2) that fills the whole input; line ends behind it are
/// ignored.
pub fn decode_message(bytes: &Bytes, limits: &Limits) -> Result<Message, DecodeError> {
    let (message, used) = decode_message_prefix(bytes, limits)?;
    let behind = bytes.get(used..).unwrap_or_default();
    match behind
        .iter()
        .position(|octet| !matches!(octet, b'\r' | b'\n'))
    {
        None => Ok(message),
        Some(position) => Err(DecodeError {
            offset: used + position,
            fault: Fault::Malformed,
            what: "something follows the message",
        }),
    }
}

/// Reads the message (SC00069G section 2) at the beginning of the input, and tells how many octets
/// it has.
pub fn decode_message_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    let mut reader = Reader::new(bytes, limits);
    let message = reader.message()?;
    Ok((message, reader.position()))
}

/// Appends a message (SC00069G section 2); on an error `out` is as before.
///
/// Names, addresses and the protocol must be words ([`Text::is_word`](fipa_acl::Text::is_word)).
pub fn encode_message(message: &Message, out: &mut Output) -> Result<(), EncodeError> {
    out.reserve(message_writer::expected_len(message));
    out.all_or_nothing(|out| message_writer::write_message(message, out))
}

/// Reads the envelope (SC00088D section 2) at the beginning of the input, and tells where its
/// payload begins.
pub fn decode_envelope(bytes: &Bytes, limits: &Limits) -> Result<(Envelope, usize), DecodeError> {
    let mut reader = Reader::new(bytes, limits);
    let envelope = reader.envelope()?;
    Ok((envelope, reader.position()))
}

/// Reads a letter (SC00088D section 2) that fills the whole input: what follows the envelope is
/// the payload, whatever its announced length is.
pub fn decode_letter(bytes: &Bytes, limits: &Limits) -> Result<Letter, DecodeError> {
    let (envelope, begin) = decode_envelope(bytes, limits)?;
    letter(envelope, bytes, begin..bytes.len(), limits)
}

/// Reads the letter (SC00088D section 2) at the beginning of the input, and tells how many octets
/// it has: its payload ends at its announced length if there is one and the input is that long,
/// else with the input.
pub fn decode_letter_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Letter, usize), DecodeError> {
    let (envelope, begin) = decode_envelope(bytes, limits)?;
    let announced = envelope
        .payload_length()
        .and_then(|length| begin.checked_add(usize::try_from(length).ok()?));
    let end = announced.unwrap_or(usize::MAX);
    let end = if end > bytes.len() { bytes.len() } else { end };
    Ok((letter(envelope, bytes, begin..end, limits)?, end))
}

/// Appends a letter (SC00088D section 2): its overlays from the newest to the oldest, its base and
/// its payload. On an error `out` is as before.
pub fn encode_letter(letter: &Letter, out: &mut Output) -> Result<(), EncodeError> {
    encode_envelope(&letter.envelope, out)?;
    out.put_shared(&letter.payload);
    Ok(())
}

/// Appends an envelope (SC00088D section 2): its overlays from the newest to the oldest, and its
/// base. On an error `out` is as before.
///
/// The base must have its representation and its date, no overlay can have a date, and no date
/// can be relative.
pub fn encode_envelope(envelope: &Envelope, out: &mut Output) -> Result<(), EncodeError> {
    out.reserve(ENVELOPE);
    out.all_or_nothing(|out| {
        for overlay in envelope.overlays.iter().rev() {
            envelope_writer::write_overlay(overlay, out.buffer())?;
        }
        envelope_writer::write_base(&envelope.base, out.buffer())
    })
}

/// Appends one overlay (SC00088D section 2.2): what a message transport service puts in front of
/// the letter that it received. On an error `out` is as before.
pub fn encode_overlay(overlay: &Slots, out: &mut Output) -> Result<(), EncodeError> {
    out.all_or_nothing(|out| envelope_writer::write_overlay(overlay, out.buffer()))
}

/// Octets of an ordinary envelope.
const ENVELOPE: usize = 512;

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
