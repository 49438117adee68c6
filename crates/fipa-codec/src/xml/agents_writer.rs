use fipa_acl::{AgentId, Expression, Text};

use super::options::WriteOptions;
use super::writer::{Element, Place, element, write_expression, write_text};
use crate::user_names::without_prefix;
use crate::{EncodeError, Output};

/// In which of the two standards an agent identifier stands: they differ in where they write text.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Notation {
    /// SC00071E: names and addresses are attributes.
    Message,
    /// SC00085J: names and addresses are the text of elements.
    Envelope,
}

/// An element with one agent in it.
pub(super) fn write_agent(
    element: Element,
    agent: &AgentId,
    notation: Notation,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    out.put_slice(element.open.as_bytes());
    write_identifier(agent, notation, element.name, options, out)?;
    out.put_slice(element.close.as_bytes());
    Ok(())
}

/// The agents of a slot or parameter that has any number of them.
pub(super) fn write_agents(
    element: Element,
    agents: &[AgentId],
    notation: Notation,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let grouped = match notation {
        Notation::Message => options.grouped_receivers,
        Notation::Envelope => options.grouped_agents,
    };
    if !grouped {
        return agents
            .iter()
            .try_for_each(|agent| write_agent(element, agent, notation, options, out));
    }
    if agents.is_empty() {
        return Ok(());
    }
    out.put_slice(element.open.as_bytes());
    for agent in agents {
        write_identifier(agent, notation, element.name, options, out)?;
    }
    out.put_slice(element.close.as_bytes());
    Ok(())
}

fn write_identifier(
    agent: &AgentId,
    notation: Notation,
    parameter: &'static str,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    if agent.name.trim_ascii().is_empty() {
        return Err(EncodeError {
            parameter,
            what: "an agent has a name",
        });
    }
    out.put_slice(b"<agent-identifier>");
    match notation {
        Notation::Message => write_attribute("<name id=\"", &agent.name, parameter, out)?,
        Notation::Envelope => element!("name").write(&agent.name, out)?,
    }
    write_addresses(&agent.addresses, notation, parameter, out)?;
    let has_resolvers = notation == Notation::Message || options.resolvers_in_envelopes;
    if has_resolvers && !agent.resolvers.is_empty() {
        out.put_slice(b"<resolvers>");
        for resolver in &agent.resolvers {
            write_identifier(resolver, notation, parameter, options, out)?;
        }
        out.put_slice(b"</resolvers>");
    }
    for parameter in &agent.user_defined {
        write_user_defined(&parameter.name, &parameter.value, options, out)?;
    }
    out.put_slice(b"</agent-identifier>");
    Ok(())
}

/// An empty address is no address.
fn write_addresses(
    addresses: &[Text],
    notation: Notation,
    parameter: &'static str,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let mut given = addresses
        .iter()
        .filter(|address| !address.is_empty())
        .peekable();
    if given.peek().is_none() {
        return Ok(());
    }
    out.put_slice(b"<addresses>");
    for address in given {
        match notation {
            Notation::Message => write_attribute("<url href=\"", address, parameter, out)?,
            Notation::Envelope => element!("url").write(address, out)?,
        }
    }
    out.put_slice(b"</addresses>");
    Ok(())
}

/// An element that has a value as its only attribute.
pub(super) fn write_attribute(
    start: &'static str,
    value: &str,
    parameter: &'static str,
    out: &mut Output,
) -> Result<(), EncodeError> {
    out.put_slice(start.as_bytes());
    write_text(value, Place::Attribute, parameter, out)?;
    out.put_slice(b"\"/>");
    Ok(())
}

/// A user-defined parameter of a message, in an element with its own name if that is wanted and
/// there can be one.
pub(super) fn write_parameter(
    name: &str,
    value: &Expression,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let own = without_prefix(name);
    let fits = |octet: u8| octet.is_ascii_alphanumeric() || matches!(octet, b'-' | b'_' | b'.');
    if !options.extension_elements || own.is_empty() || !own.bytes().all(fits) {
        return write_user_defined(name, value, options, out);
    }
    let tag = |start: &[u8], out: &mut Output| {
        out.put_slice(start);
        out.put_slice(own.as_bytes());
        out.put_u8(b'>');
    };
    tag(b"<X-", out);
    write_expression(value, Place::Text, PARAMETER, out)?;
    tag(b"</X-", out);
    Ok(())
}

/// A user-defined parameter of an agent, or of a message.
pub(super) fn write_user_defined(
    name: &str,
    value: &Expression,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    match value.as_str() {
        Some(text) => write_user_text(name, text, options, out),
        None => {
            write_start(name, out)?;
            write_expression(value, Place::Text, PARAMETER, out)?;
            out.put_slice(b"</user-defined>");
            Ok(())
        }
    }
}

/// A user-defined parameter of an envelope or a stamp.
pub(super) fn write_user_text(
    name: &str,
    value: &str,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    if value.is_empty() && !options.empty_user_defined {
        return Ok(());
    }
    write_start(name, out)?;
    write_text(value, Place::Text, PARAMETER, out)?;
    out.put_slice(b"</user-defined>");
    Ok(())
}

const PARAMETER: &str = "user-defined";

fn write_start(name: &str, out: &mut Output) -> Result<(), EncodeError> {
    let name = without_prefix(name);
    if name.is_empty() {
        return Err(EncodeError {
            parameter: PARAMETER,
            what: "a parameter has a name",
        });
    }
    out.put_slice(b"<user-defined href=\"X-");
    write_text(name, Place::Attribute, PARAMETER, out)?;
    out.put_slice(b"\" type=\"string\">");
    Ok(())
}
