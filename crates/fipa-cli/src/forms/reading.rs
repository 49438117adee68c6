use bytes::Bytes;
use fipa_acl::{Letter, Message, Representation, Slots};
use fipa_codec::bit_efficient::{self, CodeTable};
use fipa_codec::{DecodeError, EnvelopeRepresentation, Fault, Form, Limits};
use fipa_json::Body;

use super::Rep;

/// What the input must be; by default whatever is found there.
#[derive(Clone, Copy, Debug, Default)]
pub struct Expected {
    /// The representation of messages.
    pub rep: Option<Rep>,
    /// Whether it must be a letter.
    pub letter: bool,
}

/// What was read from the input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Item {
    /// A bare message.
    Message(Box<Message>),
    /// A letter, its payload unopened: see [`Decoder::payload`].
    Letter(Box<Letter>),
}

/// Reads what follows each other in one input.
#[derive(Debug, Default)]
pub struct Decoder {
    expected: Expected,
    table: Option<CodeTable>,
    limits: Limits,
}

impl Decoder {
    /// A decoder that insists on this; the table is that of all bit-efficient messages.
    pub fn new(expected: Expected, table: Option<CodeTable>) -> Decoder {
        Decoder {
            expected,
            table,
            limits: Limits::default(),
        }
    }

    /// Reads the message or letter that begins at `at` of the input; also says where it ends.
    ///
    /// # Errors
    /// What begins there is neither, not what is expected, or cut short. The offset counts from
    /// the beginning of the input.
    pub fn item(&mut self, input: &Bytes, at: usize) -> Result<(Item, usize), DecodeError> {
        let (item, len) = self
            .first(&input.slice(at..))
            .map_err(|error| moved(error, at))?;
        Ok((item, at + len))
    }

    /// Opens a letter whose payload begins at `at` of the input.
    ///
    /// The payload is read as the expected representation, else as what the envelope says, else as
    /// what it looks like. One of a representation that nobody knows stays [`Body::Payload`], and
    /// so does none at all, if the envelope announces none: envelopes travel alone as well.
    ///
    /// # Errors
    /// The payload is malformed. The offset counts from the beginning of the input.
    pub fn payload(&mut self, letter: &Letter, at: usize) -> Result<Body, DecodeError> {
        let Letter { envelope, payload } = letter;
        let announced = envelope.payload_length().unwrap_or(0);
        let representation = match self.expected.rep {
            Some(rep) => Some(rep.into()),
            None if payload.is_empty() && announced == 0 => None,
            None => fipa_codec::payload_representation(envelope, payload),
        };
        match representation {
            None | Some(Representation::Other(_)) => Ok(Body::Payload(payload.clone())),
            Some(representation) => self
                .opened(letter, &representation)
                .map(|message| Body::Message(Box::new(message)))
                .map_err(|error| moved(error, at)),
        }
    }

    /// The layers of the envelope that begins at `at` of the input, in the order of the wire.
    ///
    /// # Errors
    /// No envelope begins there.
    pub fn layers(&self, input: &Bytes, at: usize) -> Result<Vec<Slots>, DecodeError> {
        fipa_codec::decode_layers(&input.slice(at..), &self.limits)
            .map_err(|error| moved(error, at))
    }

    /// Lets the code table learn what the message of a letter adds to it: whoever shows the payload
    /// unopened must do so, or what follows cannot be read.
    pub fn learn(&mut self, letter: &Letter) {
        if self.table.is_some() {
            // What is wrong in it is not asked for here, and spoils only what uses the table.
            let _ = self.payload(letter, 0);
        }
    }

    fn first(&mut self, input: &Bytes) -> Result<(Item, usize), DecodeError> {
        if EnvelopeRepresentation::detect(input).is_some() {
            let (letter, len) = fipa_codec::decode_letter_prefix(input, &self.limits)?;
            return Ok((Item::Letter(Box::new(letter)), len));
        }
        if self.expected.letter {
            return Err(malformed(0, "no letter begins here"));
        }
        let expected = self.expected.rep.map(Representation::from);
        let representation = expected
            .or_else(|| detected(input))
            .ok_or(malformed(0, "neither a message nor a letter begins here"))?;
        let (message, len) = self.message(&representation, input)?;
        Ok((Item::Message(Box::new(message)), len))
    }

    fn message(
        &mut self,
        representation: &Representation,
        input: &Bytes,
    ) -> Result<(Message, usize), DecodeError> {
        match &mut self.table {
            Some(table) if uses_table(representation, input) => {
                bit_efficient::decode_message_prefix_with(input, &self.limits, table)
            }
            _ => fipa_codec::decode_message_prefix(representation, input, &self.limits),
        }
    }

    /// Where the envelope says how long the payload is, nothing is lost by what stands behind the
    /// message; else that is part of the input like everything else.
    fn opened(
        &mut self,
        letter: &Letter,
        representation: &Representation,
    ) -> Result<Message, DecodeError> {
        let Letter { envelope, payload } = letter;
        let (message, len) = match self.table {
            Some(_) if uses_table(representation, payload) => {
                self.message(representation, payload)?
            }
            _ => fipa_codec::decode_payload_as(representation, envelope, payload, &self.limits)?,
        };
        let end = behind_blanks(payload, len);
        if end < payload.len() && envelope.payload_length().is_none() {
            return Err(malformed(end, "something follows the message"));
        }
        Ok(message)
    }
}

/// Whether a code table is in use for what begins here.
fn uses_table(representation: &Representation, octets: &[u8]) -> bool {
    *representation == Representation::BitEfficient && matches!(octets, [0xfb | 0xfc, ..])
}

/// Where what follows the white space at `at` begins, be that in UTF-8 or UTF-16.
pub fn behind_blanks(octets: &[u8], mut at: usize) -> usize {
    loop {
        at += match &octets[at..] {
            [0, blank, ..] | [blank, 0, ..] if blank.is_ascii_whitespace() => 2,
            [blank, ..] if blank.is_ascii_whitespace() => 1,
            _ => return at,
        };
    }
}

/// The representation of the message that these octets look like.
fn detected(octets: &[u8]) -> Option<Representation> {
    match fipa_codec::detect(octets) {
        Form::BitEfficientMessage => Some(Representation::BitEfficient),
        Form::Xml => Some(Representation::Xml),
        Form::String => Some(Representation::String),
        Form::BitEfficientEnvelope | Form::Unknown => None,
    }
}

/// The error of a part that begins at `at`, as one of the whole.
fn moved(error: DecodeError, at: usize) -> DecodeError {
    DecodeError {
        offset: at + error.offset,
        ..error
    }
}

fn malformed(offset: usize, what: &'static str) -> DecodeError {
    DecodeError {
        offset,
        fault: Fault::Malformed,
        what,
    }
}
