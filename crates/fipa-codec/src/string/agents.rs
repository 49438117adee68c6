use fipa_acl::{AgentId, Expression, Text, UserDefined};

use super::keywords::{self, Keyword, Parameter};
use super::reader::Reader;
use super::scan::find_byte_length;
use crate::{DecodeError, Fault};

const AGENT: Keyword = Keyword::new(b"agent-identifier");
const SET: Keyword = Keyword::new(b"set");
const SEQUENCE: Keyword = Keyword::new(b"sequence");

impl Reader<'_> {
    /// AgentIdentifierSet of SC00070I.
    pub(super) fn agents(&mut self) -> Result<Vec<AgentId>, DecodeError> {
        self.agents_at(0)
    }

    /// AgentIdentifierSet or AgentIdentifierSequence, which are not told apart; an agent identifier
    /// alone is a set of one.
    fn agents_at(&mut self, depth: usize) -> Result<Vec<AgentId>, DecodeError> {
        self.open("a set of agents is missing")?;
        // Nearly always it is the only one, for which a vector makes too much room.
        let mut agents = Vec::with_capacity(1);
        if self.keyword(&AGENT)? {
            self.count_item()?;
            self.parameters_of(agents.push_mut(AgentId::default()), depth)?;
            return Ok(agents);
        }
        self.collection()?;
        while !self.closes()? {
            self.count_item()?;
            self.agent_at(depth, agents.push_mut(AgentId::default()))?;
        }
        Ok(agents)
    }

    fn collection(&mut self) -> Result<(), DecodeError> {
        if self.keyword(&SET)? || self.keyword(&SEQUENCE)? {
            return Ok(());
        }
        Err(self.error(Fault::Malformed, "a set or a sequence is missing"))
    }

    /// AgentIdentifier of SC00070I.
    ///
    /// Reads into its place: moving an identifier costs more than reading it.
    pub(super) fn agent_at(
        &mut self,
        depth: usize,
        agent: &mut AgentId,
    ) -> Result<(), DecodeError> {
        self.open("an agent identifier is missing")?;
        if !self.keyword(&AGENT)? {
            return Err(self.error(Fault::Malformed, "an agent identifier is missing"));
        }
        self.parameters_of(agent, depth)
    }

    fn parameters_of(&mut self, agent: &mut AgentId, depth: usize) -> Result<(), DecodeError> {
        self.check_depth(depth)?;
        let mut has_name = false;
        while self.next()? != b')' {
            has_name |= self.parameter_of(agent, depth)? == Some(Parameter::Name);
        }
        if !has_name {
            return Err(self.error(Fault::Malformed, "an agent identifier without a name"));
        }
        self.step();
        Ok(())
    }

    /// What comes twice: the last one counts.
    fn parameter_of(
        &mut self,
        agent: &mut AgentId,
        depth: usize,
    ) -> Result<Option<Parameter>, DecodeError> {
        if self.is_glued() && self.next()? != b':' {
            agent.user_defined.push(self.counted_parameter()?);
            return Ok(None);
        }
        let Some(parameter) = self.known_name(keywords::OF_AGENTS) else {
            let name = self.other_name()?;
            let parameter = self.user_defined(name)?;
            agent.user_defined.push(parameter);
            return Ok(None);
        };
        match parameter {
            Parameter::Addresses => agent.addresses = self.addresses()?,
            Parameter::Resolvers => agent.resolvers = self.agents_at(depth + 1)?,
            _ => agent.name = self.agent_name()?,
        }
        Ok(Some(parameter))
    }

    /// The encoder that writes no white space writes a parameter of an agent identifier without
    /// its colon. Directly behind the name it cannot be told where the name ends.
    fn agent_name(&mut self) -> Result<Text, DecodeError> {
        self.next()?;
        let start = self.position();
        let name = self.text()?;
        if self.is_glued() && find_byte_length(self.raw(&name)).is_some() {
            return Err(self.error_at(start, Fault::Malformed, "a name runs into a parameter"));
        }
        Ok(self.text_of(name))
    }

    /// A parameter as that encoder writes it: `name#n"` and n octets.
    fn counted_parameter(&mut self) -> Result<UserDefined, DecodeError> {
        self.count_item()?;
        let name = self.name_in_front_of_count()?;
        let value = self.counted()?;
        let value = Expression::String(self.text_of(value));
        Ok(UserDefined::new(self.text_of(name), value))
    }

    /// URLSequence of SC00070I. An address can hold what looks like a parameter; what follows it is
    /// set apart by all encoders.
    fn addresses(&mut self) -> Result<Vec<Text>, DecodeError> {
        self.open("a sequence of addresses is missing")?;
        self.collection()?;
        let mut addresses = Vec::new();
        while !self.closes()? {
            self.count_item()?;
            let address = match self.next()? {
                b'"' => self.literal()?,
                b'#' => self.counted()?,
                _ => self.spaced_word()?,
            };
            addresses.push(self.text_of(address));
        }
        Ok(addresses)
    }
}
