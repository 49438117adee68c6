use fipa_acl::{AgentId, Message, Performative};

use super::content::undo_base64;
use super::cursor::{Cursor, Element};
use super::names::{Tag, act_of};
use crate::{DecodeError, Fault};

/// The name under which one peer sends a message whose sender was never set.
const NO_SENDER: &str = "agent_id:undefined";

impl Cursor<'_> {
    /// `fipa-message` of SC00071E.
    pub(super) fn message(&mut self) -> Result<Message, DecodeError> {
        let root = self.root()?;
        if root.tag != Tag::FipaMessage {
            return Err(DecodeError {
                offset: root.name.start,
                fault: Fault::Malformed,
                what: "the outermost element is no fipa-message",
            });
        }
        let mut message = Message::new(self.act()?);
        let attribute = self.attribute_text(b"conversation-id")?;
        while let Some(child) = self.child(&root)? {
            self.parameter(&child, &mut message)?;
        }
        if let (None, Some(id)) = (&message.conversation_id, attribute)
            && !id.is_empty()
        {
            message.conversation_id = Some(self.expression(id)?);
        }
        undo_base64(&mut message);
        Ok(message)
    }

    fn act(&self) -> Result<Performative, DecodeError> {
        let value = self.attribute(b"act").unwrap_or_default();
        if let Some(act) = act_of(self.octets(value).trim_ascii()) {
            return Ok(act);
        }
        let name = self.attribute_text(b"act")?.unwrap_or_default();
        match name.trim_ascii() {
            "" => Err(self.error(Fault::Violation, "a message without its act")),
            trimmed => Ok(Performative::from(trimmed)),
        }
    }

    /// What comes twice: the last one counts, but receivers add up.
    fn parameter(&mut self, element: &Element, message: &mut Message) -> Result<(), DecodeError> {
        match element.tag {
            Tag::Sender => self.sender(element, &mut message.sender)?,
            Tag::Receiver => self.agents(element, &mut message.receiver)?,
            Tag::ReplyTo => self.agents(element, &mut message.reply_to)?,
            Tag::Content => message.content = self.content(element)?,
            Tag::Language => self.tag(element, &mut message.language)?,
            Tag::Encoding => self.tag(element, &mut message.encoding)?,
            Tag::Ontology => self.tag(element, &mut message.ontology)?,
            Tag::Protocol => message.protocol = self.optional(element)?,
            Tag::ConversationId => self.tag(element, &mut message.conversation_id)?,
            Tag::ReplyWith => self.tag(element, &mut message.reply_with)?,
            Tag::InReplyTo => self.tag(element, &mut message.in_reply_to)?,
            Tag::ReplyBy => message.reply_by = self.time(element)?,
            Tag::UserDefined | Tag::Extension => {
                self.expression_parameter(element, &mut message.user_defined)?;
            }
            _ => self.skip(element)?,
        }
        Ok(())
    }

    fn sender(
        &mut self,
        element: &Element,
        place: &mut Option<AgentId>,
    ) -> Result<(), DecodeError> {
        self.one_agent(element, place)?;
        if place
            .as_ref()
            .is_some_and(|sender| sender.name == *NO_SENDER)
        {
            *place = None;
        }
        Ok(())
    }
}
