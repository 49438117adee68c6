use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use fipa_acl::{Expression, Letter, Message, Representation, Text};
use fipa_codec::{Limits, decode_payload};
use fipa_link::ReceiverOutcome;
use fipa_mts::{DeliveryFailure, Urgency};
use tokio::sync::{Notify, mpsc, oneshot};

use crate::conversations::{Talk, Voice};
use crate::locks::{self, Locks};
use crate::platform::Inner;
use crate::{ReceiveError, RequestError, Sending, TrySendError, sending};

/// How long the outcome of a letter is waited for unless another time is given.
pub const DEFAULT_TIMEOUT: Duration = Duration::from_secs(10);

/// An agent that is registered at a platform; dropping it deregisters it, and drops what it has not
/// received. [`leave`](Agent::leave) loses nothing.
///
/// All methods take `&self`, so that an agent can be shared between tasks. What
/// [`request`](Agent::request) waits for does not reach [`receive`](Agent::receive), nor do the
/// messages of its [locks](crate::locks).
pub struct Agent {
    pub(crate) platform: Arc<Inner>,
    pub(crate) name: Text,
    pub(crate) mail: Arc<Notify>,
    pub(crate) inbox: Arc<Mutex<Inbox>>,
    pub(crate) locks: OnceLock<Locks>,
    conversations: AtomicU64,
    registered: AtomicBool,
    pub(crate) talk: Arc<Talk>,
}

/// Letters that are looked through for an answer and kept for `receive`, at most. The others wait in
/// the mailbox.
const LOOKED_THROUGH: usize = 1000;

#[derive(Default)]
pub(crate) struct Inbox {
    /// By urgency.
    messages: [VecDeque<Incoming>; Urgency::COUNT],
    expected: Vec<Expected>,
    /// Where the messages of the agent's locks go, once it has some.
    pub(crate) locks: Option<mpsc::UnboundedSender<Message>>,
}

/// A letter that came, and what its payload says or why that cannot be read.
pub type Incoming = (Letter, Result<Message, String>);

/// An answer that somebody waits for.
struct Expected {
    reply_with: Expression,
    answer: oneshot::Sender<Message>,
}

impl Inbox {
    /// Takes the mail in while there is room, gives the locks and conversations what is theirs, and
    /// sorts the rest. Whether all of the mail was taken in.
    pub(crate) fn take_in(
        &mut self,
        platform: &Inner,
        talk: &Arc<Talk>,
        has_room: impl Fn(&Inbox) -> bool,
    ) -> bool {
        while has_room(self) {
            let taken = platform.backend.with(|_, m, _| m.take_mail(&talk.name));
            let Some(letter) = taken else {
                return true;
            };
            let message = match (read(&letter), &self.locks) {
                // Without their driver the locks have ended.
                (Ok(message), Some(locks)) if locks::takes(&message) => {
                    drop(locks.send(message));
                    continue;
                }
                (Ok(message), _) => match talk.incoming(platform, message) {
                    Some(message) => Ok(message),
                    None => continue,
                },
                (unreadable, _) => unreadable,
            };
            self.sort(letter, message);
        }
        false
    }

    /// Takes a letter in: an answer for whoever waits for it, anything else for `receive`.
    fn sort(&mut self, letter: Letter, message: Result<Message, String>) {
        self.expected
            .retain(|expected| !expected.answer.is_closed());
        let waiting = message.as_ref().ok().and_then(|message| {
            let tag = message.in_reply_to.as_ref()?;
            self.expected.iter().position(|e| e.reply_with == *tag)
        });
        match (waiting, message) {
            (Some(at), Ok(message)) => {
                let expected = self.expected.swap_remove(at);
                if let Err(message) = expected.answer.send(message) {
                    self.keep((letter, Ok(message)));
                }
            }
            (_, message) => self.keep((letter, message)),
        }
    }

    fn keep(&mut self, incoming: Incoming) {
        let urgency = Urgency::of(&incoming.0.envelope).number();
        if let Some(messages) = self.messages.get_mut(urgency) {
            messages.push_back(incoming);
        }
    }

    /// How many messages wait for `receive`.
    pub(crate) fn kept(&self) -> usize {
        self.messages.iter().map(VecDeque::len).sum()
    }

    fn pop(&mut self) -> Option<Incoming> {
        let mut messages = self.messages.iter_mut().rev();
        messages.find_map(VecDeque::pop_front)
    }

    /// Whether another letter is to be looked at: for an answer, or for `receive` to have one.
    fn has_room(&self, others_wait: bool) -> bool {
        let kept = self.kept();
        let waited_for = others_wait || self.expected.iter().any(|e| !e.answer.is_closed());
        kept < if waited_for { LOOKED_THROUGH } else { 1 }
    }
}

impl Agent {
    pub(crate) fn new(platform: Arc<Inner>, name: Text, mail: Arc<Notify>) -> Agent {
        let talk = Talk::new(name.clone(), platform.clock, Arc::clone(&mail));
        Agent {
            platform,
            name,
            mail,
            inbox: Arc::default(),
            locks: OnceLock::new(),
            conversations: AtomicU64::new(0),
            registered: AtomicBool::new(true),
            talk: Arc::new(talk),
        }
    }

    /// The name was never ours: another agent keeps it.
    pub(crate) fn disown(&self) {
        self.registered.store(false, Ordering::Relaxed);
    }

    /// The agent's name.
    pub fn name(&self) -> &Text {
        &self.name
    }

    /// Sends a message and learns what became of it, for each receiver that its names and patterns
    /// resolve to, within 10 s. A missing sender is filled in.
    ///
    /// Where a queue or mailbox on the way is full, or 1024 letters or 64 MiB of this agent are under
    /// way, it waits for room. A user-defined parameter `X-Priority` of the message, from 0, the
    /// usual, to 2, lets the letter pass others that wait.
    ///
    /// When the future is dropped the letter is still under way.
    pub async fn send(&self, message: Message) -> Vec<ReceiverOutcome> {
        self.send_within(message, DEFAULT_TIMEOUT).await
    }

    /// Sends a message and learns what became of it within this time.
    pub async fn send_within(
        &self,
        mut message: Message,
        timeout: Duration,
    ) -> Vec<ReceiverOutcome> {
        message.sender.get_or_insert_with(|| (&self.name).into());
        if let Err(refused) = self.talk.outgoing(&self.platform, &message) {
            return refused;
        }
        sending::send(&self.platform, &self.talk.room, message, timeout).await
    }

    /// Hands a message over without waiting, and says at once when there is no room for it. What
    /// becomes of it can be waited for, 10 s at most. A queue further on that is full refuses it,
    /// unless the platform is a daemon's: that waits for room.
    pub fn try_send(&self, mut message: Message) -> Result<Sending, TrySendError> {
        message.sender.get_or_insert_with(|| (&self.name).into());
        if let Err(refused) = self.talk.outgoing(&self.platform, &message) {
            return Ok(Sending::known(refused));
        }
        sending::try_send(&self.platform, &self.talk.room, message, DEFAULT_TIMEOUT)
    }

    /// The next message. Cancel-safe: nothing is lost when the future is dropped.
    pub async fn receive(&self) -> Result<Message, ReceiveError> {
        let (letter, message) = self.receive_letter().await?;
        message.map_err(|reason| ReceiveError::Unreadable {
            from: match letter.envelope.from() {
                Some(from) => from.name.to_string(),
                None => "somebody".to_owned(),
            },
            reason,
            letter: Box::new(letter),
        })
    }

    /// The next letter, with its message or the reason why that cannot be read. Cancel-safe.
    pub async fn receive_letter(&self) -> Result<Incoming, ReceiveError> {
        loop {
            // Asked for before looking, so that no notice falls between.
            let notified = self.mail.notified();
            tokio::pin!(notified);
            notified.as_mut().enable();
            if let Some(incoming) = self.sort_mail().pop() {
                return Ok(incoming);
            }
            if self.platform.backend.with(|_, _, hub| hub.has_ended()) {
                return Err(ReceiveError::Ended);
            }
            notified.await;
        }
    }

    /// The next message if one is there.
    pub fn try_receive(&self) -> Option<Incoming> {
        self.sort_mail().pop()
    }

    /// Deregisters the agent and hands over what was delivered to it and not received yet, the
    /// oldest first: nothing of that is lost, as it is when the agent is dropped.
    ///
    /// So an agent moves to another platform under its name: it leaves the one and registers at the
    /// other, in this order or the other way round. Letters under way follow it if it is registered
    /// there within a second, not always in the order in which they were sent; the senders of those
    /// that come later are told that it is unknown.
    ///
    /// When the future is dropped, the agent has left all the same and its letters are lost.
    pub async fn leave(self) -> Vec<Incoming> {
        self.disown();
        let name = &self.name;
        let left = self.platform.backend.with(|now, machine, hub| {
            let (ticket, left) = hub.expect_leave();
            machine.leave(now, ticket, name);
            left
        });
        // A platform that has ended has nothing more.
        let letters = left.await.unwrap_or_default();
        self.platform
            .backend
            .with(|_, _, hub| hub.forget_mail(name));
        let mut inbox = self.inbox();
        for letter in letters {
            let message = read(&letter);
            inbox.sort(letter, message);
        }
        std::iter::from_fn(|| inbox.pop()).collect()
    }

    /// Sends a message to one agent and waits for its answer until the deadline.
    ///
    /// A missing conversation-id and reply-with are filled in, and the deadline is told as
    /// reply-by. The answer is the first message whose in-reply-to is that reply-with: agree,
    /// inform, refuse or what the other one finds right. A notice that a message transport service
    /// on the way could not deliver the request ends the waiting.
    pub async fn request(
        &self,
        mut message: Message,
        deadline: Duration,
    ) -> Result<Message, RequestError> {
        let tag = self.tag();
        message.conversation_id.get_or_insert_with(|| tag.clone());
        let reply_with = message.reply_with.get_or_insert(tag).clone();
        let now = self.platform.clock.now();
        message
            .reply_by
            .get_or_insert(fipa_acl::FipaTime::from_unix_millis(
                now.plus(deadline).unix_millis,
            ));
        let (sender, mut answer) = oneshot::channel();
        self.inbox().expected.push(Expected {
            reply_with,
            answer: sender,
        });
        let exchange = async {
            let outcomes = self.send_within(message, deadline).await;
            if let Some(failed) = outcomes.iter().find(|o| !o.outcome.is_success()) {
                return Err(RequestError::Undelivered {
                    to: failed.to.to_string(),
                    outcome: failed.outcome,
                    reason: failed.reason.to_string(),
                });
            }
            let answer = self.wait_for_answer(&mut answer).await?;
            match DeliveryFailure::of(&answer) {
                Some(failure) => Err(RequestError::Returned(Box::new(failure))),
                None => Ok(answer),
            }
        };
        match tokio::time::timeout(deadline, exchange).await {
            Ok(result) => result,
            Err(_) => Err(RequestError::NoAnswer(deadline)),
        }
    }

    async fn wait_for_answer(
        &self,
        answer: &mut oneshot::Receiver<Message>,
    ) -> Result<Message, RequestError> {
        loop {
            let notified = self.mail.notified();
            tokio::pin!(notified);
            notified.as_mut().enable();
            drop(self.sort_mail());
            match answer.try_recv() {
                Ok(message) => return Ok(message),
                Err(oneshot::error::TryRecvError::Closed) => return Err(RequestError::Ended),
                Err(oneshot::error::TryRecvError::Empty) => {}
            }
            if self.platform.backend.with(|_, _, hub| hub.has_ended()) {
                return Err(RequestError::Ended);
            }
            tokio::select! {
                () = notified => {}
                // Another task of this agent may have taken the mail.
                message = &mut *answer => return message.map_err(|_| RequestError::Ended),
            }
        }
    }

    /// A tag for a conversation, unique in the network as long as the agent's name is.
    pub(crate) fn tag(&self) -> Expression {
        let number = self.conversations.fetch_add(1, Ordering::Relaxed);
        let started = self.platform.clock.now().unix_millis;
        Expression::from(format!("{}-{started:x}-{number}", self.name))
    }

    /// Takes the mail in: answers to those who wait for them, the rest for `receive`.
    fn sort_mail(&self) -> MutexGuard<'_, Inbox> {
        let mut inbox = self.inbox();
        let has_room = |inbox: &Inbox| inbox.has_room(self.talk.takes_mail());
        let is_read = inbox.take_in(&self.platform, &self.talk, has_room);
        // Those that went have said what they had to say, or nobody is going to read it.
        if is_read || self.talk.takes_mail() {
            self.talk.mail_is_read(&self.platform);
        }
        inbox
    }

    /// Takes the mail in, for those who wait for their part of it.
    pub(crate) fn take_mail_in(&self) {
        drop(self.sort_mail());
    }

    /// What is notified when mail comes.
    pub(crate) fn mail(&self) -> &Notify {
        &self.mail
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.platform.backend.with(|_, _, hub| hub.has_ended())
    }

    pub(crate) fn voice(&self) -> Voice {
        Voice {
            platform: Arc::clone(&self.platform),
            talk: Arc::clone(&self.talk),
        }
    }

    fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        if self.registered.load(Ordering::Relaxed) {
            let name = &self.name;
            self.platform.backend.with(|now, machine, hub| {
                hub.forget_mail(name);
                machine.deregister(now, name);
            });
        }
    }
}

/// Reads the payload in the representation that the envelope names.
pub(crate) fn read(letter: &Letter) -> Result<Message, String> {
    if let Some(Representation::Other(name)) = letter.envelope.acl_representation() {
        return Err(format!("its representation is {name}"));
    }
    let mut message = decode_payload(&letter.envelope, &letter.payload, &Limits::default())
        .map_err(|error| error.to_string())?;
    // Some platforms write only into the envelope where their agents can be answered.
    if let (Some(sender), Some(from)) = (&mut message.sender, letter.envelope.from())
        && sender.addresses.is_empty()
        && sender.is_same_agent(from)
    {
        sender.addresses.clone_from(&from.addresses);
    }
    Ok(message)
}

#[cfg(test)]
mod tests {
    use fipa_acl::{Envelope, Performative, Slots};
    use fipa_codec::{Output, encode_message};

    use super::*;

    fn letter(representation: Representation, payload: bytes::Bytes) -> Letter {
        let envelope = Envelope::new(Slots {
            acl_representation: Some(representation),
            ..Slots::default()
        });
        Letter { envelope, payload }
    }

    #[test]
    fn every_representation_is_read() {
        let message = Message::new(Performative::Inform).to("b@h").content("hi");
        for representation in [
            Representation::BitEfficient,
            Representation::String,
            Representation::Xml,
        ] {
            let mut payload = Output::new();
            encode_message(&representation, &message, &mut payload).unwrap();
            let letter = letter(representation, payload.take_bytes());
            assert_eq!(read(&letter), Ok(message.clone()));
        }
        let unknown = letter(Representation::Other("x.y".into()), "(inform)".into());
        assert_eq!(read(&unknown), Err("its representation is x.y".to_owned()));
    }
}
