use bytes::Bytes;
use fipa_acl::{Envelope, Message};
use fipa_codec::{EncodeError, Output, bit_efficient};
use fipa_json::{Body, EnvelopeForm, LetterForm};

use super::{EnvelopeRep, Rep, STRING, XML, envelope_of_layers};

/// Appends a message.
///
/// # Errors
/// A parameter cannot be written in this representation, or the representation cannot yet.
pub fn encode_message(message: &Message, rep: Rep, output: &mut Output) -> Result<(), EncodeError> {
    match rep {
        Rep::BitEfficient => bit_efficient::encode_message(message, output),
        Rep::Xml => Err(unsupported("--as", XML)),
        Rep::String => Err(unsupported("--as", STRING)),
    }
}

/// Appends a letter: its message, if it is not a payload already, is encoded as `rep`.
///
/// The envelope is written as given if it was given in layers; else it says how the payload is
/// represented and how long it is.
///
/// # Errors
/// A parameter or slot cannot be written in its representation, or the representation cannot yet.
pub fn encode_letter(
    letter: LetterForm,
    rep: Rep,
    envelope_rep: EnvelopeRep,
    output: &mut Output,
) -> Result<(), EncodeError> {
    let (payload, is_encoded_here) = match letter.body {
        Body::Message(message) => (encoded(&message, rep)?, true),
        Body::Payload(payload) => (payload, false),
    };
    let envelope = match letter.envelope {
        EnvelopeForm::Layers(layers) => envelope_of_layers(layers, envelope_rep),
        EnvelopeForm::Flattened(mut envelope) => {
            let base = &mut envelope.base;
            base.payload_length = Some(payload.len() as u64);
            // A payload that came encoded is of the representation that its envelope names.
            if is_encoded_here || base.acl_representation.is_none() {
                base.acl_representation = Some(rep.into());
            }
            *envelope
        }
    };
    encode_envelope(&envelope, envelope_rep, output)?;
    output.put_shared(&payload);
    Ok(())
}

fn encoded(message: &Message, rep: Rep) -> Result<Bytes, EncodeError> {
    let mut payload = Output::new();
    encode_message(message, rep, &mut payload)?;
    Ok(payload.take_bytes())
}

fn encode_envelope(
    envelope: &Envelope,
    rep: EnvelopeRep,
    output: &mut Output,
) -> Result<(), EncodeError> {
    match rep {
        EnvelopeRep::BitEfficient => bit_efficient::encode_envelope(envelope, output),
        EnvelopeRep::Xml => Err(unsupported("--envelope", XML)),
    }
}

fn unsupported(parameter: &'static str, what: &'static str) -> EncodeError {
    EncodeError { parameter, what }
}
