//! A conversation that this agent has opened, until it is over or nobody waits for it any more.

use std::time::Duration;

use fipa_acl::{Expression, FipaTime, Message, Performative, Text};
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::time::Instant;

use super::routes::Heard;
use super::{ConversationError, Voice};
use crate::Agent;

/// How much later than the deadline the other one may answer by what it is told, so that a cancel
/// at the deadline is not too late by the protocol.
pub(crate) const TIME_TO_CANCEL: Duration = Duration::from_secs(1);

/// Dropped before all have said their last word, it sends them a `cancel` (the cancel
/// meta-protocol of SC00026H and the other interaction protocols).
pub(crate) struct Exchange<'a> {
    pub(crate) agent: &'a Agent,
    pub(crate) opening: Message,
    id: Expression,
    heard: UnboundedReceiver<Heard>,
    /// Those of whom a last word is due.
    open: Vec<Text>,
    /// Nobody wants to hear more, though more may come.
    is_broken_off: bool,
}

impl<'a> Exchange<'a> {
    /// Prepares the opening message: what is missing of conversation-id, reply-with, reply-by and
    /// protocol is filled in.
    pub(crate) fn new(
        agent: &'a Agent,
        mut opening: Message,
        protocol: &'static str,
        reply_within: Duration,
    ) -> Exchange<'a> {
        let tag = agent.tag();
        let id = opening.conversation_id.get_or_insert_with(|| tag.clone());
        let id = id.clone();
        opening.reply_with.get_or_insert(tag);
        let by = agent.talk.clock.now().plus(reply_within).unix_millis;
        opening
            .reply_by
            .get_or_insert(FipaTime::from_unix_millis(by));
        opening
            .protocol
            .get_or_insert_with(|| Text::from_static(protocol));
        let peers: Vec<Text> = opening.receiver.iter().map(|r| r.name.clone()).collect();
        let heard = agent.talk.routes().ask(id.clone(), peers.clone());
        Exchange {
            agent,
            opening,
            id,
            heard,
            open: peers,
            is_broken_off: false,
        }
    }

    /// Sends a message of the conversation to one agent.
    pub(crate) async fn send(
        &self,
        message: Message,
        deadline: Duration,
    ) -> Result<(), ConversationError> {
        let outcomes = self.agent.voice().send(message, deadline).await;
        match ConversationError::undelivered(&outcomes) {
            Some(undelivered) => Err(undelivered),
            None => Ok(()),
        }
    }

    /// Sends the opening message to one agent. What was not delivered needs no cancel.
    pub(crate) async fn open(&mut self, deadline: Duration) -> Result<(), ConversationError> {
        let sent = self.send(self.opening.clone(), deadline).await;
        if sent.is_err() {
            self.open.clear();
        }
        sent
    }

    /// What comes next in this conversation; `None` when it is too late. Cancel-safe.
    pub(crate) async fn hear(
        &mut self,
        until: Option<Instant>,
    ) -> Result<Option<Heard>, ConversationError> {
        let over = async {
            match until {
                Some(until) => tokio::time::sleep_until(until).await,
                None => std::future::pending().await,
            }
        };
        tokio::pin!(over);
        loop {
            let notified = self.agent.mail().notified();
            tokio::pin!(notified);
            notified.as_mut().enable();
            self.agent.take_mail_in();
            if let Ok(heard) = self.heard.try_recv() {
                return Ok(Some(heard));
            }
            if self.agent.has_ended() {
                return Err(ConversationError::Ended);
            }
            tokio::select! {
                () = notified => {}
                // Another task of this agent may have taken the mail.
                heard = self.heard.recv() => match heard {
                    Some(heard) => return Ok(Some(heard)),
                    None => return Err(ConversationError::Ended),
                },
                () = &mut over => return Ok(None),
            }
        }
    }

    /// What has come already in this conversation, without waiting.
    pub(crate) fn heard_already(&mut self) -> Option<Heard> {
        self.agent.take_mail_in();
        self.heard.try_recv().ok()
    }

    /// No last word is due of this agent any more.
    pub(crate) fn settled(&mut self, name: &str) {
        self.open.retain(|peer| *peer != *name);
    }

    /// No last word is due of anybody any more.
    pub(crate) fn all_settled(&mut self) {
        self.open.clear();
    }

    /// It was cancelled: no other cancel is sent.
    pub(crate) fn break_off(&mut self) {
        self.open.clear();
        self.is_broken_off = true;
    }

    pub(crate) fn voice(&self) -> Voice {
        self.agent.voice()
    }

    /// The cancel for those of whom a last word is due, with what is cancelled as its content.
    pub(crate) fn cancel(&self) -> Message {
        let mut cancel = Message::new(Performative::Cancel);
        cancel.receiver = self.opening.receiver.clone();
        cancel.receiver.retain(|r| self.open.contains(&r.name));
        cancel.content = self.opening.content.clone();
        cancel.language = self.opening.language.clone();
        cancel.ontology = self.opening.ontology.clone();
        cancel.encoding = self.opening.encoding.clone();
        cancel.protocol = self.opening.protocol.clone();
        cancel.conversation_id = Some(self.id.clone());
        cancel.reply_with = Some(self.agent.tag());
        cancel
    }
}

impl Drop for Exchange<'_> {
    fn drop(&mut self) {
        let is_open = !self.open.is_empty() && !self.agent.has_ended();
        let is_broken_off = is_open || self.is_broken_off;
        let mut routes = self.agent.talk.routes();
        routes.forget_asked(&self.id, is_broken_off);
        drop(routes);
        if is_open {
            self.voice().post(self.cancel());
        }
    }
}

/// Which end an answer is, if it is one that ends a conversation without success.
pub(crate) fn failure_of(message: &Message) -> Option<fn(Box<Message>) -> ConversationError> {
    match message.performative {
        Performative::Refuse | Performative::RejectProposal => Some(ConversationError::Refused),
        Performative::Failure => Some(ConversationError::Failed),
        Performative::NotUnderstood => Some(ConversationError::NotUnderstood),
        _ => None,
    }
}
