//! Messages and letters in whichever representation they are.

use bytes::Bytes;
use fipa_acl::{Envelope, Letter, Message, Representation, Slots};

use crate::{DecodeError, Dialect, EncodeError, Fault, Form, Limits, Output};
use crate::{bit_efficient, detect, string, xml};

/// Reads a message that fills the whole input.
///
/// An unknown representation is [`Unsupported`](Fault::Unsupported).
pub fn decode_message(
    representation: &Representation,
    bytes: &Bytes,
    limits: &Limits,
) -> Result<Message, DecodeError> {
    match representation {
        Representation::BitEfficient => bit_efficient::decode_message(bytes, limits),
        Representation::String => string::decode_message(bytes, limits),
        Representation::Xml => xml::decode_message(bytes, limits),
        Representation::Other(_) => Err(UNKNOWN),
    }
}

/// Reads the message at the beginning of the input, and tells how many octets it has.
///
/// An unknown representation is [`Unsupported`](Fault::Unsupported).
pub fn decode_message_prefix(
    representation: &Representation,
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    match representation {
        Representation::BitEfficient => bit_efficient::decode_message_prefix(bytes, limits),
        Representation::String => string::decode_message_prefix(bytes, limits),
        Representation::Xml => xml::decode_message_prefix(bytes, limits),
        Representation::Other(_) => Err(UNKNOWN),
    }
}

const UNKNOWN: DecodeError = DecodeError {
    offset: 0,
    fault: Fault::Unsupported,
    what: "nobody here knows this representation",
};

/// Appends a message; on an error `out` is as before.
pub fn encode_message(
    representation: &Representation,
    message: &Message,
    out: &mut Output,
) -> Result<(), EncodeError> {
    encode_message_as(Dialect::Standard, representation, message, out)
}

/// Appends a message as a peer needs it; on an error `out` is as before.
pub fn encode_message_as(
    dialect: Dialect,
    representation: &Representation,
    message: &Message,
    out: &mut Output,
) -> Result<(), EncodeError> {
    match representation {
        Representation::BitEfficient => bit_efficient::encode_message_as(dialect, message, out),
        Representation::String => string::encode_message_as(dialect, message, out),
        Representation::Xml => xml::encode_message_as(dialect, message, out),
        Representation::Other(_) => Err(EncodeError {
            parameter: "acl-representation",
            what: "nobody here knows this representation",
        }),
    }
}

/// How an envelope is represented. There is no string form of envelopes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EnvelopeRepresentation {
    /// SC00088D.
    BitEfficient,
    /// SC00085J.
    Xml,
}

impl EnvelopeRepresentation {
    /// That of the envelope that begins here, judged by its first octets and, in XML, its
    /// outermost element; `None` if no envelope begins here.
    pub fn detect(bytes: &[u8]) -> Option<EnvelopeRepresentation> {
        match detect(bytes) {
            Form::BitEfficientEnvelope => Some(EnvelopeRepresentation::BitEfficient),
            Form::Xml if xml::is_envelope(bytes) => Some(EnvelopeRepresentation::Xml),
            _ => None,
        }
    }

    fn required(bytes: &[u8]) -> Result<EnvelopeRepresentation, DecodeError> {
        match detect(bytes) {
            Form::BitEfficientEnvelope => Ok(EnvelopeRepresentation::BitEfficient),
            // What is wrong with another document shows where it is read.
            Form::Xml => Ok(EnvelopeRepresentation::Xml),
            _ => Err(DecodeError {
                offset: 0,
                fault: Fault::Malformed,
                what: "no envelope begins like this",
            }),
        }
    }
}

/// Reads the envelope at the beginning of the input in whichever representation it is, and tells
/// where its payload begins.
pub fn decode_envelope(bytes: &Bytes, limits: &Limits) -> Result<(Envelope, usize), DecodeError> {
    match EnvelopeRepresentation::required(bytes)? {
        EnvelopeRepresentation::BitEfficient => bit_efficient::decode_envelope(bytes, limits),
        EnvelopeRepresentation::Xml => xml::decode_envelope(bytes, limits),
    }
}

/// The layers of the envelope at the beginning of the input, base and overlays, in the order of the
/// wire: in bit-efficient form as they stand there, wherever the newest one is, in XML from the
/// lowest number on.
pub fn decode_layers(bytes: &Bytes, limits: &Limits) -> Result<Vec<Slots>, DecodeError> {
    match EnvelopeRepresentation::required(bytes)? {
        EnvelopeRepresentation::BitEfficient => bit_efficient::decode_layers(bytes, limits),
        EnvelopeRepresentation::Xml => {
            let (Envelope { base, overlays }, _) = xml::decode_envelope(bytes, limits)?;
            Ok(std::iter::once(base).chain(overlays).collect())
        }
    }
}

/// Reads a letter that fills the whole input: what follows the envelope, in whichever
/// representation that is, is the payload, whatever its announced length is.
pub fn decode_letter(bytes: &Bytes, limits: &Limits) -> Result<Letter, DecodeError> {
    match EnvelopeRepresentation::required(bytes)? {
        EnvelopeRepresentation::BitEfficient => bit_efficient::decode_letter(bytes, limits),
        EnvelopeRepresentation::Xml => xml::decode_letter(bytes, limits),
    }
}

/// Reads the letter at the beginning of the input, and tells how many octets it has: its payload
/// ends at its announced length if there is one and the input is that long, else with the input.
pub fn decode_letter_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Letter, usize), DecodeError> {
    match EnvelopeRepresentation::required(bytes)? {
        EnvelopeRepresentation::BitEfficient => bit_efficient::decode_letter_prefix(bytes, limits),
        EnvelopeRepresentation::Xml => xml::decode_letter_prefix(bytes, limits),
    }
}

/// Appends an envelope; on an error `out` is as before.
pub fn encode_envelope(
    representation: EnvelopeRepresentation,
    envelope: &Envelope,
    out: &mut Output,
) -> Result<(), EncodeError> {
    encode_envelope_as(Dialect::Standard, representation, envelope, 0, out)
}

/// Appends an envelope as a peer needs it; on an error `out` is as before.
///
/// `payload` counts the octets that will follow: some peers need the length where the envelope
/// does not state it.
pub fn encode_envelope_as(
    dialect: Dialect,
    representation: EnvelopeRepresentation,
    envelope: &Envelope,
    payload: usize,
    out: &mut Output,
) -> Result<(), EncodeError> {
    match representation {
        EnvelopeRepresentation::BitEfficient => {
            bit_efficient::encode_envelope_as(dialect, envelope, payload, out)
        }
        EnvelopeRepresentation::Xml => xml::encode_envelope_as(dialect, envelope, payload, out),
    }
}

/// Appends a letter: its envelope, and directly behind it its payload. On an error `out` is as
/// before.
pub fn encode_letter(
    representation: EnvelopeRepresentation,
    letter: &Letter,
    out: &mut Output,
) -> Result<(), EncodeError> {
    encode_letter_as(Dialect::Standard, representation, letter, out)
}

/// Appends a letter as a peer needs it; on an error `out` is as before. The payload is not
/// touched: in which representation the peer reads it is for
/// [`Dialect::message_representation`] to say.
pub fn encode_letter_as(
    dialect: Dialect,
    representation: EnvelopeRepresentation,
    letter: &Letter,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let Letter { envelope, payload } = letter;
    encode_envelope_as(dialect, representation, envelope, payload.len(), out)?;
    out.put_shared(payload);
    Ok(())
}
