use bytes::{BufMut, BytesMut};
use fipa_acl::{AgentId, FipaTime, Received, Representation, Slots, Text};

use super::values::{write_digits, write_time};
use super::writer::{
    decimal, without_prefix, write_counted, write_null_terminated, write_prefixed, write_user_text,
};
use crate::EncodeError;

/// BaseEnvelope of SC00088D.
pub(super) fn write_base(slots: &Slots, out: &mut BytesMut) -> Result<(), EncodeError> {
    const MANDATORY: &str = "a base envelope cannot be without it";
    let start = begin_layer(0xfe, out);
    let representation = slots.acl_representation.as_ref().ok_or(EncodeError {
        parameter: "acl-representation",
        what: MANDATORY,
    })?;
    write_representation(representation, out)?;
    let date = slots.date.as_ref().ok_or(EncodeError {
        parameter: "date",
        what: MANDATORY,
    })?;
    write_point_in_time(date, "date", out)?;
    write_slots(slots, out)?;
    if let Some(received) = &slots.received {
        out.put_u8(0x0a);
        write_received(received, out)?;
    }
    end_layer(start, out)
}

/// ExtEnvelope of SC00088D.
pub(super) fn write_overlay(slots: &Slots, out: &mut BytesMut) -> Result<(), EncodeError> {
    let start = begin_layer(0xfd, out);
    match &slots.received {
        Some(received) => write_received(received, out)?,
        None => write_no_stamp(out)?,
    }
    if slots.date.is_some() {
        return Err(EncodeError {
            parameter: "date",
            what: "an overlay has no place for it",
        });
    }
    if let Some(representation) = &slots.acl_representation {
        out.put_u8(0x04);
        write_representation(representation, out)?;
    }
    write_slots(slots, out)?;
    end_layer(start, out)
}

/// What base and overlays write alike.
fn write_slots(slots: &Slots, out: &mut BytesMut) -> Result<(), EncodeError> {
    write_agents(0x02, &slots.to, "to", out)?;
    if let Some(from) = &slots.from {
        out.put_u8(0x03);
        write_agent(from, "from", out)?;
    }
    write_text(0x05, &slots.comments, "comments", out)?;
    if let Some(length) = slots.payload_length {
        let (digits, start) = decimal(length);
        out.put_slice(&[0x06, 0x12]);
        write_digits(digits.get(start..).unwrap_or_default(), out);
    }
    write_text(0x07, &slots.payload_encoding, "payload-encoding", out)?;
    write_agents(0x09, &slots.intended_receiver, "intended-receiver", out)?;
    if let Some(behaviour) = &slots.transport_behaviour {
        out.put_u8(0x0b);
        write_any(behaviour, "transport-behaviour", out)?;
    }
    for (name, value) in &slots.user_defined {
        write_user_text(name, value, out)?;
    }
    Ok(())
}

/// Leaves room for EnvLen.
fn begin_layer(code: u8, out: &mut BytesMut) -> usize {
    let start = out.len();
    out.put_slice(&[code, 0, 0]);
    start
}

/// Ends the layer and fills in its length, for which a long one is moved by four octets.
fn end_layer(start: usize, out: &mut BytesMut) -> Result<(), EncodeError> {
    out.put_u8(0x01);
    let len = out.len() - start;
    if let Ok(len) = u16::try_from(len) {
        set(out, start + 1, &len.to_be_bytes());
        return Ok(());
    }
    let len = u32::try_from(len + 4).map_err(|_| EncodeError {
        parameter: "envelope",
        what: "more than 4 GiB",
    })?;
    let end = out.len();
    out.put_u32(0);
    out.copy_within(start + 3..end, start + 7);
    set(out, start + 3, &len.to_be_bytes());
    Ok(())
}

fn set(out: &mut BytesMut, at: usize, octets: &[u8]) {
    for (place, octet) in out.iter_mut().skip(at).zip(octets) {
        *place = *octet;
    }
}

fn write_representation(
    representation: &Representation,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    match representation {
        Representation::BitEfficient => out.put_u8(0x10),
        Representation::String => out.put_u8(0x11),
        Representation::Xml => out.put_u8(0x12),
        Representation::Other(name) => {
            out.put_u8(0x00);
            write_null_terminated(name.as_bytes(), "acl-representation", out)?;
        }
    }
    Ok(())
}

/// A date in an envelope is read by services at any later time: a span has no meaning there.
fn write_point_in_time(
    time: &FipaTime,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    match time {
        FipaTime::Absolute { .. } => write_time(time, parameter, out),
        FipaTime::Relative(_) => Err(EncodeError {
            parameter,
            what: "a date in an envelope is a point in time",
        }),
    }
}

/// ReceivedObject.
fn write_received(received: &Received, out: &mut BytesMut) -> Result<(), EncodeError> {
    const PARAMETER: &str = "received";
    if received.by.is_empty() {
        return Err(EncodeError {
            parameter: PARAMETER,
            what: "a stamp says by whom it is",
        });
    }
    write_null_terminated(received.by.as_bytes(), PARAMETER, out)?;
    write_point_in_time(&received.date, PARAMETER, out)?;
    let texts = [&received.from, &received.id, &received.via];
    for (code, text) in [0x02, 0x03, 0x04].into_iter().zip(texts) {
        if let Some(text) = text {
            out.put_u8(code);
            write_null_terminated(text.as_bytes(), PARAMETER, out)?;
        }
    }
    for (name, value) in &received.user_defined {
        write_user_text(name, value, out)?;
    }
    out.put_u8(0x01);
    Ok(())
}

/// The stamp that every overlay must have, for one that has none.
fn write_no_stamp(out: &mut BytesMut) -> Result<(), EncodeError> {
    write_null_terminated(b"", "received", out)?;
    write_time(&FipaTime::from_unix_millis(0), "received", out)?;
    out.put_u8(0x01);
    Ok(())
}

/// An empty text is the same as an absent one.
fn write_text(
    code: u8,
    text: &Option<Text>,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    if let Some(text) = text.as_ref().filter(|text| !text.is_empty()) {
        out.put_u8(code);
        write_null_terminated(text.as_bytes(), parameter, out)?;
    }
    Ok(())
}

fn write_agents(
    code: u8,
    agents: &[AgentId],
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    if agents.is_empty() {
        return Ok(());
    }
    out.put_u8(code);
    for agent in agents {
        write_agent(agent, parameter, out)?;
    }
    out.put_u8(0x01);
    Ok(())
}

/// AgentIdentifier of SC00088D.
fn write_agent(
    agent: &AgentId,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    out.put_u8(0x02);
    write_null_terminated(agent.name.as_bytes(), parameter, out)?;
    if !agent.addresses.is_empty() {
        out.put_u8(0x02);
        for address in &agent.addresses {
            write_null_terminated(address.as_bytes(), parameter, out)?;
        }
        out.put_u8(0x01);
    }
    write_agents(0x03, &agent.resolvers, parameter, out)?;
    for user_defined in &agent.user_defined {
        out.put_u8(0x05);
        let name = without_prefix(&user_defined.name);
        write_prefixed("X-", name.as_bytes(), "user-defined", out)?;
        match user_defined.value.as_str() {
            Some(text) => write_any(text.as_bytes(), "user-defined", out)?,
            None => write_any(
                user_defined.value.to_string().as_bytes(),
                "user-defined",
                out,
            )?,
        }
    }
    out.put_u8(0x01);
    Ok(())
}

/// Any: a null terminated string, or a counted one for what has a zero octet in it.
fn write_any(
    octets: &[u8],
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    if octets.contains(&0) {
        return write_counted(octets, parameter, out);
    }
    out.put_u8(0x14);
    write_null_terminated(octets, parameter, out)
}
