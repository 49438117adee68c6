use bytes::Bytes;
use fipa_acl::{Letter, Message};
use fipa_codec::{DecodeError, Fault, Form, Limits, bit_efficient};
use fipa_json::Body;

use super::{EnvelopeRep, Rep, STRING, XML};

/// What the input must be; by default whatever is found there.
#[derive(Clone, Copy, Debug, Default)]
pub struct Expected {
    /// The representation of bare messages.
    pub rep: Option<Rep>,
    /// Whether it must be a letter.
    pub letter: bool,
}

/// What was read from the input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Item {
    /// A bare message.
    Message(Box<Message>),
    /// A letter, its payload unopened: see [`decode_payload`].
    Letter {
        /// The letter.
        letter: Box<Letter>,
        /// The representation of its envelope.
        rep: EnvelopeRep,
    },
}

/// Reads the message or letter that begins at `at` of the input; also says where it ends.
///
/// # Errors
/// What begins there is neither, not what is expected, cut short, or in a representation that
/// cannot be read yet. The offset counts from the beginning of the input.
pub fn decode_next(
    input: &Bytes,
    at: usize,
    expected: &Expected,
) -> Result<(Item, usize), DecodeError> {
    let rest = input.slice(at..);
    let (item, len) = decode_first(&rest, expected).map_err(|error| moved(error, at))?;
    Ok((item, at + len))
}

/// Opens a letter whose payload begins at `at` of the input.
///
/// The payload is read as `rep`, else as what the envelope says, else as what it looks like. One
/// of a representation that nobody knows stays [`Body::Payload`].
///
/// # Errors
/// The payload is malformed, or in a representation that cannot be read yet. The offset counts
/// from the beginning of the input.
pub fn decode_payload(letter: &Letter, at: usize, rep: Option<Rep>) -> Result<Body, DecodeError> {
    let payload = &letter.payload;
    let known = match letter.envelope.acl_representation() {
        Some(name) => Rep::of(name),
        None => Rep::detected(payload),
    };
    let Some(rep) = rep.or(known) else {
        return Ok(Body::Payload(payload.clone()));
    };
    let message = match letter.envelope.payload_length() {
        // Where the envelope says how long the payload is, nothing is lost by what stands behind
        // the message.
        Some(_) => decode_message_prefix(payload, rep).map(|(message, _)| message),
        None => decode_message(payload, rep),
    };
    message
        .map(|message| Body::Message(Box::new(message)))
        .map_err(|error| moved(error, at))
}

fn decode_first(input: &Bytes, expected: &Expected) -> Result<(Item, usize), DecodeError> {
    if fipa_codec::detect(input) == Form::BitEfficientEnvelope {
        let (letter, len) = bit_efficient::decode_letter_prefix(input, &Limits::default())?;
        let (letter, rep) = (Box::new(letter), EnvelopeRep::BitEfficient);
        return Ok((Item::Letter { letter, rep }, len));
    }
    let detected = Rep::detected(input);
    if expected.letter {
        // XML may well be a letter.
        return Err(match detected {
            Some(Rep::Xml) => unsupported(XML),
            _ => malformed("no letter begins here"),
        });
    }
    let rep = expected
        .rep
        .or(detected)
        .ok_or(malformed("neither a message nor a letter begins here"))?;
    let (message, len) = decode_message_prefix(input, rep)?;
    Ok((Item::Message(Box::new(message)), len))
}

fn decode_message_prefix(input: &Bytes, rep: Rep) -> Result<(Message, usize), DecodeError> {
    match rep {
        Rep::BitEfficient => bit_efficient::decode_message_prefix(input, &Limits::default()),
        Rep::Xml => Err(unsupported(XML)),
        Rep::String => Err(unsupported(STRING)),
    }
}

fn decode_message(input: &Bytes, rep: Rep) -> Result<Message, DecodeError> {
    match rep {
        Rep::BitEfficient => bit_efficient::decode_message(input, &Limits::default()),
        Rep::Xml => Err(unsupported(XML)),
        Rep::String => Err(unsupported(STRING)),
    }
}

/// The error of a part that begins at `at`, as one of the whole.
fn moved(error: DecodeError, at: usize) -> DecodeError {
    DecodeError {
        offset: at + error.offset,
        ..error
    }
}

fn malformed(what: &'static str) -> DecodeError {
    DecodeError {
        offset: 0,
        fault: Fault::Malformed,
        what,
    }
}

fn unsupported(what: &'static str) -> DecodeError {
    DecodeError {
        offset: 0,
        fault: Fault::Unsupported,
        what,
    }
}
