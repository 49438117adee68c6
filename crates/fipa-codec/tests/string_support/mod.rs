//! Messages in string form, written and read.

// Not every test uses everything.
#![allow(dead_code)]

use bytes::Bytes;
use fipa_acl::{AgentId, Message, Performative, UserDefined};
use fipa_codec::string::{decode_message, encode_message};
use fipa_codec::{Fault, Limits, Output, arbitrary};
use proptest::prelude::*;

pub(crate) fn octets_of(message: &Message) -> Bytes {
    let mut out = Output::new();
    encode_message(message, &mut out).unwrap_or_else(|error| panic!("{error}: {message:?}"));
    out.take_bytes()
}

pub(crate) fn read(text: impl AsRef<[u8]>) -> Message {
    let octets = Bytes::copy_from_slice(text.as_ref());
    decode_message(&octets, &Limits::default())
        .unwrap_or_else(|error| panic!("{error}: {octets:?}"))
}

/// Where a text is refused, and whose fault it is.
pub(crate) fn refused(text: impl AsRef<[u8]>) -> (usize, Fault) {
    let octets = Bytes::copy_from_slice(text.as_ref());
    match decode_message(&octets, &Limits::default()) {
        Err(error) => (error.offset, error.fault),
        Ok(message) => panic!("{octets:?} is {message:?}"),
    }
}

/// Messages that the string form can carry.
pub(crate) fn messages() -> impl Strategy<Value = Message> {
    arbitrary::message().prop_map(writable)
}

/// Makes a message one that the string form can carry: its act is one of the standard, and no name
/// of a user-defined parameter has a character that begins a value.
fn writable(mut message: Message) -> Message {
    if let Performative::Other(_) = message.performative {
        message.performative = Performative::Inform;
    }
    let agents = message.sender.iter_mut().chain(&mut message.receiver);
    agents.chain(&mut message.reply_to).for_each(writable_agent);
    message.user_defined.iter_mut().for_each(writable_name);
    message
}

fn writable_agent(agent: &mut AgentId) {
    agent.user_defined.iter_mut().for_each(writable_name);
    agent.resolvers.iter_mut().for_each(writable_agent);
}

fn writable_name(parameter: &mut UserDefined) {
    parameter.name = parameter.name.replace(['#', '"', ':'], "_").into();
}
