//! Bit-efficient messages (FIPA SC00069G) and envelopes (FIPA SC00088D).
//!
//! Writing is strict unless a [`Dialect`] is given; reading accepts what known peers write.
//! Contents and longer texts that were read share the buffer of the input. Without a [`CodeTable`]
//! a message that announces one is read as long as nothing is taken from it.

mod agents;
mod agents_writer;
mod code_table;
mod codes;
mod envelope_reader;
mod envelope_writer;
mod expression_writer;
mod expressions;
mod message_reader;
mod message_writer;
mod numbers;
mod options;
mod overlay;
mod reader;
mod scan;
mod shape;
mod texts;
mod times;
mod with_table;
mod writer;

use bytes::Bytes;
use fipa_acl::{Envelope, Letter, Message, Slots};

pub use self::code_table::{CodeTable, InvalidTableSize};
pub(crate) use self::options::{Newest, WriteOptions};
pub use self::overlay::{InsertError, insert_overlay_as};
use self::reader::Reader;
pub use self::shape::EnvelopeShape;
pub use self::with_table::{decode_message_prefix_with, decode_message_with, encode_message_with};
use crate::{DecodeError, Dialect, EncodeError, Limits, Output, letter};

/// Reads a message (SC00069G section 2) that fills the whole input; line ends behind it are
/// ignored.
pub fn decode_message(bytes: &Bytes, limits: &Limits) -> Result<Message, DecodeError> {
    Reader::new(bytes, limits).message(|reader| reader.finish())
}

/// Reads the message (SC00069G section 2) at the beginning of the input, and tells how many octets
/// it has.
pub fn decode_message_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    let mut reader = Reader::new(bytes, limits);
    let message = reader.message(|_| Ok(()))?;
    Ok((message, reader.position()))
}

/// Appends a message (SC00069G section 2); on an error `out` is as before.
///
/// Names, addresses and the protocol must be words ([`Text::is_word`](fipa_acl::Text::is_word)).
pub fn encode_message(message: &Message, out: &mut Output) -> Result<(), EncodeError> {
    encode_message_as(Dialect::Standard, message, out)
}

/// Appends a message (SC00069G section 2) as a peer needs it; on an error `out` is as before.
pub fn encode_message_as(
    dialect: Dialect,
    message: &Message,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let options = dialect.bit_efficient();
    out.reserve(message_writer::expected_len(message));
    out.all_or_nothing(|out| message_writer::write_message(message, options, out))
}

/// Reads the envelope (SC00088D section 2) at the beginning of the input, and tells where its
/// payload begins.
pub fn decode_envelope(bytes: &Bytes, limits: &Limits) -> Result<(Envelope, usize), DecodeError> {
    let mut envelope = Envelope::default();
    let begin = decode_envelope_into(bytes, limits, &mut envelope)?;
    Ok((envelope, begin))
}

/// Reads the envelope at the beginning of the input into one that is there, whose memory is used
/// again; tells where the payload begins. On an error the envelope holds a part of what was read.
pub fn decode_envelope_into(
    bytes: &Bytes,
    limits: &Limits,
    envelope: &mut Envelope,
) -> Result<usize, DecodeError> {
    let mut reader = Reader::new(bytes, limits);
    envelope.clear();
    reader.envelope(envelope)?;
    Ok(reader.position())
}

/// The layers of the envelope (SC00088D section 2) at the beginning of the input as they stand
/// there: the base is last, and the newest overlay is in front or, from some peers, directly in
/// front of the base.
pub fn decode_layers(bytes: &Bytes, limits: &Limits) -> Result<Vec<Slots>, DecodeError> {
    Reader::new(bytes, limits).layers_as_they_stand()
}

/// Reads a letter (SC00088D section 2) that fills the whole input: what follows the envelope is
/// the payload, whatever its announced length is.
pub fn decode_letter(bytes: &Bytes, limits: &Limits) -> Result<Letter, DecodeError> {
    let (envelope, begin) = decode_envelope(bytes, limits)?;
    letter::around(envelope, bytes, begin..bytes.len(), limits)
}

/// Reads the letter (SC00088D section 2) at the beginning of the input, and tells how many octets
/// it has: its payload ends at its announced length if there is one and the input is that long,
/// else with the input.
pub fn decode_letter_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Letter, usize), DecodeError> {
    let (envelope, begin) = decode_envelope(bytes, limits)?;
    letter::prefix(envelope, bytes, begin, limits)
}

/// Appends a letter (SC00088D section 2): its overlays from the newest to the oldest, its base and
/// its payload. On an error `out` is as before.
pub fn encode_letter(letter: &Letter, out: &mut Output) -> Result<(), EncodeError> {
    encode_letter_as(Dialect::Standard, letter, out)
}

/// Appends a letter (SC00088D section 2) as a peer needs it; on an error `out` is as before. The
/// payload is not touched.
pub fn encode_letter_as(
    dialect: Dialect,
    letter: &Letter,
    out: &mut Output,
) -> Result<(), EncodeError> {
    encode_envelope_as(dialect, &letter.envelope, letter.payload.len(), out)?;
    out.put_shared(&letter.payload);
    Ok(())
}

/// Appends an envelope (SC00088D section 2): its overlays from the newest to the oldest, and its
/// base. On an error `out` is as before.
///
/// The base must have its representation and its date, no overlay can have a date, and no date
/// can be relative.
pub fn encode_envelope(envelope: &Envelope, out: &mut Output) -> Result<(), EncodeError> {
    encode_envelope_as(Dialect::Standard, envelope, 0, out)
}

/// Appends an envelope (SC00088D section 2) as a peer needs it; on an error `out` is as before.
///
/// `payload` counts the octets that will follow: some peers need the length where the envelope
/// does not state it.
pub fn encode_envelope_as(
    dialect: Dialect,
    envelope: &Envelope,
    payload: usize,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let options = dialect.bit_efficient();
    let payload = overlay::count(payload);
    out.reserve(ENVELOPE);
    out.all_or_nothing(|out| {
        envelope_writer::write_envelope(envelope, payload, options, out.buffer())
    })
}

/// Appends an envelope whose newest overlay stands last, directly in front of the base, as
/// fipa_services has it; on an error `out` is as before.
///
/// By the lengths that fipa_services announces readers know the order. All else is by the
/// standard: to write to fipa_services there is [`encode_envelope_as`].
pub fn encode_envelope_newest_last(
    envelope: &Envelope,
    out: &mut Output,
) -> Result<(), EncodeError> {
    const OPTIONS: WriteOptions = WriteOptions {
        newest: Newest::Last,
        ..WriteOptions::STRICT
    };
    out.all_or_nothing(|out| envelope_writer::write_envelope(envelope, 0, &OPTIONS, out.buffer()))
}

/// Appends one overlay (SC00088D section 2.2): what a message transport service puts in front of
/// the letter that it received. On an error `out` is as before.
pub fn encode_overlay(overlay: &Slots, out: &mut Output) -> Result<(), EncodeError> {
    let options = &WriteOptions::STRICT;
    out.all_or_nothing(|out| envelope_writer::write_overlay(overlay, 0, options, out.buffer()))
}

/// Octets of an ordinary envelope.
const ENVELOPE: usize = 512;
