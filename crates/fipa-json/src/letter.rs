use bytes::Bytes;
use fipa_acl::{Envelope, FipaTime, Letter, Message, Received, Slots};
use serde_json::{Map, Value};

use crate::JsonError;
use crate::envelope::{slots_from_json, slots_to_json};
use crate::message::{message_from_json, message_to_json};
use crate::reader::Fields;
use crate::values::{base64_to_json, octets};

/// What a letter carries, as far as it was opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Body {
    /// The message in the payload; its key is `message`.
    Message(Box<Message>),
    /// The payload as it is, unopened or of an unknown representation; its key is `payload`.
    Payload(Bytes),
}

/// A letter as a program wrote it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LetterForm {
    /// The envelope.
    pub envelope: EnvelopeForm,
    /// What the letter carries.
    pub body: Body,
}

/// An envelope as a program wrote it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EnvelopeForm {
    /// From `envelope`: the base holds the values, and each stamp is one overlay.
    Flattened(Box<Envelope>),
    /// From `layers`: the base and the overlays, one at least, in the order given.
    Layers {
        /// The layers. Which of them is the base is up to the representation in which they are
        /// written.
        layers: Vec<Slots>,
        /// What stood beside them as `envelope`: it tells which overlay is the newest one, where
        /// the representation leaves that open.
        flattened: Option<Box<Envelope>>,
    },
}

/// A letter as `{"envelope":{…},"message":{…}}`, or with `payload` for one that was not opened.
///
/// The envelope is flattened: the latest value of every slot, and the stamps in order of travel.
pub fn letter_to_json(envelope: &Envelope, body: &Body) -> Value {
    let mut json = Map::new();
    json.insert("envelope".into(), flattened_to_json(envelope));
    match body {
        Body::Message(message) => json.insert("message".into(), message_to_json(message)),
        Body::Payload(payload) => json.insert("payload".into(), base64_to_json(payload)),
    };
    json.into()
}

/// A letter as `{"envelope":{…},"layers":[…],"payload":{"base64":…}}`.
///
/// `layers` are the base and the overlays of the letter's envelope in the order in which they
/// stand on the wire, which depends on the representation that they were read from.
pub fn raw_letter_to_json<'a>(
    letter: &Letter,
    layers: impl IntoIterator<Item = &'a Slots>,
) -> Value {
    let layers = layers
        .into_iter()
        .map(|layer| slots_to_json(layer, layer.received.iter()));
    let mut json = Map::new();
    json.insert("envelope".into(), flattened_to_json(&letter.envelope));
    json.insert("layers".into(), layers.collect());
    json.insert("payload".into(), base64_to_json(&letter.payload));
    json.into()
}

/// Reads the forms of [`letter_to_json`] and [`raw_letter_to_json`]; `layers` win over
/// `envelope`, and may hold a `message` as well.
///
/// # Errors
/// A [`JsonError`] that names the key that is missing, unknown or of another type: there must be
/// an `envelope` or `layers`, and either a `message` or a `payload`.
pub fn letter_from_json(value: &Value) -> Result<LetterForm, JsonError> {
    let fields = Fields::new(value, &["envelope", "layers", "message", "payload"])?;
    let flattened = fields
        .optional("envelope", flattened_from_json)?
        .map(Box::new);
    let layers = fields.list("layers", layer_from_json)?;
    let envelope = match (fields.has("layers"), flattened) {
        (true, _) if layers.is_empty() => {
            return Err(JsonError::expected("one envelope at least").under("layers"));
        }
        (true, flattened) => EnvelopeForm::Layers { layers, flattened },
        (false, Some(envelope)) => EnvelopeForm::Flattened(envelope),
        (false, None) => return Err(JsonError::new("missing").under("envelope")),
    };
    let message = fields.optional("message", message_from_json)?;
    let body = match (message, fields.optional("payload", octets)?) {
        (Some(message), None) => Body::Message(Box::new(message)),
        (None, Some(payload)) => Body::Payload(payload),
        (Some(_), Some(_)) => {
            return Err(JsonError::new("not beside message").under("payload"));
        }
        (None, None) => return Err(JsonError::new("missing").under("message")),
    };
    Ok(LetterForm { envelope, body })
}

/// The envelope for a message: `to` and `intended-receiver` are its receivers, `from` its sender,
/// `date` is `now`. How the payload is represented is for the encoder to say.
pub fn envelope_for(message: &Message, now: FipaTime) -> Envelope {
    Envelope::new(Slots {
        to: message.receiver.clone(),
        from: message.sender.clone(),
        date: Some(now),
        intended_receiver: message.receiver.clone(),
        ..Slots::default()
    })
}

fn flattened_to_json(envelope: &Envelope) -> Value {
    let mut flattened = envelope.flattened();
    // All of them from the oldest on: of a name given twice, in one layer or two, the last wins.
    flattened.user_defined = envelope
        .layers()
        .rev()
        .flat_map(|layer| layer.user_defined.iter().cloned())
        .collect();
    slots_to_json(&flattened, envelope.stamps())
}

fn flattened_from_json(value: &Value) -> Result<Envelope, JsonError> {
    let (base, stamps) = slots_from_json(value)?;
    let overlays = stamps.into_iter().map(stamped).collect();
    Ok(Envelope { base, overlays })
}

fn stamped(stamp: Received) -> Slots {
    Slots {
        received: Some(stamp),
        ..Slots::default()
    }
}

fn layer_from_json(value: &Value) -> Result<Slots, JsonError> {
    let (mut layer, mut stamps) = slots_from_json(value)?;
    layer.received = stamps.pop();
    if stamps.is_empty() {
        Ok(layer)
    } else {
        Err(JsonError::expected("one stamp at most in one layer").under("received"))
    }
}
