use bytes::Bytes;
use fipa_acl::{AgentId, Expression, FipaTime, Message, Performative, Text, UserDefined};

use super::acts::act_named;
use super::jade;
use super::keywords::{self, Parameter};
use super::reader::{Reader, Span};
use crate::{DecodeError, Fault, dates};

impl Reader<'_> {
    /// ACLCommunicativeAct of SC00070I; a byte order mark may precede it.
    ///
    /// Reads into its place: moving a message costs much of what reading it costs.
    pub(super) fn message(&mut self, message: &mut Message) -> Result<(), DecodeError> {
        self.skip(b"\xef\xbb\xbf");
        self.open("a message begins with a parenthesis")?;
        message.performative = self.act()?;
        while !self.closes()? {
            self.parameter(message)?;
        }
        jade::undo_base64(message);
        Ok(())
    }

    /// MessageType of SC00070I.
    fn act(&mut self) -> Result<Performative, DecodeError> {
        if matches!(self.next()?, b'"' | b'#' | b':' | b'-' | b'@' | b'0'..=b'9') {
            return Err(self.error(Fault::Malformed, "no act begins like this"));
        }
        let start = self.position();
        let name = self.word()?;
        let octets = self.raw(&name);
        if let Some(act) = act_named(octets) {
            return Ok(act);
        }
        if keywords::has_parameter(octets) {
            return Err(self.error_at(start, Fault::Malformed, "the act runs into a parameter"));
        }
        Ok(Performative::Other(self.text_of(name)))
    }

    /// What comes twice: the last one counts.
    fn parameter(&mut self, message: &mut Message) -> Result<(), DecodeError> {
        let Some(parameter) = self.known_name(keywords::OF_MESSAGES) else {
            let name = self.other_name()?;
            let parameter = self.user_defined(name)?;
            message.user_defined.push(parameter);
            return Ok(());
        };
        match parameter {
            Parameter::Sender => self.agent_at(0, message.sender.insert(AgentId::default()))?,
            Parameter::Receiver => message.receiver = self.agents()?,
            Parameter::ReplyTo => message.reply_to = self.agents()?,
            Parameter::Content => message.content = Some(self.content()?),
            Parameter::Language => self.tag(&mut message.language)?,
            Parameter::Encoding => self.tag(&mut message.encoding)?,
            Parameter::Ontology => self.tag(&mut message.ontology)?,
            Parameter::Protocol => message.protocol = Some(self.protocol()?),
            Parameter::ConversationId => self.tag(&mut message.conversation_id)?,
            Parameter::ReplyWith => self.tag(&mut message.reply_with)?,
            Parameter::InReplyTo => self.tag(&mut message.in_reply_to)?,
            Parameter::ReplyBy => message.reply_by = Some(self.time()?),
            // No parameters of messages.
            Parameter::Name | Parameter::Addresses | Parameter::Resolvers => {}
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

    /// A string, or what some write in its place: its octets as they stand there.
    fn content(&mut self) -> Result<Bytes, DecodeError> {
        let span = match self.next()? {
            b'(' => {
                let start = self.position();
                self.expression()?;
                self.since(start)
            }
            _ => self.text()?,
        };
        Ok(self.bytes_of(span))
    }

    /// A word or, as one encoder does not quote it, several.
    fn protocol(&mut self) -> Result<Text, DecodeError> {
        let is_bare = !matches!(self.next()?, b'"' | b'#');
        let first = self.text()?;
        let first = self.text_of(first);
        if !is_bare || matches!(self.next()?, b':' | b'(' | b')') {
            return Ok(first);
        }
        let mut words = String::from(&*first);
        while !matches!(self.next()?, b':' | b'(' | b')') {
            let word = self.word()?;
            words.push(' ');
            words.push_str(&String::from_utf8_lossy(self.raw(&word)));
        }
        Ok(Text::from(words))
    }

    fn time(&mut self) -> Result<FipaTime, DecodeError> {
        self.next()?;
        let offset = self.position();
        let span = self.text()?;
        dates::parse(self.raw(&span)).map_err(|(fault, what)| self.error_at(offset, fault, what))
    }

    /// The value of a parameter outside the standard.
    ///
    /// The encoder that writes no white space puts the value in parentheses.
    pub(super) fn user_defined(&mut self, name: Span) -> Result<UserDefined, DecodeError> {
        self.count_item()?;
        let name = self.text_of(name);
        if fipa_acl::canonical_user_name(name.clone()).is_empty() {
            return Err(self.error(Fault::Malformed, "a parameter without a name"));
        }
        let mut value = self.expression()?;
        if self.is_glued()
            && let Expression::List(items) = &mut value
            && let [item] = items.as_mut_slice()
        {
            value = std::mem::replace(item, Expression::List(Vec::new()));
        }
        Ok(UserDefined::new(name, value))
    }
}
