use fipa_acl::{AgentId, Expression, Message, Performative, UserDefined};

use super::agents::Notation;
use super::codes::act_of;
use super::reader::Reader;
use super::values::read_time;
use crate::{DecodeError, Fault};

/// The name under which one peer sends a message whose sender was never set.
const NO_SENDER: &str = "agent_id:undefined";

impl Reader<'_> {
    /// ACLCommunicativeAct of SC00069G.
    #[inline]
    pub(super) fn message(&mut self) -> Result<Message, DecodeError> {
        self.header()?;
        let mut message = Message::new(self.act()?);
        loop {
            match self.octet()? {
                0x01 => return Ok(message),
                code => self.parameter(code, &mut message)?,
            }
        }
    }

    /// A code table may be in use as long as nothing is taken from it.
    fn header(&mut self) -> Result<(), DecodeError> {
        if !matches!(self.octet()?, 0xfa..=0xfc) {
            return Err(self.unexpected("no bit-efficient message begins like this"));
        }
        match self.octet()? {
            0x10..=0x1f | 0x01 => Ok(()),
            _ => Err(DecodeError {
                fault: Fault::Unsupported,
                ..self.unexpected("a version other than 1")
            }),
        }
    }

    fn act(&mut self) -> Result<Performative, DecodeError> {
        match self.octet()? {
            0x00 => self.bin_word().map(Performative::from),
            code => act_of(code).ok_or_else(|| self.unexpected("no act has this code")),
        }
    }

    /// What comes twice: the last one counts.
    fn parameter(&mut self, code: u8, message: &mut Message) -> Result<(), DecodeError> {
        match code {
            0x00 => message.user_defined.push(self.user_defined()?),
            0x02 => message.sender = self.sender()?,
            0x03 => message.receiver = self.agents(Notation::Message)?,
            0x04 => message.content = Some(self.string()?),
            0x05 => self.tag(&mut message.reply_with)?,
            0x06 => message.reply_by = Some(read_time(self)?),
            0x07 => self.tag(&mut message.in_reply_to)?,
            0x08 => message.reply_to = self.agents(Notation::Message)?,
            0x09 => self.tag(&mut message.language)?,
            0x0a => self.tag(&mut message.encoding)?,
            0x0b => self.tag(&mut message.ontology)?,
            0x0c => message.protocol = Some(self.bin_word()?),
            0x0d => self.tag(&mut message.conversation_id)?,
            _ => return Err(self.unexpected("a message has no such parameter")),
        }
        Ok(())
    }

    /// Out of line, and into its place: a message has many of them, and moving them costs more
    /// than reading them.
    #[inline(never)]
    fn tag(&mut self, place: &mut Option<Expression>) -> Result<(), DecodeError> {
        *place = Some(self.expression()?);
        Ok(())
    }

    fn sender(&mut self) -> Result<Option<AgentId>, DecodeError> {
        let sender = self.agent(Notation::Message)?;
        Ok(Some(sender).filter(|sender| sender.name != *NO_SENDER))
    }

    fn user_defined(&mut self) -> Result<UserDefined, DecodeError> {
        self.count_item()?;
        let name = self.bin_word()?;
        let value = self.expression()?;
        Ok(UserDefined::new(name, value))
    }
}
