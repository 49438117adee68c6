use bytes::{BufMut, BytesMut};
use fipa_acl::{AgentId, Expression, Message, Performative, Text, UserDefined};

use super::codes::code_of;
use super::values::{is_number, write_digits, write_time};
use super::writer::{write_counted, write_length, write_user_name, write_word};
use crate::{EncodeError, Output};

/// ACLCommunicativeAct of SC00069G, without code table; in the order in which fipa_acl writes the
/// parameters.
pub(super) fn write_message(message: &Message, out: &mut Output) -> Result<(), EncodeError> {
    write_parameters(message, out.buffer())?;
    if let Some(content) = &message.content {
        out.put_u8(0x04);
        write_length(content.len(), "content", out.buffer())?;
        out.put_shared(content);
    }
    out.put_u8(0x01);
    Ok(())
}

/// Everything in front of the content.
fn write_parameters(message: &Message, out: &mut BytesMut) -> Result<(), EncodeError> {
    out.put_slice(&[0xfa, 0x10]);
    write_act(&message.performative, out)?;
    if let Some(sender) = &message.sender {
        out.put_u8(0x02);
        write_agent(sender, "sender", out)?;
    }
    write_agents(0x03, &message.receiver, "receiver", out)?;
    write_tag(0x05, &message.reply_with, "reply-with", out)?;
    if let Some(time) = &message.reply_by {
        out.put_u8(0x06);
        write_time(time, "reply-by", out)?;
    }
    write_tag(0x07, &message.in_reply_to, "in-reply-to", out)?;
    write_agents(0x08, &message.reply_to, "reply-to", out)?;
    write_tag(0x09, &message.language, "language", out)?;
    write_tag(0x0a, &message.encoding, "encoding", out)?;
    write_tag(0x0b, &message.ontology, "ontology", out)?;
    if let Some(protocol) = &message.protocol {
        out.put_u8(0x0c);
        write_word(protocol, "protocol", out)?;
    }
    write_tag(0x0d, &message.conversation_id, "conversation-id", out)?;
    for parameter in &message.user_defined {
        write_user_defined(0x00, parameter, out)?;
    }
    Ok(())
}

/// Octets that are written for the message, not counting a large content, and mostly not much more.
pub(super) fn expected_len(message: &Message) -> usize {
    let content = message
        .content
        .as_ref()
        .map_or(0, |content| content.len().min(4096));
    let agents = message.receiver.len() + message.reply_to.len();
    let user_defined = message.user_defined.len();
    content + 48 * agents + 32 * user_defined + 256
}

fn write_act(act: &Performative, out: &mut BytesMut) -> Result<(), EncodeError> {
    match code_of(act) {
        Ok(code) => out.put_u8(code),
        Err(name) => {
            out.put_u8(0x00);
            write_word(name, "performative", out)?;
        }
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

fn write_agent(
    agent: &AgentId,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    out.put_u8(0x02);
    write_word(&agent.name, parameter, out)?;
    if !agent.addresses.is_empty() {
        out.put_u8(0x02);
        for address in &agent.addresses {
            write_word(address, parameter, out)?;
        }
        out.put_u8(0x01);
    }
    write_agents(0x03, &agent.resolvers, parameter, out)?;
    for user_defined in &agent.user_defined {
        write_user_defined(0x04, user_defined, out)?;
    }
    out.put_u8(0x01);
    Ok(())
}

fn write_user_defined(
    code: u8,
    parameter: &UserDefined,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    out.put_u8(code);
    write_user_name(&parameter.name, out)?;
    write_expression(&parameter.value, "user-defined", out)
}

fn write_tag(
    code: u8,
    value: &Option<Expression>,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    if let Some(value) = value {
        out.put_u8(code);
        write_expression(value, parameter, out)?;
    }
    Ok(())
}

/// BinExpression: a word if it is a legal one, else a string, never a number; or a list.
fn write_expression(
    value: &Expression,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    match value {
        Expression::Word(text) | Expression::String(text) | Expression::Number(text) => {
            write_word_or_string(text, parameter, out)
        }
        Expression::List(items) => write_list(items, parameter, out),
    }
}

/// Each parenthesis and token stands alone: fused ones are read differently by peers.
fn write_list(
    items: &[Expression],
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    out.put_u8(0x60);
    for item in items {
        match item {
            Expression::Number(text) if is_number(text) => {
                out.put_u8(0x12);
                write_digits(text.as_bytes(), out);
            }
            Expression::Word(text) | Expression::Number(text) => {
                write_word_or_string(text, parameter, out)?;
            }
            Expression::String(text) => write_string(text, parameter, out)?,
            Expression::List(inner) => write_list(inner, parameter, out)?,
        }
    }
    out.put_u8(0x40);
    Ok(())
}

fn write_word_or_string(
    text: &Text,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    if text.is_word() {
        write_word(text, parameter, out)
    } else {
        write_string(text, parameter, out)
    }
}

/// A string literal, or a counted string for what would read differently in a literal.
fn write_string(
    text: &str,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    let is_plain = |octet| !matches!(octet, b'\0' | b'\\' | b'"');
    if text.bytes().all(is_plain) {
        out.put_slice(b"\x14\"");
        out.put_slice(text.as_bytes());
        out.put_slice(b"\"\0");
        Ok(())
    } else if text.contains('\0') || text.ends_with('\\') || text.contains("\\\"") {
        write_counted(text.as_bytes(), parameter, out)
    } else {
        write_escaped(text.as_bytes(), out);
        Ok(())
    }
}

fn write_escaped(text: &[u8], out: &mut BytesMut) {
    out.put_slice(b"\x14\"");
    for (i, piece) in text.split(|octet| *octet == b'"').enumerate() {
        if i > 0 {
            out.put_slice(b"\\\"");
        }
        out.put_slice(piece);
    }
    out.put_slice(b"\"\0");
}
