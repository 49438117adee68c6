use fipa_acl::{Envelope, FipaTime, Received, Representation, Slots, Text};

use super::agents_writer::{
    Notation, write_agent, write_attribute, write_receivers, write_user_text,
};
use super::dates::write_time;
use super::options::WriteOptions;
use super::writer::{element, is_text, write_content};
use crate::{EncodeError, Output};

/// `envelope` of SC00085J: the base is number 1, the overlays follow from the oldest on.
pub(super) fn write_envelope(
    envelope: &Envelope,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    out.put_slice(b"<?xml version=\"1.0\"?><envelope>");
    for (index, slots) in (1..).zip(envelope.layers().rev()) {
        out.put_slice(b"<params index=\"");
        write_decimal(index, out);
        out.put_slice(b"\">");
        write_slots(slots, options, out)?;
        out.put_slice(b"</params>");
    }
    out.put_slice(b"</envelope>");
    Ok(())
}

fn write_slots(slots: &Slots, options: &WriteOptions, out: &mut Output) -> Result<(), EncodeError> {
    write_receivers(element!("to"), &slots.to, options, out)?;
    if let Some(from) = &slots.from {
        write_agent(element!("from"), from, Notation::Envelope, options, out)?;
    }
    element!("comments").write_optional(&slots.comments, out)?;
    write_representation(&slots.acl_representation, out)?;
    if let Some(length) = slots.payload_length {
        out.put_slice(b"<payload-length>");
        write_decimal(length, out);
        out.put_slice(b"</payload-length>");
    }
    element!("payload-encoding").write_optional(&slots.payload_encoding, out)?;
    if let Some(date) = &slots.date {
        out.put_slice(b"<date>");
        write_date(date, "date", options, out)?;
        out.put_slice(b"</date>");
    }
    write_receivers(
        element!("intended-receiver"),
        &slots.intended_receiver,
        options,
        out,
    )?;
    write_behaviour(slots, options, out)?;
    if let Some(received) = &slots.received {
        write_received(received, options, out)?;
    }
    for (name, value) in &slots.user_defined {
        write_user_text(name, value, options, out)?;
    }
    Ok(())
}

fn write_representation(
    representation: &Option<Representation>,
    out: &mut Output,
) -> Result<(), EncodeError> {
    match representation.as_ref().map(Representation::as_str) {
        None | Some("") => Ok(()),
        Some(name) => element!("acl-representation").write(name, out),
    }
}

/// A date in an envelope is read by services at any later time: a span has no meaning there.
fn write_date(
    time: &FipaTime,
    parameter: &'static str,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    match time {
        FipaTime::Absolute { .. } => write_time(time, options.envelope_zone_letter, parameter, out),
        FipaTime::Relative(_) => Err(EncodeError {
            parameter,
            what: "a date in an envelope is a point in time",
        }),
    }
}

fn write_behaviour(
    slots: &Slots,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let behaviour = slots.transport_behaviour.as_ref();
    let given = behaviour.filter(|octets| options.transport_behaviour && !octets.is_empty());
    let Some(octets) = given else {
        return Ok(());
    };
    if !is_text(octets) {
        return Err(EncodeError {
            parameter: "transport-behaviour",
            what: "octets that XML cannot hold",
        });
    }
    out.put_slice(b"<transport-behaviour>");
    write_content(octets, out);
    out.put_slice(b"</transport-behaviour>");
    Ok(())
}

/// `received`. Its parts are attributes, except user-defined ones.
fn write_received(
    received: &Received,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    const PARAMETER: &str = "received";
    if received.by.is_empty() {
        return Err(EncodeError {
            parameter: PARAMETER,
            what: "a stamp says by whom it is",
        });
    }
    let optional = |start: &'static str, text: &Option<Text>, out: &mut Output| match text {
        Some(text) if !text.is_empty() => write_attribute(start, text, PARAMETER, out),
        _ => Ok(()),
    };
    out.put_slice(b"<received>");
    write_attribute("<received-by value=\"", &received.by, PARAMETER, out)?;
    optional("<received-from value=\"", &received.from, out)?;
    out.put_slice(b"<received-date value=\"");
    write_date(&received.date, PARAMETER, options, out)?;
    out.put_slice(b"\"/>");
    optional("<received-id value=\"", &received.id, out)?;
    optional("<received-via value=\"", &received.via, out)?;
    for (name, value) in &received.user_defined {
        write_user_text(name, value, options, out)?;
    }
    out.put_slice(b"</received>");
    Ok(())
}

fn write_decimal(mut number: u64, out: &mut Output) {
    let mut digits = [b'0'; 20];
    let mut start = digits.len();
    for digit in digits.iter_mut().rev() {
        let [ones, ..] = (number % 10).to_le_bytes();
        *digit = b'0' + ones;
        start -= 1;
        number /= 10;
        if number == 0 {
            break;
        }
    }
    out.put_slice(digits.get(start..).unwrap_or_default());
}
