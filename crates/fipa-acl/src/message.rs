use bytes::Bytes;

use crate::{AgentId, Expression, FipaTime, Performative, Text, UserDefined};

/// An ACL message (FIPA SC00061G): a performative and twelve optional parameters.
///
/// Only the performative is mandatory. An absent parameter is `None` or an empty list.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Message {
    /// The communicative act.
    pub performative: Performative,
    /// Who performs the act; absent only for anonymity.
    pub sender: Option<AgentId>,
    /// Who it is for, in the order in which it was given, duplicates included.
    pub receiver: Vec<AgentId>,
    /// Where answers go instead of to the sender.
    pub reply_to: Vec<AgentId>,
    /// The object of the act: opaque octets in `language`.
    pub content: Option<Bytes>,
    /// The language of the content.
    pub language: Option<Expression>,
    /// The encoding of the content.
    pub encoding: Option<Expression>,
    /// What the symbols of the content mean.
    pub ontology: Option<Expression>,
    /// The interaction protocol; a conversation id belongs to it.
    pub protocol: Option<Text>,
    /// The conversation that this message belongs to.
    pub conversation_id: Option<Expression>,
    /// The tag that an answer must carry in `in_reply_to`.
    pub reply_with: Option<Expression>,
    /// The `reply_with` of the message that this one answers.
    pub in_reply_to: Option<Expression>,
    /// When the sender stops waiting for an answer.
    pub reply_by: Option<FipaTime>,
    /// Parameters outside the standard.
    pub user_defined: Vec<UserDefined>,
}

impl Message {
    /// A message with nothing but its performative.
    pub fn new(performative: impl Into<Performative>) -> Message {
        Message {
            performative: performative.into(),
            sender: None,
            receiver: Vec::new(),
            reply_to: Vec::new(),
            content: None,
            language: None,
            encoding: None,
            ontology: None,
            protocol: None,
            conversation_id: None,
            reply_with: None,
            in_reply_to: None,
            reply_by: None,
            user_defined: Vec::new(),
        }
    }

    /// The answer to this message (SC00061G, SC00037J).
    ///
    /// Its receivers are those of `reply-to`, else the sender; `in-reply-to` is the `reply-with`
    /// of this message; conversation, protocol, language, encoding and ontology are copied. The
    /// sender is left for the agent that sends it.
    pub fn reply(&self, performative: impl Into<Performative>) -> Message {
        let mut answer = Message::new(performative);
        answer.receiver = if self.reply_to.is_empty() {
            self.sender.iter().cloned().collect()
        } else {
            self.reply_to.clone()
        };
        answer.in_reply_to = self.reply_with.clone();
        answer.conversation_id = self.conversation_id.clone();
        answer.protocol = self.protocol.clone();
        answer.language = self.language.clone();
        answer.encoding = self.encoding.clone();
        answer.ontology = self.ontology.clone();
        answer
    }

    /// Sets the sender.
    #[must_use]
    pub fn from_agent(mut self, sender: impl Into<AgentId>) -> Message {
        self.sender = Some(sender.into());
        self
    }

    /// Adds a receiver.
    #[must_use]
    pub fn to(mut self, receiver: impl Into<AgentId>) -> Message {
        self.receiver.push(receiver.into());
        self
    }

    /// Adds an agent to which answers go instead of to the sender.
    #[must_use]
    pub fn reply_to(mut self, agent: impl Into<AgentId>) -> Message {
        self.reply_to.push(agent.into());
        self
    }

    /// Sets the content.
    #[must_use]
    pub fn content(mut self, content: impl Into<Bytes>) -> Message {
        self.content = Some(content.into());
        self
    }

    /// Sets the language of the content.
    #[must_use]
    pub fn language(mut self, language: impl Into<Expression>) -> Message {
        self.language = Some(language.into());
        self
    }

    /// Sets the encoding of the content.
    #[must_use]
    pub fn encoding(mut self, encoding: impl Into<Expression>) -> Message {
        self.encoding = Some(encoding.into());
        self
    }

    /// Sets the ontology.
    #[must_use]
    pub fn ontology(mut self, ontology: impl Into<Expression>) -> Message {
        self.ontology = Some(ontology.into());
        self
    }

    /// Sets the interaction protocol.
    #[must_use]
    pub fn protocol(mut self, protocol: impl Into<Text>) -> Message {
        self.protocol = Some(protocol.into());
        self
    }

    /// Sets the conversation id.
    #[must_use]
    pub fn conversation_id(mut self, id: impl Into<Expression>) -> Message {
        self.conversation_id = Some(id.into());
        self
    }

    /// Sets the tag that an answer must carry.
    #[must_use]
    pub fn reply_with(mut self, tag: impl Into<Expression>) -> Message {
        self.reply_with = Some(tag.into());
        self
    }

    /// Sets the tag of the message that this one answers.
    #[must_use]
    pub fn in_reply_to(mut self, tag: impl Into<Expression>) -> Message {
        self.in_reply_to = Some(tag.into());
        self
    }

    /// Sets when the sender stops waiting for an answer.
    #[must_use]
    pub fn reply_by(mut self, time: impl Into<FipaTime>) -> Message {
        self.reply_by = Some(time.into());
        self
    }

    /// Adds a user-defined parameter; the name may be given with or without its `X-`.
    #[must_use]
    pub fn user_defined(mut self, name: impl Into<Text>, value: impl Into<Expression>) -> Message {
        self.user_defined.push(UserDefined::new(name, value));
        self
    }

    /// The content as text, if there is one and it is UTF-8.
    pub fn content_str(&self) -> Option<&str> {
        std::str::from_utf8(self.content.as_ref()?).ok()
    }
}
