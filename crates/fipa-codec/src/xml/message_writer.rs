use bytes::Bytes;
use fipa_acl::{Expression, Message, Performative, Text};

use super::agents_writer::{Notation, write_agent, write_user_defined};
use super::content::{BASE64, ENCODING_PARAMETER};
use super::dates::write_time;
use super::options::WriteOptions;
use super::writer::{
    Element, Place, element, is_empty, is_text, write_base64, write_content, write_expression,
};
use crate::{EncodeError, Output};

/// `fipa-message` of SC00071E.
pub(super) fn write_message(
    message: &Message,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    write_start(message, options, out)?;
    for receiver in &message.receiver {
        write_agent(
            element!("receiver"),
            receiver,
            Notation::Message,
            options,
            out,
        )?;
    }
    if let Some(sender) = &message.sender {
        write_agent(element!("sender"), sender, Notation::Message, options, out)?;
    }
    let in_base64 = write_message_content(&message.content, out);
    write_tag(element!("language"), &message.language, out)?;
    write_tag(element!("encoding"), &message.encoding, out)?;
    write_tag(element!("ontology"), &message.ontology, out)?;
    element!("protocol").write_optional(&message.protocol, out)?;
    write_tag(element!("reply-with"), &message.reply_with, out)?;
    write_tag(element!("in-reply-to"), &message.in_reply_to, out)?;
    if let Some(time) = &message.reply_by {
        out.put_slice(b"<reply-by time=\"");
        write_time(time, true, "reply-by", out)?;
        out.put_slice(b"\"/>");
    }
    for agent in &message.reply_to {
        write_agent(element!("reply-to"), agent, Notation::Message, options, out)?;
    }
    write_tag(element!("conversation-id"), &message.conversation_id, out)?;
    for parameter in &message.user_defined {
        write_user_defined(&parameter.name, &parameter.value, options, out)?;
    }
    if in_base64 {
        let value = Expression::Word(Text::from_static(BASE64));
        write_user_defined(ENCODING_PARAMETER, &value, options, out)?;
    }
    out.put_slice(b"</fipa-message>");
    Ok(())
}

/// Octets that the message needs at least, and mostly not much more; a long content is passed on
/// by reference.
pub(super) fn expected_len(message: &Message) -> usize {
    let content = message.content.as_ref().map_or(0, |content| content.len());
    let agents = 1 + message.receiver.len() + message.reply_to.len();
    content.min(4096) + 192 * agents + 64 * message.user_defined.len() + 512
}

fn write_start(
    message: &Message,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    if let Performative::Other(_) = message.performative {
        return Err(EncodeError {
            parameter: "performative",
            what: "XML has only the acts of the standard",
        });
    }
    out.put_slice(b"<?xml version=\"1.0\"?><fipa-message act=\"");
    out.put_slice(message.performative.as_str().as_bytes());
    let id = message.conversation_id.as_ref().filter(|id| !is_empty(id));
    if let Some(id) = id.filter(|_| options.conversation_id_attribute) {
        out.put_slice(b"\" conversation-id=\"");
        write_expression(id, Place::Attribute, "conversation-id", out)?;
    }
    out.put_slice(b"\">");
    Ok(())
}

/// Writes the content, and tells whether it had to be written in Base64.
fn write_message_content(content: &Option<Bytes>, out: &mut Output) -> bool {
    let Some(content) = content.as_ref().filter(|content| !content.is_empty()) else {
        return false;
    };
    let fits = is_text(content);
    out.put_slice(b"<content>");
    match fits {
        true => write_content(content, out),
        false => write_base64(content, out),
    }
    out.put_slice(b"</content>");
    !fits
}

/// An empty text is an absent one.
#[inline]
fn write_tag(
    element: Element,
    value: &Option<Expression>,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let Some(value) = value.as_ref().filter(|value| !is_empty(value)) else {
        return Ok(());
    };
    out.put_slice(element.open.as_bytes());
    write_expression(value, Place::Text, element.name, out)?;
    out.put_slice(element.close.as_bytes());
    Ok(())
}
