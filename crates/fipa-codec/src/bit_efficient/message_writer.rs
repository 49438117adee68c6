use bytes::{BufMut, BytesMut};
use fipa_acl::{AgentId, Expression, Message, Performative, UserDefined};

use super::code_table::{Coding, Kind};
use super::codes::code_of;
use super::options::WriteOptions;
use super::times::write_time;
use super::writer::{TooLong, user_name, write_length};
use crate::{EncodeError, Output};

/// Where the parameters of a message are written.
pub(super) struct Writer<'a> {
    pub(super) out: &'a mut BytesMut,
    options: &'a WriteOptions,
    /// The code table of the message, if it uses one.
    pub(super) coding: Option<Coding<'a>>,
}

/// ACLCommunicativeAct of SC00069G; in the order in which fipa_acl writes the parameters.
pub(super) fn write_message(
    message: &Message,
    options: &WriteOptions,
    out: &mut Output,
) -> Result<(), EncodeError> {
    out.put_slice(&[0xfa, 0x10]);
    write_parameters(message, options, None, out.buffer())?;
    write_content(message, out)
}

/// Everything between the header and the content.
pub(super) fn write_parameters(
    message: &Message,
    options: &WriteOptions,
    coding: Option<Coding<'_>>,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    let mut writer = Writer {
        out,
        options,
        coding,
    };
    writer.parameters(message)
}

/// The content, which is last, and the end.
pub(super) fn write_content(message: &Message, out: &mut Output) -> Result<(), EncodeError> {
    if let Some(content) = &message.content {
        out.put_u8(0x04);
        write_length(content.len(), out.buffer()).map_err(|why| why.within("content"))?;
        out.put_shared(content);
    }
    out.put_u8(0x01);
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

/// Why something within a parameter cannot be written. Results with whole errors go through
/// memory, and there are many.
#[derive(Clone, Copy)]
pub(super) enum Refusal {
    /// A name, an address or a protocol is no word.
    NotAWord,
    /// The name of a user-defined parameter is no word.
    UserName,
    /// The value of a user-defined parameter is too long.
    UserValue,
    /// A text is too long.
    TooLong,
}

impl Refusal {
    #[cold]
    fn within(self, parameter: &'static str) -> EncodeError {
        let (parameter, what) = match self {
            Refusal::NotAWord => (parameter, "not a word"),
            Refusal::UserName => ("user-defined", "the name is not a word"),
            Refusal::UserValue => ("user-defined", TooLong::WHAT),
            Refusal::TooLong => (parameter, TooLong::WHAT),
        };
        EncodeError { parameter, what }
    }
}

impl Writer<'_> {
    fn parameters(&mut self, message: &Message) -> Result<(), EncodeError> {
        self.act(&message.performative)?;
        if let Some(sender) = &message.sender {
            self.out.put_u8(0x02);
            self.agent(sender).map_err(|why| why.within("sender"))?;
        }
        self.agents(0x03, &message.receiver)
            .map_err(|why| why.within("receiver"))?;
        self.tag(0x05, &message.reply_with)
            .map_err(|why| why.within("reply-with"))?;
        if let Some(time) = &message.reply_by {
            self.out.put_u8(0x06);
            write_time(time, "reply-by", self.options, self.out)?;
        }
        self.tag(0x07, &message.in_reply_to)
            .map_err(|why| why.within("in-reply-to"))?;
        self.agents(0x08, &message.reply_to)
            .map_err(|why| why.within("reply-to"))?;
        self.tag(0x09, &message.language)
            .map_err(|why| why.within("language"))?;
        self.tag(0x0a, &message.encoding)
            .map_err(|why| why.within("encoding"))?;
        self.tag(0x0b, &message.ontology)
            .map_err(|why| why.within("ontology"))?;
        if let Some(protocol) = &message.protocol {
            self.word(Some(0x0c), protocol)
                .map_err(|why| why.within("protocol"))?;
        }
        self.tag(0x0d, &message.conversation_id)
            .map_err(|why| why.within("conversation-id"))?;
        for parameter in &message.user_defined {
            self.user_defined(0x00, parameter)
                .map_err(|why| why.within("user-defined"))?;
        }
        Ok(())
    }

    fn act(&mut self, act: &Performative) -> Result<(), EncodeError> {
        match code_of(act) {
            Ok(code) => self.out.put_u8(code),
            Err(name) => self
                .word(Some(0x00), name)
                .map_err(|why| why.within("performative"))?,
        }
        Ok(())
    }

    fn agents(&mut self, code: u8, agents: &[AgentId]) -> Result<(), Refusal> {
        if agents.is_empty() {
            return Ok(());
        }
        self.out.put_u8(code);
        for agent in agents {
            self.agent(agent)?;
        }
        self.out.put_u8(0x01);
        Ok(())
    }

    fn agent(&mut self, agent: &AgentId) -> Result<(), Refusal> {
        self.word(Some(0x02), &agent.name)?;
        if !agent.addresses.is_empty() {
            self.out.put_u8(0x02);
            for address in &agent.addresses {
                self.word(None, address)?;
            }
            self.out.put_u8(0x01);
        }
        self.agents(0x03, &agent.resolvers)?;
        for user_defined in &agent.user_defined {
            self.user_defined(0x04, user_defined)?;
        }
        self.out.put_u8(0x01);
        Ok(())
    }

    fn user_defined(&mut self, code: u8, parameter: &UserDefined) -> Result<(), Refusal> {
        self.out.put_u8(code);
        let name = user_name(&parameter.name)
            .ok_or(Refusal::UserName)?
            .as_bytes();
        let is_coded = self.coding.is_some() && {
            let marked = [b"X-", name].concat();
            self.is_coded(None, Kind::Word, &marked)
        };
        if !is_coded {
            self.out.put_slice(b"\x10X-");
            self.out.put_slice(name);
            self.out.put_u8(0);
        }
        self.expression(None, &parameter.value)
            .map_err(|_| Refusal::UserValue)
    }

    #[inline]
    fn tag(&mut self, code: u8, value: &Option<Expression>) -> Result<(), Refusal> {
        if let Some(value) = value {
            self.expression(Some(code), value)?;
        }
        Ok(())
    }
}
