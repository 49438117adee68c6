use fipa_acl::{Envelope, FipaTime, Received, Representation, Slots, Text};

use super::agents_writer::{Notation, write_agent, write_agents, write_attribute, write_user_text};
use super::options::{Layers, WriteOptions};
use super::writer::{Place, element, is_text, write_content, write_escaped};
use crate::decimal::Decimal;
use crate::{EncodeError, Output, dates};

/// `envelope` of SC00085J, around a payload of so many octets: the base is number 1, the overlays
/// follow from the oldest on.
pub(super) fn write_envelope(
    envelope: &Envelope,
    payload: u64,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    match options.layers {
        Layers::OneDigit if envelope.overlays.len() >= 9 => Err(EncodeError {
            parameter: "envelope",
            what: "more than nine layers, of which this peer cannot read the tenth",
        }),
        Layers::All | Layers::OneDigit => write_layers(envelope, options, out),
        Layers::Flattened if is_flat(envelope) => write_layers(envelope, options, out),
        Layers::Flattened => write_layers(&flattened(envelope, payload), options, out),
    }
}

/// Whether it would be the same as one layer.
fn is_flat(Envelope { base, overlays }: &Envelope) -> bool {
    overlays.is_empty()
        && base.payload_length.is_some()
        && !base.intended_receiver.is_empty()
        && base.user_defined.is_empty()
}

/// The envelope as one layer. Of the stamps it has the newest one.
fn flattened(envelope: &Envelope, payload: u64) -> Envelope {
    let slots = envelope.flattened();
    Envelope::new(Slots {
        intended_receiver: envelope.intended_receiver().to_vec(),
        payload_length: slots.payload_length.or(Some(payload)),
        received: envelope.stamps().last().cloned(),
        ..slots
    })
}

fn write_layers(
    envelope: &Envelope,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    out.put_slice(b"<?xml version=\"1.0\"?><envelope>");
    for (index, slots) in (1..).zip(envelope.layers().rev()) {
        out.put_slice(b"<params index=\"");
        out.put_slice(Decimal::of(index).as_bytes());
        out.put_slice(b"\">");
        write_slots(slots, options, out)?;
        out.put_slice(b"</params>");
    }
    out.put_slice(b"</envelope>");
    Ok(())
}

fn write_slots(slots: &Slots, options: &WriteOptions, out: &mut Output) -> Result<(), EncodeError> {
    let agents = |element, agents: &[_], out: &mut _| {
        write_agents(element, agents, Notation::Envelope, options, out)
    };
    agents(element!("to"), &slots.to, out)?;
    if let Some(from) = &slots.from {
        write_agent(element!("from"), from, Notation::Envelope, options, out)?;
    }
    element!("comments").write_optional(&slots.comments, out)?;
    write_representation(&slots.acl_representation, out)?;
    if let Some(length) = slots.payload_length {
        out.put_slice(b"<payload-length>");
        out.put_slice(Decimal::new(length).as_bytes());
        out.put_slice(b"</payload-length>");
    }
    element!("payload-encoding").write_optional(&slots.payload_encoding, out)?;
    if let Some(date) = &slots.date {
        out.put_slice(b"<date>");
        write_date(date, "date", options, out)?;
        out.put_slice(b"</date>");
    }
    agents(element!("intended-receiver"), &slots.intended_receiver, out)?;
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
        FipaTime::Absolute { .. } => dates::write(time, options.zone_letter, out)
            .map_err(|what| EncodeError { parameter, what }),
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
    if options.plain_envelopes {
        // What is not plain becomes references, which a section would not have.
        write_escaped(octets, Place::Text, out);
    } else {
        write_content(octets, out);
    }
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
