//! To whom of an agent an incoming message belongs.

use std::collections::{HashMap, VecDeque};

use fipa_acl::{Expression, Message, Performative, Text};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};

/// Conversations that were broken off, and whose late answers nobody wants.
const MAX_BROKEN_OFF: usize = 256;

/// What whoever opened a conversation hears.
#[derive(Debug)]
pub(crate) enum Heard {
    Said(Box<Message>),
    Gone(Text),
}

/// Why a handler is stopped.
#[derive(Debug)]
pub(crate) enum Stop {
    Cancelled(Box<Message>),
    InitiatorGone,
}

/// A conversation that somebody else has opened, for its handler.
#[derive(Debug)]
pub(crate) struct Opened {
    pub(crate) message: Message,
    pub(crate) said: UnboundedReceiver<Message>,
    pub(crate) stop: UnboundedReceiver<Stop>,
}

/// A conversation as those know it who take part: its id, and who opened it.
pub(crate) type Key = (Expression, Text);

#[derive(Default)]
pub(crate) struct Routes {
    asked: HashMap<Expression, Asked>,
    answering: HashMap<Key, Answering>,
    services: Vec<Service>,
    next_service: u64,
    broken_off: VecDeque<Expression>,
}

/// One that this agent has opened.
struct Asked {
    peers: Vec<Text>,
    heard: UnboundedSender<Heard>,
}

struct Answering {
    said: UnboundedSender<Message>,
    stop: UnboundedSender<Stop>,
}

/// A running responder.
struct Service {
    id: u64,
    acts: Vec<Performative>,
    opened: UnboundedSender<Opened>,
}

impl Routes {
    pub(crate) fn ask(&mut self, id: Expression, peers: Vec<Text>) -> UnboundedReceiver<Heard> {
        let (heard, receiver) = unbounded_channel();
        self.asked.insert(id, Asked { peers, heard });
        receiver
    }

    /// The conversation is over for whoever opened it; what still comes is dropped if it was
    /// broken off.
    pub(crate) fn forget_asked(&mut self, id: &Expression, is_broken_off: bool) {
        self.asked.remove(id);
        if is_broken_off {
            self.broken_off.truncate(MAX_BROKEN_OFF - 1);
            self.broken_off.push_front(id.clone());
        }
    }

    pub(crate) fn serve(&mut self, acts: Vec<Performative>) -> (u64, UnboundedReceiver<Opened>) {
        let (opened, receiver) = unbounded_channel();
        self.next_service += 1;
        let id = self.next_service;
        self.services.push(Service { id, acts, opened });
        (id, receiver)
    }

    pub(crate) fn end_service(&mut self, id: u64) {
        self.services.retain(|service| service.id != id);
    }

    pub(crate) fn forget_answering(&mut self, key: &Key) {
        self.answering.remove(key);
    }

    pub(crate) fn is_busy(&self) -> bool {
        !self.asked.is_empty() || !self.answering.is_empty()
    }

    /// Whether any message is for somebody here.
    pub(super) fn takes_some(&self) -> bool {
        self.is_busy() || !self.services.is_empty() || !self.broken_off.is_empty()
    }

    /// An agent is gone: those who talk with it are told.
    pub(crate) fn gone(&mut self, name: &Text) {
        for asked in self.asked.values() {
            if asked.peers.contains(name) {
                // Whoever does not listen any more has ended by itself.
                let _ = asked.heard.send(Heard::Gone(name.clone()));
            }
        }
        for ((_, initiator), answering) in &self.answering {
            if initiator == name {
                let _ = answering.stop.send(Stop::InitiatorGone);
            }
        }
    }

    /// Gives a message to whom it belongs; given back is one for `receive`.
    pub(crate) fn route(&mut self, message: Message) -> Option<Message> {
        if !self.takes_some() {
            return Some(message);
        }
        let message = match message.performative {
            Performative::Request
            | Performative::RequestWhen
            | Performative::RequestWhenever
            | Performative::QueryIf
            | Performative::QueryRef
            | Performative::Subscribe
            | Performative::Cfp => self.give_responder(message)?,
            Performative::Cancel => return self.give_handler(message),
            _ => message,
        };
        let message = self.give_initiator(message)?;
        match message.performative {
            Performative::Propose => self.give_responder(message),
            _ => self.give_handler(message),
        }
    }

    fn give_initiator(&mut self, message: Message) -> Option<Message> {
        let Some(id) = &message.conversation_id else {
            return Some(message);
        };
        if let Some(asked) = self.asked.get(id) {
            return match asked.heard.send(Heard::Said(Box::new(message))) {
                Ok(()) => None,
                Err(unheard) => match unheard.0 {
                    Heard::Said(message) => Some(*message),
                    Heard::Gone(_) => None,
                },
            };
        }
        (!self.broken_off.contains(id)).then_some(message)
    }

    /// Further messages of a conversation that is being answered.
    fn give_handler(&mut self, message: Message) -> Option<Message> {
        let found = key(&message).and_then(|key| self.answering.get(&key));
        let Some(answering) = found else {
            return Some(message);
        };
        if message.performative == Performative::Cancel {
            let sent = answering.stop.send(Stop::Cancelled(Box::new(message)));
            return match sent.err()?.0 {
                Stop::Cancelled(message) => Some(*message),
                Stop::InitiatorGone => None,
            };
        }
        answering.said.send(message).err().map(|unsent| unsent.0)
    }

    /// A message that opens a conversation, for the responder that knows its act.
    fn give_responder(&mut self, message: Message) -> Option<Message> {
        let message = self.give_handler(message)?;
        let knows = |service: &&Service| service.acts.contains(&message.performative);
        let Some(service) = self.services.iter().find(knows) else {
            return Some(message);
        };
        let (said, hears) = unbounded_channel();
        let (stop, stopped) = unbounded_channel();
        let key = key(&message);
        let opened = Opened {
            message,
            said: hears,
            stop: stopped,
        };
        if let Err(unsent) = service.opened.send(opened) {
            return Some(unsent.0.message);
        }
        if let Some(key) = key {
            self.answering.insert(key, Answering { said, stop });
        }
        None
    }
}

/// The conversation of a message that its initiator sent.
pub(crate) fn key(message: &Message) -> Option<Key> {
    let id = message.conversation_id.clone()?;
    Some((id, message.sender.as_ref()?.name.clone()))
}
