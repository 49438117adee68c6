use fipa_acl::{AgentId, Expression, Message, Performative, UserDefined};

use super::agents::Notation;
use super::codes::act_of;
use super::reader::Reader;
use super::times::read_time;
use crate::{DecodeError, Fault};

/// The name under which one peer sends a message whose sender was never set.
const NO_SENDER: &str = "agent_id:undefined";

impl Reader<'_> {
    /// ACLCommunicativeAct of SC00069G, and what else `then` wants.
    ///
    /// Everything is read into its place within the result: to move it costs more than to read it.
    #[inline]
    pub(super) fn message(
        &mut self,
        then: impl FnOnce(&mut Reader<'_>) -> Result<(), DecodeError>,
    ) -> Result<Message, DecodeError> {
        // Any act, until it is known.
        let mut decoded = Ok(Message::new(Performative::Inform));
        if let Ok(message) = &mut decoded
            && let Err(error) = self.message_to(message).and_then(|()| then(self))
        {
            decoded = Err(error);
        }
        decoded
    }

    fn message_to(&mut self, message: &mut Message) -> Result<(), DecodeError> {
        self.header()?;
        self.act(&mut message.performative)?;
        self.message_parameters(message)
    }

    /// A code table may be in use as long as nothing is taken from it.
    #[inline]
    pub(super) fn header(&mut self) -> Result<(), DecodeError> {
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

    fn act(&mut self, place: &mut Performative) -> Result<(), DecodeError> {
        match self.octet()? {
            0x00 => *place = Performative::from(self.bin_word()?),
            code => match act_of(code) {
                Some(act) => *place = act,
                None => return Err(self.unexpected("no act has this code")),
            },
        }
        Ok(())
    }

    /// What comes twice: the last one counts.
    fn message_parameters(&mut self, message: &mut Message) -> Result<(), DecodeError> {
        loop {
            match self.octet()? {
                0x00 => message.user_defined.push(self.user_defined()?),
                0x01 => return Ok(()),
                0x02 => self.sender(&mut message.sender)?,
                0x03 => self.agents(Notation::Message, &mut message.receiver)?,
                0x04 => message.content = Some(self.content()?),
                0x05 => self.tag(&mut message.reply_with)?,
                0x06 => message.reply_by = Some(read_time(self)?),
                0x07 => self.tag(&mut message.in_reply_to)?,
                0x08 => self.agents(Notation::Message, &mut message.reply_to)?,
                0x09 => self.tag(&mut message.language)?,
                0x0a => self.tag(&mut message.encoding)?,
                0x0b => self.tag(&mut message.ontology)?,
                0x0c => {
                    let protocol = self.find_word()?;
                    message.protocol = None;
                    self.take_with(protocol, |text| message.protocol = Some(text));
                }
                0x0d => self.tag(&mut message.conversation_id)?,
                _ => return Err(self.unexpected("a message has no such parameter")),
            }
        }
    }

    /// Out of line: a message has many of them.
    #[inline(never)]
    fn tag(&mut self, place: &mut Option<Expression>) -> Result<(), DecodeError> {
        self.expression_to(place)
    }

    fn sender(&mut self, place: &mut Option<AgentId>) -> Result<(), DecodeError> {
        if self.agent(Notation::Message, place)?.name == *NO_SENDER {
            *place = None;
        }
        Ok(())
    }

    fn user_defined(&mut self) -> Result<UserDefined, DecodeError> {
        self.count_item()?;
        let name = self.bin_word()?;
        let value = self.expression()?;
        Ok(UserDefined::new(name, value))
    }
}
