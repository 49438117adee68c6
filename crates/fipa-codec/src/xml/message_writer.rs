use bytes::Bytes;
use fipa_acl::{Expression, Message, Performative, Text};
use memchr::{memchr, memmem};

use super::agents_writer::{Notation, write_agent, write_agents, write_parameter};
use super::content::{BASE64, ENCODING_PARAMETER};
use super::options::{ContentForm, WriteOptions};
use super::writer::{
    Element, Place, element, is_empty, is_text, write_base64, write_content, write_expression,
    write_section,
};
use crate::{EncodeError, Output, dates};

/// `fipa-message` of SC00071E.
pub(super) fn write_message(
    message: &Message,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    write_start(message, out)?;
    let agents = |element, agents: &[_], out: &mut _| {
        write_agents(element, agents, Notation::Message, options, out)
    };
    agents(element!("receiver"), &message.receiver, out)?;
    if let Some(sender) = &message.sender {
        write_agent(element!("sender"), sender, Notation::Message, options, out)?;
    }
    let in_base64 = write_message_content(&message.content, options, out);
    write_tag(element!("language"), &message.language, out)?;
    write_tag(element!("encoding"), &message.encoding, out)?;
    write_tag(element!("ontology"), &message.ontology, out)?;
    element!("protocol").write_optional(&message.protocol, out)?;
    write_tag(element!("reply-with"), &message.reply_with, out)?;
    write_tag(element!("in-reply-to"), &message.in_reply_to, out)?;
    if let Some(time) = &message.reply_by {
        out.put_slice(b"<reply-by time=\"");
        let wrong = |what| EncodeError {
            parameter: "reply-by",
            what,
        };
        dates::write(time, options.zone_letter, out).map_err(wrong)?;
        out.put_slice(b"\"/>");
    }
    agents(element!("reply-to"), &message.reply_to, out)?;
    write_tag(element!("conversation-id"), &message.conversation_id, out)?;
    for parameter in &message.user_defined {
        write_parameter(&parameter.name, &parameter.value, options, out)?;
    }
    if in_base64 {
        let value = Expression::Word(Text::from_static(BASE64));
        write_parameter(ENCODING_PARAMETER, &value, options, out)?;
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

fn write_start(message: &Message, out: &mut Output) -> Result<(), EncodeError> {
    if let Performative::Other(_) = message.performative {
        return Err(EncodeError {
            parameter: "performative",
            what: "XML has only the acts of the standard",
        });
    }
    out.put_slice(b"<?xml version=\"1.0\"?><fipa-message act=\"");
    out.put_slice(message.performative.as_str().as_bytes());
    let id = message.conversation_id.as_ref().filter(|id| !is_empty(id));
    if let Some(id) = id {
        out.put_slice(b"\" conversation-id=\"");
        write_expression(id, Place::Attribute, "conversation-id", out)?;
    }
    out.put_slice(b"\">");
    Ok(())
}

/// Writes the content, and tells whether it had to be written in Base64.
fn write_message_content(
    content: &Option<Bytes>,
    options: &WriteOptions,
    out: &mut Output,
) -> bool {
    let Some(content) = content.as_ref().filter(|content| !content.is_empty()) else {
        return false;
    };
    let is_text = is_text(content);
    let is_section = is_section(content, is_text, options.content);
    out.put_slice(b"<content>");
    match (is_section, is_text) {
        (true, _) => write_section(content, out),
        (false, true) => write_content(content, out),
        (false, false) => write_base64(content, out),
    }
    out.put_slice(b"</content>");
    !is_section && !is_text
}

/// Whether the content is written as a section.
fn is_section(content: &[u8], is_text: bool, form: ContentForm) -> bool {
    let fits = match form {
        ContentForm::Escaped => return false,
        // Whoever reads as XML does takes it for a line feed.
        ContentForm::Section => is_text && memchr(b'\r', content).is_none(),
        ContentForm::RawSection => memchr(0, content).is_none(),
    };
    fits && memmem::find(content, b"]]>").is_none()
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
