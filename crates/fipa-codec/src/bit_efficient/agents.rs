use fipa_acl::{AgentId, Expression, Text, UserDefined};

use super::reader::Reader;
use super::texts::Found;
use crate::DecodeError;

/// The end of a collection.
const END: u8 = 0x01;

/// In which of the two standards an agent identifier stands: they differ in how they write text.
#[derive(Clone, Copy)]
pub(super) enum Notation {
    /// SC00069G: words and expressions.
    Message,
    /// SC00088D: null terminated strings.
    Envelope,
}

impl<'a> Reader<'a> {
    /// AgentIdentifier* and the end of the collection, into its place.
    pub(super) fn agents(
        &mut self,
        notation: Notation,
        agents: &mut Vec<AgentId>,
    ) -> Result<(), DecodeError> {
        self.agents_at(notation, 0, agents)
    }

    /// AgentIdentifier of SC00069G or SC00088D, into its place.
    pub(super) fn agent<'p>(
        &mut self,
        notation: Notation,
        place: &'p mut Option<AgentId>,
    ) -> Result<&'p mut AgentId, DecodeError> {
        let name = self.agent_name(notation, 0)?;
        *place = None;
        self.take_with(name, |name| *place = Some(named(name)));
        let agent = place.get_or_insert_default();
        self.agent_parameters(notation, 0, agent)?;
        Ok(agent)
    }

    fn agents_at(
        &mut self,
        notation: Notation,
        depth: usize,
        agents: &mut Vec<AgentId>,
    ) -> Result<(), DecodeError> {
        agents.clear();
        while !self.skip_if(END)? {
            self.count_item()?;
            let name = self.agent_name(notation, depth)?;
            // Nearly always it is the only one, for which a vector makes too much room.
            if agents.capacity() == 0 {
                *agents = Vec::with_capacity(1);
            }
            // In its place: moving an identifier costs more than reading it.
            self.take_with(name, |name| agents.push(named(name)));
            if let Some(agent) = agents.last_mut() {
                self.agent_parameters(notation, depth, agent)?;
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn agent_name(&mut self, notation: Notation, depth: usize) -> Result<Found<'a>, DecodeError> {
        self.check_depth(depth)?;
        if self.octet()? != 0x02 {
            return Err(self.unexpected("an agent identifier is missing"));
        }
        match notation {
            Notation::Message => self.find_word(),
            Notation::Envelope => self.find_literal(),
        }
    }

    #[inline]
    fn agent_parameters(
        &mut self,
        notation: Notation,
        depth: usize,
        agent: &mut AgentId,
    ) -> Result<(), DecodeError> {
        loop {
            match self.octet()? {
                END => return Ok(()),
                0x02 => agent.addresses = self.addresses(notation)?,
                0x03 => self.agents_at(notation, depth + 1, &mut agent.resolvers)?,
                // The two standards have one code each; one encoder uses that of the other.
                0x04 | 0x05 => {
                    self.count_item()?;
                    let name = self.text_in(notation)?;
                    let value = self.user_value(notation)?;
                    agent.user_defined.push(UserDefined::new(name, value));
                }
                _ => return Err(self.unexpected("an agent identifier has no such parameter")),
            }
        }
    }

    fn addresses(&mut self, notation: Notation) -> Result<Vec<Text>, DecodeError> {
        let mut addresses = Vec::new();
        while !self.skip_if(END)? {
            self.count_item()?;
            addresses.push(self.text_in(notation)?);
        }
        Ok(addresses)
    }

    #[inline]
    fn text_in(&mut self, notation: Notation) -> Result<Text, DecodeError> {
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
}

#[inline(always)]
fn named(name: Text) -> AgentId {
    AgentId {
        name,
        addresses: Vec::new(),
        resolvers: Vec::new(),
        user_defined: Vec::new(),
    }
}
