use fipa_acl::{AgentId, Expression, Message, Performative, Text, UserDefined};

use super::scan::is_number;
use super::writer::Writer;
use crate::{EncodeError, dates};

impl Writer<'_> {
    /// ACLCommunicativeAct of SC00070I, in the order of the bit-efficient form: what a message is
    /// about stands in front of a content that may be long.
    pub(super) fn message(&mut self, message: &Message) -> Result<(), EncodeError> {
        self.out.reserve(expected_len(message));
        self.act(&message.performative)?;
        if let Some(sender) = &message.sender {
            self.put(b" :sender ");
            self.agent(sender, "sender", 0)?;
        }
        self.agents(b" :receiver ", &message.receiver, "receiver")?;
        self.tag(b" :reply-with ", &message.reply_with);
        if let Some(time) = &message.reply_by {
            self.put(b" :reply-by ");
            let wrong = |what| EncodeError {
                parameter: "reply-by",
                what,
            };
            dates::write(time, self.options.zone_letter, self.out).map_err(wrong)?;
        }
        self.tag(b" :in-reply-to ", &message.in_reply_to);
        self.agents(b" :reply-to ", &message.reply_to, "reply-to")?;
        self.tag(b" :language ", &message.language);
        self.tag(b" :encoding ", &message.encoding);
        self.tag(b" :ontology ", &message.ontology);
        if let Some(protocol) = &message.protocol {
            self.put(b" :protocol ");
            self.word(protocol, "protocol")?;
        }
        self.tag(b" :conversation-id ", &message.conversation_id);
        for parameter in &message.user_defined {
            self.user_defined(parameter, self.options.user_defined_in_parentheses)?;
        }
        if let Some(content) = &message.content {
            self.content(content);
        }
        self.put(b")");
        Ok(())
    }

    /// No peer reads an act outside the standard in this form.
    fn act(&mut self, act: &Performative) -> Result<(), EncodeError> {
        if let Performative::Other(_) = act {
            return Err(EncodeError {
                parameter: "performative",
                what: "in string form it must be one of the standard",
            });
        }
        self.put(b"(");
        self.put(act.as_str().as_bytes());
        Ok(())
    }

    fn agents(
        &mut self,
        name: &[u8],
        agents: &[AgentId],
        parameter: &'static str,
    ) -> Result<(), EncodeError> {
        if agents.is_empty() {
            return Ok(());
        }
        self.put(name);
        self.put(b"(set");
        for agent in agents {
            self.put(b" ");
            self.agent(agent, parameter, 0)?;
        }
        self.put(b")");
        Ok(())
    }

    /// AgentIdentifier of SC00070I; the level counts the resolvers around it.
    fn agent(
        &mut self,
        agent: &AgentId,
        parameter: &'static str,
        level: usize,
    ) -> Result<(), EncodeError> {
        self.put(b"(agent-identifier :name ");
        self.word(&agent.name, parameter)?;
        if !agent.addresses.is_empty() {
            self.put(b" :addresses (sequence");
            for address in &agent.addresses {
                self.put(b" ");
                self.word(address, parameter)?;
            }
            self.put(b")");
        }
        if !agent.resolvers.is_empty() && level < self.options.resolver_levels {
            self.put(b" :resolvers (sequence");
            for resolver in &agent.resolvers {
                self.put(b" ");
                self.agent(resolver, parameter, level + 1)?;
            }
            self.put(b")");
        }
        if self.options.user_defined_of_agents {
            for user_defined in &agent.user_defined {
                self.user_defined(user_defined, false)?;
            }
        }
        self.put(b")");
        Ok(())
    }

    fn user_defined(
        &mut self,
        parameter: &UserDefined,
        in_parentheses: bool,
    ) -> Result<(), EncodeError> {
        self.user_name(&parameter.name)?;
        self.put(if in_parentheses { b" (" } else { b" " });
        self.expression(&parameter.value);
        self.put(if in_parentheses { b")" } else { b"" });
        Ok(())
    }

    #[inline]
    fn tag(&mut self, name: &[u8], value: &Option<Expression>) {
        if let Some(value) = value {
            self.put(name);
            self.expression(value);
        }
    }

    /// Expression of SC00070I: a word if it is a legal one, else a string, never a number; or a
    /// list.
    #[inline]
    fn expression(&mut self, value: &Expression) {
        match value {
            Expression::Word(text) | Expression::String(text) | Expression::Number(text) => {
                self.word_or_string(text);
            }
            Expression::List(items) => self.list(items),
        }
    }

    fn list(&mut self, items: &[Expression]) {
        self.put(b"(");
        for (i, item) in items.iter().enumerate() {
            if i > 0 {
                self.put(b" ");
            }
            match item {
                Expression::Number(text) => self.number(text),
                Expression::Word(text) => self.word_or_string(text),
                Expression::String(text) => self.string(text),
                Expression::List(inner) => self.list(inner),
            }
        }
        self.put(b")");
    }

    fn number(&mut self, text: &Text) {
        if is_number(text.as_bytes()) {
            self.put(text.as_bytes());
        } else {
            self.word_or_string(text);
        }
    }
}

/// Octets that the message needs at least without its content, and mostly not much more.
fn expected_len(message: &Message) -> usize {
    let agents = message.receiver.len() + message.reply_to.len();
    let user_defined = message.user_defined.len();
    let content = message.content.as_ref().map_or(0, |content| content.len());
    // A long content is passed on by reference.
    content.min(4096) + 64 * agents + 32 * user_defined + 384
}
