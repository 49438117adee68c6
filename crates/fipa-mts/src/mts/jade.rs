//! A letter as JADE reads it: an envelope in XML and a message in string form, with the addresses
//! under which whoever is named in them can be answered.

use bytes::{BufMut, Bytes, BytesMut};
use fipa_acl::{AgentId, Envelope, Message, Representation, Text};
use fipa_codec::{
    Dialect, Limits, Output as Encoded, decode_payload, encode_envelope_as, encode_message_as,
    payload_encoding, payload_representation,
};
use fipa_directory::Address;

use super::dialects::Foreign;

/// The two parts of a letter's request.
#[derive(Debug)]
pub(super) struct Written {
    pub(super) envelope: Bytes,
    pub(super) payload: Bytes,
    /// The media type of the payload; JADE writes the charset there as well.
    pub(super) payload_type: Text,
}

/// The letter for one receiver at this address, or why it cannot be written so. `own` is where we
/// are posted to.
pub(super) fn write(
    foreign: &Foreign,
    address: &Address,
    own: &[Text],
    limits: &Limits,
) -> Result<Written, String> {
    let envelope = &foreign.envelope;
    let mut payload = foreign.payload();
    let string = Representation::String;
    let as_it_is = payload_representation(envelope, &payload).as_ref() == Some(&string);
    if !as_it_is {
        payload = in_string_form(envelope, &payload, own, limits)
            .map_err(|error| format!("the message cannot be put into string form: {error}"))?;
    }
    // Without it JADE takes everything beyond ASCII for nothing.
    let encoding = match envelope.payload_encoding() {
        Some(given) if as_it_is => Some(given.clone()),
        given => payload_encoding(&string, &payload, given),
    };
    let payload = without_last_return(payload);
    let mut slots = envelope.flattened();
    slots.acl_representation = Some(string);
    slots.payload_length = Some(payload.len() as u64);
    if encoding.is_some() {
        slots.payload_encoding.clone_from(&encoding);
    }
    slots.from = slots.from.map(|from| reached_at(from, || own.to_vec()));
    let there = || vec![address.to_text()];
    slots.intended_receiver = vec![reached_at(foreign.to.clone(), there)];
    slots.received.clone_from(&foreign.overlay.received);
    let (mut head, jade) = (Encoded::new(), Dialect::Jade);
    let form = jade.envelope_representation();
    encode_envelope_as(jade, form, &Envelope::new(slots), payload.len(), &mut head)
        .map_err(|error| error.to_string())?;
    let payload_type = match encoding {
        Some(charset) if is_token(&charset) => Text::from(format!(
            "{}; charset={charset}",
            Representation::String.as_str()
        )),
        _ => Text::from_static("application/text"),
    };
    Ok(Written {
        envelope: head.take_bytes(),
        payload,
        payload_type,
    })
}

/// An agent, at these addresses if it names none where it could be reached.
fn reached_at(mut agent: AgentId, addresses: impl Fn() -> Vec<Text>) -> AgentId {
    if agent.addresses.is_empty() {
        agent.addresses = addresses();
    }
    agent
}

fn in_string_form(
    envelope: &Envelope,
    payload: &Bytes,
    own: &[Text],
    limits: &Limits,
) -> Result<Bytes, String> {
    let message = decode_payload(envelope, payload, limits).map_err(|e| e.to_string())?;
    let ours = |agent| reached_at(agent, || own.to_vec());
    let message = Message {
        sender: message.sender.map(ours),
        reply_to: message.reply_to.into_iter().map(ours).collect(),
        ..message
    };
    let (mut text, form) = (Encoded::new(), Dialect::Jade.message_representation());
    encode_message_as(Dialect::Jade, &form, &message, &mut text).map_err(|e| e.to_string())?;
    Ok(text.take_bytes())
}

/// JADE does not see the end of a payload that ends in a carriage return. What stands behind a
/// message is ignored by everybody.
fn without_last_return(payload: Bytes) -> Bytes {
    if payload.last() != Some(&b'\r') {
        return payload;
    }
    let mut ended = BytesMut::with_capacity(payload.len() + 1);
    ended.extend_from_slice(&payload);
    ended.put_u8(b'\n');
    ended.freeze()
}

/// Whether it can stand in a header as it is.
fn is_token(name: &str) -> bool {
    let allowed = |octet: u8| octet.is_ascii_alphanumeric() || b"-_.:+".contains(&octet);
    !name.is_empty() && name.bytes().all(allowed)
}
