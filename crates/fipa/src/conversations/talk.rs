use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fipa_acl::{Message, Text};
use fipa_conversation::not_understood_reply;
use fipa_link::{Outcome, ReceiverOutcome};
use tokio::sync::Notify;

use super::routes::Routes;
use super::watch::Watch;
use crate::clock::Clock;
use crate::platform::Inner;
use crate::room::Room;
use crate::sending;

/// Departures that wait until the mail is read that came before them.
const MAX_DEPARTED: usize = 10_000;

/// The conversations of one agent.
///
/// Its locks are taken while the platform is held, so nothing here calls the platform under one.
pub(crate) struct Talk {
    pub(crate) name: Text,
    pub(crate) clock: Clock,
    pub(crate) watch: Watch,
    /// For letters of the agent that are under way.
    pub(crate) room: Room,
    mail: Arc<Notify>,
    routes: Mutex<Routes>,
    departed: Mutex<VecDeque<Text>>,
    enlisted: AtomicBool,
}

impl Talk {
    pub(crate) fn new(name: Text, clock: Clock, mail: Arc<Notify>) -> Talk {
        Talk {
            name,
            clock,
            watch: Watch::default(),
            room: Room::default(),
            mail,
            routes: Mutex::default(),
            departed: Mutex::default(),
            enlisted: AtomicBool::new(false),
        }
    }

    /// Judges a message that is going to be sent. One that must not go is refused for all of its
    /// receivers.
    pub(crate) fn outgoing(
        self: &Arc<Self>,
        platform: &Inner,
        message: &Message,
    ) -> Result<(), Vec<ReceiverOutcome>> {
        let now = || self.clock.now();
        let judged = self.watch.judge(now, &self.name, message, true);
        self.enlist(platform);
        judged.map_err(|violation| {
            sending::failed(&message.receiver, Outcome::Refused, &violation.text)
        })
    }

    /// Judges a message that came, and gives it to whom it belongs; given back is one for
    /// `receive`.
    pub(crate) fn incoming(
        self: &Arc<Self>,
        platform: &Inner,
        message: Message,
    ) -> Option<Message> {
        let now = || self.clock.now();
        if let Err(violation) = self.watch.judge(now, &self.name, &message, false) {
            if let Some(reply) = not_understood_reply(&message, &violation) {
                sending::post(platform, reply.from_agent(&self.name));
            }
            return None;
        }
        self.routes().route(message)
    }

    /// The platform tells that an agent is gone. What it said before is still to be read.
    pub(crate) fn departed(&self, name: &Text) {
        let mut departed = self.departed.lock().unwrap_or_else(PoisonError::into_inner);
        let oldest = (departed.len() >= MAX_DEPARTED).then(|| departed.pop_front());
        departed.push_back(name.clone());
        drop(departed);
        if let Some(oldest) = oldest.flatten() {
            self.gone(&oldest);
        }
        self.mail.notify_waiters();
    }

    /// The mail is read: those that went have said what they had to say.
    pub(crate) fn mail_is_read(self: &Arc<Self>, platform: &Inner) {
        if !self.enlisted.load(Ordering::Relaxed) {
            self.enlist(platform);
            return;
        }
        loop {
            let mut departed = self.departed.lock().unwrap_or_else(PoisonError::into_inner);
            let Some(name) = departed.pop_front() else {
                return;
            };
            drop(departed);
            self.gone(&name);
        }
    }

    fn gone(&self, name: &Text) {
        self.watch.gone(self.clock.now(), name);
        self.routes().gone(name);
    }

    /// With the first conversation, the platform is asked to tell who goes.
    pub(crate) fn enlist(self: &Arc<Self>, platform: &Inner) {
        if self.enlisted.load(Ordering::Relaxed)
            || !self.watch.is_busy() && !self.routes().is_busy()
            || self.enlisted.swap(true, Ordering::Relaxed)
        {
            return;
        }
        let talk = Arc::downgrade(self);
        platform.backend.with(|_, _, hub| hub.tell_departures(talk));
    }

    /// Whether some of the mail is for conversations, not for `receive`.
    pub(crate) fn takes_mail(&self) -> bool {
        self.routes().takes_some()
    }

    pub(crate) fn routes(&self) -> MutexGuard<'_, Routes> {
        self.routes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What speaks in the name of an agent.
#[derive(Clone)]
pub(crate) struct Voice {
    pub(crate) platform: Arc<Inner>,
    pub(crate) talk: Arc<Talk>,
}

impl Voice {
    /// Sends a message and learns what became of it.
    pub(crate) async fn send(&self, message: Message, timeout: Duration) -> Vec<ReceiverOutcome> {
        let message = self.signed(message);
        if let Err(refused) = self.talk.outgoing(&self.platform, &message) {
            return refused;
        }
        sending::send(&self.platform, &self.talk.room, message, timeout).await
    }

    /// Sends a message of which nobody waits to learn what became.
    pub(crate) fn post(&self, message: Message) {
        let message = self.signed(message);
        if self.talk.outgoing(&self.platform, &message).is_ok() {
            sending::post(&self.platform, message);
        }
    }

    fn signed(&self, mut message: Message) -> Message {
        message
            .sender
            .get_or_insert_with(|| (&self.talk.name).into());
        message
    }
}
