use fipa_acl::{AgentId, Text, UserDefined, canonical_user_name};

use super::content::EndTag;
use super::cursor::{Cursor, Element};
use super::names::Tag;
use crate::{DecodeError, Fault};

impl Cursor<'_> {
    /// Adds the agents within an element, of which there may be several of the same name.
    #[inline(never)]
    pub(super) fn agents(
        &mut self,
        element: &Element,
        agents: &mut Vec<AgentId>,
    ) -> Result<(), DecodeError> {
        self.agents_at(element, 0, agents)
    }

    /// The agent within an element; the last one if there are several.
    #[inline(never)]
    pub(super) fn one_agent(
        &mut self,
        element: &Element,
        place: &mut Option<AgentId>,
    ) -> Result<(), DecodeError> {
        while let Some(child) = self.child(element)? {
            match child.tag {
                Tag::AgentIdentifier => {
                    self.agent_at(&child, 0, place.insert(AgentId::default()))?;
                }
                _ => self.skip(&child)?,
            }
        }
        Ok(())
    }

    fn agents_at(
        &mut self,
        element: &Element,
        depth: usize,
        agents: &mut Vec<AgentId>,
    ) -> Result<(), DecodeError> {
        while let Some(child) = self.child(element)? {
            match child.tag {
                Tag::AgentIdentifier => {
                    self.count_items(1)?;
                    self.agent_at(&child, depth, agents.push_mut(AgentId::default()))?;
                }
                _ => self.skip(&child)?,
            }
        }
        Ok(())
    }

    /// Reads into its place: moving an identifier costs more than reading it.
    fn agent_at(
        &mut self,
        element: &Element,
        depth: usize,
        agent: &mut AgentId,
    ) -> Result<(), DecodeError> {
        self.check_depth(depth)?;
        while let Some(child) = self.child(element)? {
            match child.tag {
                Tag::Name => agent.name = self.trimmed(&child, &[b"id", b"refid", b"value"])?,
                Tag::Addresses => self.addresses(&child, &mut agent.addresses)?,
                Tag::Resolvers => self.agents_at(&child, depth + 1, &mut agent.resolvers)?,
                Tag::UserDefined | Tag::Extension => {
                    self.expression_parameter(&child, &mut agent.user_defined)?;
                }
                _ => self.skip(&child)?,
            }
        }
        if agent.name.is_empty() {
            return Err(self.error(Fault::Violation, "an agent without a name"));
        }
        Ok(())
    }

    fn addresses(
        &mut self,
        element: &Element,
        addresses: &mut Vec<Text>,
    ) -> Result<(), DecodeError> {
        while let Some(child) = self.child(element)? {
            if child.tag != Tag::Url {
                self.skip(&child)?;
                continue;
            }
            self.count_items(1)?;
            let address = self.trimmed(&child, &[b"href", b"value"])?;
            if !address.is_empty() {
                addresses.push(address);
            }
        }
        Ok(())
    }

    /// Adds a user-defined parameter of a message or an agent.
    pub(super) fn expression_parameter(
        &mut self,
        element: &Element,
        parameters: &mut Vec<UserDefined>,
    ) -> Result<(), DecodeError> {
        if let Some((name, text)) = self.user_defined(element)? {
            let value = self.expression(text)?;
            parameters.push(UserDefined { name, value });
        }
        Ok(())
    }

    /// Adds a user-defined parameter of an envelope or a stamp.
    pub(super) fn text_parameter(
        &mut self,
        element: &Element,
        parameters: &mut Vec<(Text, Text)>,
    ) -> Result<(), DecodeError> {
        parameters.extend(self.user_defined(element)?);
        Ok(())
    }

    /// `<user-defined href="X-…">`, or an element with the parameter's own name as JADE has it.
    /// What type an attribute gives the value is not looked at: nothing is ever made of it but
    /// text. Without a name there is no parameter.
    fn user_defined(&mut self, element: &Element) -> Result<Option<(Text, Text)>, DecodeError> {
        self.count_items(1)?;
        let name = match element.tag {
            Tag::Extension => Some(self.local_name(element)),
            _ => self.attribute_text(b"href")?,
        };
        let text = if self.lenient {
            let octets = self.unescaped_text(element, EndTag::First, &[b"value"])?;
            self.text_of(octets)
        } else {
            self.exact(element, &[b"value"])?
        };
        let name = name.map(canonical_user_name);
        Ok(name
            .filter(|name| !name.is_empty())
            .map(|name| (name, text)))
    }
}
