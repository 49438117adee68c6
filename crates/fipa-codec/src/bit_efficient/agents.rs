use fipa_acl::{AgentId, Expression, Text, UserDefined};

use super::reader::Reader;
use crate::DecodeError;

/// In which of the two standards an agent identifier stands: they differ in how they write text.
#[derive(Clone, Copy)]
pub(super) enum Notation {
    /// SC00069G: words and expressions.
    Message,
    /// SC00088D: null terminated strings.
    Envelope,
}

impl Reader<'_> {
    /// AgentIdentifier* and the end of the collection.
    pub(super) fn agents(&mut self, notation: Notation) -> Result<Vec<AgentId>, DecodeError> {
        self.agents_at(notation, 0)
    }

    /// AgentIdentifier of SC00069G or SC00088D.
    pub(super) fn agent(&mut self, notation: Notation) -> Result<AgentId, DecodeError> {
        let mut agent = AgentId::default();
        self.agent_at(notation, 0, &mut agent)?;
        Ok(agent)
    }

    /// NullTerminatedString of SC00088D.
    pub(super) fn null_terminated(&mut self) -> Result<Text, DecodeError> {
        let span = self.literal()?;
        Ok(self.text_of(span))
    }

    fn agents_at(&mut self, notation: Notation, depth: usize) -> Result<Vec<AgentId>, DecodeError> {
        let mut agents = Vec::new();
        while !self.is_end()? {
            self.count_item()?;
            self.agent_at(notation, depth, agents.push_mut(AgentId::default()))?;
        }
        Ok(agents)
    }

    /// Reads into its place: moving an identifier costs more than reading it.
    fn agent_at(
        &mut self,
        notation: Notation,
        depth: usize,
        agent: &mut AgentId,
    ) -> Result<(), DecodeError> {
        self.check_depth(depth)?;
        if self.octet()? != 0x02 {
            return Err(self.unexpected("an agent identifier is missing"));
        }
        agent.name = self.text(notation)?;
        loop {
            match self.octet()? {
                0x01 => return Ok(()),
                0x02 => agent.addresses = self.addresses(notation)?,
                0x03 => agent.resolvers = self.agents_at(notation, depth + 1)?,
                // The two standards have one code each; one encoder uses that of the other.
                0x04 | 0x05 => {
                    self.count_item()?;
                    let name = self.text(notation)?;
                    let value = self.user_value(notation)?;
                    agent.user_defined.push(UserDefined::new(name, value));
                }
                _ => return Err(self.unexpected("an agent identifier has no such parameter")),
            }
        }
    }

    fn addresses(&mut self, notation: Notation) -> Result<Vec<Text>, DecodeError> {
        let mut addresses = Vec::new();
        while !self.is_end()? {
            self.count_item()?;
            addresses.push(self.text(notation)?);
        }
        Ok(addresses)
    }

    fn text(&mut self, notation: Notation) -> Result<Text, DecodeError> {
        match notation {
            Notation::Message => self.bin_word(),
            Notation::Envelope => self.null_terminated(),
        }
    }

    /// An expression in a message; Any in an envelope, which some peers write without its code.
    fn user_value(&mut self, notation: Notation) -> Result<Expression, DecodeError> {
        match notation {
            Notation::Message => self.expression(),
            Notation::Envelope if matches!(self.peek()?, 0x14 | 0x16 | 0x17 | 0x19) => {
                self.expression()
            }
            Notation::Envelope => self.null_terminated().map(Expression::String),
        }
    }

    /// Steps over the end of a collection if it is here.
    fn is_end(&mut self) -> Result<bool, DecodeError> {
        let end = self.peek()? == 0x01;
        if end {
            self.octet()?;
        }
        Ok(end)
    }
}
