//! One envelope, flattened or a layer, and the stamps in it.

use fipa_acl::{Received, Representation, Slots, Text};
use serde_json::{Map, Value};

use crate::JsonError;
use crate::agent_id::{agent_id_from_json, agent_id_to_json, put_agents};
use crate::message::put_shown;
use crate::reader::Fields;
use crate::values::{octets, octets_to_json, text, time, user_defined};
use crate::values::{user_defined_to_json, whole_number};

const KEYS: [&str; 11] = [
    "to",
    "from",
    "comments",
    "acl-representation",
    "payload-length",
    "payload-encoding",
    "date",
    "intended-receiver",
    "received",
    "transport-behaviour",
    "user-defined",
];

/// The slots with these stamps; `slots.received` does not count. Stamps with an empty `by` are
/// none.
pub(crate) fn slots_to_json<'a>(
    slots: &Slots,
    stamps: impl Iterator<Item = &'a Received>,
) -> Value {
    let mut json = Map::new();
    put_agents(&mut json, "to", &slots.to);
    if let Some(from) = &slots.from {
        json.insert("from".into(), agent_id_to_json(from));
    }
    put_shown(&mut json, "comments", slots.comments.as_ref());
    if let Some(representation) = &slots.acl_representation {
        let name = representation.as_str();
        json.insert("acl-representation".into(), name.into());
    }
    if let Some(length) = slots.payload_length {
        json.insert("payload-length".into(), length.into());
    }
    put_shown(
        &mut json,
        "payload-encoding",
        slots.payload_encoding.as_ref(),
    );
    put_shown(&mut json, "date", slots.date.as_ref());
    put_agents(&mut json, "intended-receiver", &slots.intended_receiver);
    let stamps: Vec<Value> = stamps
        .filter(|stamp| !stamp.by.is_empty())
        .map(stamp_to_json)
        .collect();
    if !stamps.is_empty() {
        json.insert("received".into(), stamps.into());
    }
    if let Some(behaviour) = &slots.transport_behaviour {
        json.insert("transport-behaviour".into(), octets_to_json(behaviour));
    }
    put_user_defined(&mut json, &slots.user_defined);
    json.into()
}

/// The slots of one envelope, without stamps, and the stamps in their order.
pub(crate) fn slots_from_json(value: &Value) -> Result<(Slots, Vec<Received>), JsonError> {
    let fields = Fields::new(value, &KEYS)?;
    let representation = fields.optional("acl-representation", text)?;
    let slots = Slots {
        to: fields.list("to", agent_id_from_json)?,
        from: fields.optional("from", agent_id_from_json)?,
        comments: fields.optional("comments", text)?,
        acl_representation: representation.map(Representation::from),
        payload_length: fields.optional("payload-length", whole_number)?,
        payload_encoding: fields.optional("payload-encoding", text)?,
        date: fields.optional("date", time)?,
        intended_receiver: fields.list("intended-receiver", agent_id_from_json)?,
        received: None,
        transport_behaviour: fields.optional("transport-behaviour", octets)?,
        user_defined: fields
            .optional("user-defined", user_defined)?
            .unwrap_or_default(),
    };
    Ok((slots, fields.list("received", stamp_from_json)?))
}

fn stamp_to_json(stamp: &Received) -> Value {
    let mut json = Map::new();
    json.insert("by".into(), stamp.by.as_str().into());
    put_shown(&mut json, "from", stamp.from.as_ref());
    put_shown(&mut json, "date", Some(&stamp.date));
    put_shown(&mut json, "id", stamp.id.as_ref());
    put_shown(&mut json, "via", stamp.via.as_ref());
    put_user_defined(&mut json, &stamp.user_defined);
    json.into()
}

fn stamp_from_json(value: &Value) -> Result<Received, JsonError> {
    let fields = Fields::new(value, &["by", "from", "date", "id", "via", "user-defined"])?;
    Ok(Received {
        by: fields.required("by", text)?,
        from: fields.optional("from", text)?,
        date: fields.required("date", time)?,
        id: fields.optional("id", text)?,
        via: fields.optional("via", text)?,
        user_defined: fields
            .optional("user-defined", user_defined)?
            .unwrap_or_default(),
    })
}

fn put_user_defined(json: &mut Map<String, Value>, parameters: &[(Text, Text)]) {
    if !parameters.is_empty() {
        let shown = user_defined_to_json(parameters.iter().map(|(name, value)| (name, value)));
        json.insert("user-defined".into(), shown.into());
    }
}
