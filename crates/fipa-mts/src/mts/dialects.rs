//! A letter as services of other makes need it.

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, Representation, Slots, Text};
use fipa_codec::{
    Dialect, Limits, Output as Encoded, bit_efficient, decode_payload, encode_envelope_as,
    encode_message_as, payload_encoding, payload_representation,
};
use fipa_directory::{Address, MESSAGE_TRANSPORT};

use crate::pieces::{Pieces, joined};

/// The signature type of the bridge to JADE.
const JADE_BRIDGE: &str = "JadeProxyAgent";

/// A copy of a letter that may leave for a service of another make.
#[derive(Debug)]
pub(super) struct Foreign {
    /// The receiver.
    pub(super) to: AgentId,
    /// The agent that sends.
    pub(super) from: Text,
    /// The envelope as it came.
    pub(super) envelope: Envelope,
    /// Our stamp and the receiver.
    pub(super) overlay: Slots,
    /// The letter as it came: its bit-efficient envelope, within the first part, and its payload.
    pub(super) parts: Pieces,
    /// Where the payload begins.
    pub(super) payload: usize,
    /// Where it goes; empty: where the receiver is announced.
    pub(super) addresses: Vec<Address>,
    /// The transports that the sender prefers.
    pub(super) transports: Vec<Text>,
}

impl Foreign {
    /// The payload in one piece.
    pub(super) fn payload(&self) -> Bytes {
        joined(&self.parts, self.payload)
    }
}

/// How letters are written to a location of this signature type, if they are.
pub(super) fn of_signature(signature: &str) -> Option<Dialect> {
    match signature {
        MESSAGE_TRANSPORT => Some(Dialect::Cpp),
        JADE_BRIDGE => Some(Dialect::JadeBridge),
        _ => None,
    }
}

/// The letter in a dialect, or why it cannot be written so. `endpoints` is where answers go.
pub(super) fn write(
    foreign: &Foreign,
    dialect: Dialect,
    endpoints: Vec<Text>,
    limits: &Limits,
) -> Result<Vec<Bytes>, String> {
    match dialect {
        Dialect::JadeBridge => for_bridge(foreign, endpoints, limits),
        dialect if has_user_defined(&foreign.envelope) => {
            let mut envelope = foreign.envelope.clone();
            // Passed on as they are, they would make the peer reject the letter.
            envelope.overlays.push(foreign.overlay.clone());
            let (mut head, payload) = (Encoded::new(), foreign.payload());
            bit_efficient::encode_envelope_as(dialect, &envelope, payload.len(), &mut head)
                .map_err(|e| e.to_string())?;
            Ok(vec![head.take_bytes(), payload])
        }
        dialect => {
            bit_efficient::insert_overlay_as(dialect, &foreign.parts, &foreign.overlay, limits)
                .map_err(|e| e.to_string())
        }
    }
}

fn has_user_defined(envelope: &Envelope) -> bool {
    let mut layers = envelope.layers();
    let mut stamps = envelope.stamps();
    layers.any(|slots| !slots.user_defined.is_empty())
        || stamps.any(|stamp| !stamp.user_defined.is_empty())
}

/// An envelope in XML around a message in string form, with the addresses at which the sender is
/// answered: the bridge reads nothing else.
fn for_bridge(
    foreign: &Foreign,
    endpoints: Vec<Text>,
    limits: &Limits,
) -> Result<Vec<Bytes>, String> {
    let mut envelope = foreign.envelope.clone();
    let mut overlay = foreign.overlay.clone();
    let mut payload = foreign.payload();
    let in_strings = payload_representation(&envelope, &payload) == Some(Representation::String);
    // Beyond ASCII the bridge waits for more characters than there are.
    if !in_strings || !payload.is_ascii() {
        payload = in_string_form(&envelope, &payload, limits)
            .map_err(|error| format!("the message cannot be put into string form: {error}"))?;
        let given = envelope.payload_encoding();
        overlay.payload_encoding = payload_encoding(&Representation::String, &payload, given);
    }
    overlay.acl_representation = Some(Representation::String);
    overlay.payload_length = Some(payload.len() as u64);
    overlay.from = envelope.from().map(|sender| AgentId {
        addresses: endpoints,
        ..AgentId::new(sender.name.clone())
    });
    envelope.overlays.push(overlay);
    let mut head = Encoded::new();
    let form = Dialect::JadeBridge.envelope_representation();
    encode_envelope_as(
        Dialect::JadeBridge,
        form,
        &envelope,
        payload.len(),
        &mut head,
    )
    .map_err(|error| error.to_string())?;
    Ok(vec![head.take_bytes(), payload])
}

fn in_string_form(envelope: &Envelope, payload: &Bytes, limits: &Limits) -> Result<Bytes, String> {
    let message = decode_payload(envelope, payload, limits).map_err(|e| e.to_string())?;
    let mut text = Encoded::new();
    encode_message_as(
        Dialect::JadeBridge,
        &Representation::String,
        &message,
        &mut text,
    )
    .map_err(|e| e.to_string())?;
    Ok(text.take_bytes())
}
