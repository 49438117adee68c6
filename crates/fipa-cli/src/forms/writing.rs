use bytes::Bytes;
use fipa_acl::{Envelope, Letter, Message, Representation};
use fipa_codec::bit_efficient::{self, CodeTable};
use fipa_codec::{EncodeError, EnvelopeRepresentation, Output};
use fipa_json::{Body, EnvelopeForm, LetterForm};

use super::layers::encode_layers;
use super::{EnvelopeRep, Rep};

/// Writes what follows each other in one output.
#[derive(Debug)]
pub struct Encoder {
    representation: Representation,
    table: Option<CodeTable>,
}

impl Encoder {
    /// An encoder of messages in this representation; the table is that of all bit-efficient
    /// messages.
    pub fn new(rep: Rep, table: Option<CodeTable>) -> Encoder {
        Encoder {
            representation: rep.into(),
            table,
        }
    }

    /// Appends a message.
    ///
    /// # Errors
    /// A parameter cannot be written in this representation.
    pub fn message(&mut self, message: &Message, output: &mut Output) -> Result<(), EncodeError> {
        match (&self.representation, &mut self.table) {
            (Representation::BitEfficient, Some(table)) => {
                bit_efficient::encode_message_with(message, table, output)
            }
            (representation, _) => fipa_codec::encode_message(representation, message, output),
        }
    }

    /// Appends a letter, encoding its message if it is not a payload already.
    ///
    /// The envelope is written as given if it was given in layers; else it says how the payload is
    /// represented, in which charset if it must, and how long it is.
    ///
    /// # Errors
    /// A parameter or slot cannot be written in its representation.
    pub fn letter(
        &mut self,
        letter: LetterForm,
        rep: EnvelopeRep,
        output: &mut Output,
    ) -> Result<(), EncodeError> {
        let rep = EnvelopeRepresentation::from(rep);
        let (payload, is_encoded_here) = match letter.body {
            Body::Message(message) => (self.payload(&message)?, true),
            Body::Payload(payload) => (payload, false),
        };
        let envelope = match letter.envelope {
            EnvelopeForm::Layers { layers, flattened } => {
                encode_layers(layers, flattened.as_deref(), rep, output)?;
                output.put_shared(&payload);
                return Ok(());
            }
            EnvelopeForm::Flattened(envelope) if is_encoded_here => {
                self.envelope_for(*envelope, &payload)
            }
            EnvelopeForm::Flattened(envelope) => self.envelope_around(*envelope, &payload),
        };
        fipa_codec::encode_letter(rep, &Letter { envelope, payload }, output)
    }

    fn payload(&mut self, message: &Message) -> Result<Bytes, EncodeError> {
        let mut payload = Output::new();
        self.message(message, &mut payload)?;
        Ok(payload.take_bytes())
    }

    /// The envelope for a payload that was encoded here.
    fn envelope_for(&self, mut envelope: Envelope, payload: &[u8]) -> Envelope {
        let base = &mut envelope.base;
        base.payload_length = Some(payload.len() as u64);
        let given = base.payload_encoding.as_ref();
        base.payload_encoding = fipa_codec::payload_encoding(&self.representation, payload, given);
        base.acl_representation = Some(self.representation.clone());
        envelope
    }

    /// The envelope for a payload that came encoded: it is of the representation that its
    /// envelope names.
    fn envelope_around(&self, mut envelope: Envelope, payload: &[u8]) -> Envelope {
        let base = &mut envelope.base;
        base.payload_length = Some(payload.len() as u64);
        base.acl_representation
            .get_or_insert_with(|| self.representation.clone());
        envelope
    }
}
