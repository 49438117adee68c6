use bytes::{BufMut, BytesMut};
use fipa_acl::{Envelope, FipaTime, Received, Representation, Slots, Text};

use super::agents_writer::{write_agent, write_agents, write_any, write_text};
use super::numbers::write_digits;
use super::options::{Newest, WriteOptions};
use super::times::write_time;
use super::writer::{write_null_terminated, write_user_text};
use crate::EncodeError;
use crate::decimal::Decimal;

/// ExtEnvelope* BaseEnvelope of SC00088D, around a payload of so many octets.
pub(super) fn write_envelope(
    envelope: &Envelope,
    payload: u64,
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    match options.newest {
        Newest::First => {
            for overlay in envelope.overlays.iter().rev() {
                write_overlay(overlay, payload, options, out)?;
            }
        }
        Newest::Last => {
            let mut payload = envelope.base.payload_length.unwrap_or(payload);
            for overlay in &envelope.overlays {
                payload = overlay.payload_length.unwrap_or(payload);
                write_overlay(overlay, payload, options, out)?;
            }
        }
    }
    write_base(&envelope.base, payload, options, out)
}

/// BaseEnvelope of SC00088D.
fn write_base(
    slots: &Slots,
    payload: u64,
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
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
    write_point_in_time(date, "date", options, out)?;
    write_slots(slots, payload, options, out)?;
    if let Some(received) = &slots.received {
        out.put_u8(0x0a);
        write_received(received, options, out)?;
    }
    out.put_u8(0x01);
    match options.newest {
        Newest::First => set_length(start, out),
        Newest::Last => set_short_length(start, out.len() - start, out),
    }
}

/// ExtEnvelope of SC00088D, around a payload of so many octets.
pub(super) fn write_overlay(
    slots: &Slots,
    payload: u64,
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    let start = begin_layer(0xfd, out);
    let stamp = out.len();
    match &slots.received {
        Some(received) => write_received(received, options, out)?,
        None => write_no_stamp(options, out)?,
    }
    let stamp = out.len() - stamp;
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
    write_slots(slots, payload, options, out)?;
    out.put_u8(0x01);
    match options.newest {
        Newest::First => set_length(start, out),
        // What fipa_acl announces: one octet more than there is without the stamp.
        Newest::Last => set_short_length(start, out.len() - start - stamp + 1, out),
    }
}

/// What base and overlays write alike.
fn write_slots(
    slots: &Slots,
    payload: u64,
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    write_agents(0x02, &slots.to, "to", out)?;
    if let Some(from) = &slots.from {
        out.put_u8(0x03);
        write_agent(from, "from", out)?;
    }
    write_text(0x05, &slots.comments, "comments", out)?;
    let stated = slots.payload_length;
    if let Some(length) = stated.or(options.every_payload_length.then_some(payload)) {
        out.put_slice(&[0x06, 0x12]);
        write_digits(Decimal::new(length).as_bytes(), out);
    }
    write_text(0x07, &slots.payload_encoding, "payload-encoding", out)?;
    write_agents(0x09, &slots.intended_receiver, "intended-receiver", out)?;
    if let Some(behaviour) = &slots.transport_behaviour {
        out.put_u8(0x0b);
        write_any(behaviour, "transport-behaviour", out)?;
    }
    write_user_texts(&slots.user_defined, options, out)
}

fn write_user_texts(
    texts: &[(Text, Text)],
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    if options.user_defined_slots {
        for (name, value) in texts {
            write_user_text(name, value, out)?;
        }
    }
    Ok(())
}

/// Leaves room for EnvLen.
fn begin_layer(code: u8, out: &mut BytesMut) -> usize {
    let start = out.len();
    out.put_slice(&[code, 0, 0]);
    start
}

/// Fills in the length of a complete layer, for which a long one is moved by four octets.
fn set_length(start: usize, out: &mut BytesMut) -> Result<(), EncodeError> {
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

/// Fills in a length for a reader that knows no long ones.
fn set_short_length(start: usize, len: usize, out: &mut BytesMut) -> Result<(), EncodeError> {
    let len = u16::try_from(len).map_err(|_| EncodeError {
        parameter: "envelope",
        what: "a layer of more than 65535 octets, which this peer cannot read",
    })?;
    set(out, start + 1, &len.to_be_bytes());
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
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    match time {
        FipaTime::Absolute { .. } => write_time(time, parameter, options, out),
        FipaTime::Relative(_) => Err(EncodeError {
            parameter,
            what: "a date in an envelope is a point in time",
        }),
    }
}

/// ReceivedObject.
fn write_received(
    received: &Received,
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    const PARAMETER: &str = "received";
    if received.by.is_empty() {
        return Err(EncodeError {
            parameter: PARAMETER,
            what: "a stamp says by whom it is",
        });
    }
    write_null_terminated(received.by.as_bytes(), PARAMETER, out)?;
    write_point_in_time(&received.date, PARAMETER, options, out)?;
    let texts = [&received.from, &received.id, &received.via];
    for (code, text) in [0x02, 0x03, 0x04].into_iter().zip(texts) {
        if let Some(text) = text {
            out.put_u8(code);
            write_null_terminated(text.as_bytes(), PARAMETER, out)?;
        }
    }
    write_user_texts(&received.user_defined, options, out)?;
    out.put_u8(0x01);
    Ok(())
}

/// The stamp that every overlay must have, for one that has none.
fn write_no_stamp(options: &WriteOptions, out: &mut BytesMut) -> Result<(), EncodeError> {
    write_null_terminated(b"", "received", out)?;
    write_time(&FipaTime::from_unix_millis(0), "received", options, out)?;
    out.put_u8(0x01);
    Ok(())
}
