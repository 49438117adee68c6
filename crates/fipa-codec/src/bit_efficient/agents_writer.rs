use bytes::{BufMut, BytesMut};
use fipa_acl::{AgentId, Text};

use super::writer::{without_prefix, write_counted, write_null_terminated, write_prefixed};
use crate::EncodeError;

/// An empty text is the same as an absent one.
pub(super) fn write_text(
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

pub(super) fn write_agents(
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
pub(super) fn write_agent(
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
pub(super) fn write_any(
    octets: &[u8],
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    if octets.contains(&0) {
        return write_counted(octets, out).map_err(|why| why.within(parameter));
    }
    out.put_u8(0x14);
    write_null_terminated(octets, parameter, out)
}
