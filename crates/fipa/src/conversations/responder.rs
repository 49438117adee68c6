//! How an agent answers others: a handler for each act that opens a conversation.

use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};

use bytes::Bytes;
use fipa_acl::{Expression, Message, Performative};
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::task::JoinSet;

use super::routes::{Opened, Stop, key};
use super::{ConversationError, Voice};
use crate::{Agent, DEFAULT_TIMEOUT};

type Outcome = Result<Answer, ConversationError>;
type Handler = Arc<dyn Fn(Order) -> Pin<Box<dyn Future<Output = Outcome> + Send>> + Send + Sync>;

/// The last word of a handler.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer(Option<(Performative, Option<Bytes>)>);

impl Answer {
    /// It is done, or this is so.
    pub fn inform(content: impl Into<Bytes>) -> Answer {
        Answer(Some((Performative::Inform, Some(content.into()))))
    }

    /// It will not be done, for this reason.
    pub fn refuse(reason: impl Into<Bytes>) -> Answer {
        Answer(Some((Performative::Refuse, Some(reason.into()))))
    }

    /// It could not be done, for this reason.
    pub fn failure(reason: impl Into<Bytes>) -> Answer {
        Answer(Some((Performative::Failure, Some(reason.into()))))
    }

    /// It was not understood, for this reason.
    pub fn not_understood(reason: impl Into<Bytes>) -> Answer {
        Answer(Some((Performative::NotUnderstood, Some(reason.into()))))
    }

    /// A proposal of the other agent is accepted (fipa-propose).
    pub fn accept() -> Answer {
        Answer(Some((Performative::AcceptProposal, None)))
    }

    /// A proposal of the other agent is rejected (fipa-propose), for this reason.
    pub fn reject(reason: impl Into<Bytes>) -> Answer {
        Answer(Some((Performative::RejectProposal, Some(reason.into()))))
    }

    /// Nothing more is to be said.
    pub fn nothing() -> Answer {
        Answer(None)
    }
}

/// How an agent answers others, being described.
///
/// Each handler runs as a task of its own, so that a long action holds up nobody. When the
/// initiator cancels, the handler is dropped where it waits, and the cancel is answered; when the
/// initiator is gone, it is dropped as well. Messages without a handler are left for
/// [`receive`](Agent::receive).
///
/// ```
/// # async fn example() -> Result<(), Box<dyn std::error::Error>> {
/// use fipa::prelude::*;
/// use fipa::Answer;
/// use std::time::Duration;
///
/// let robot1 = Platform::builder().name("robot1").mdns(false).start().await?;
/// let arm = robot1.agent("arm@robot1").await?;
/// let drive = robot1.agent("drive@robot1").await?;
///
/// tokio::spawn(async move {
///     let request = |order: fipa::Order| async move {
///         order.agree().await?;
///         Ok(Answer::inform("at the dock"))
///     };
///     drive.respond().request(request).run().await
/// });
///
/// let order = Message::new(Performative::Request).to("drive@robot1").content("go to the dock");
/// let result = arm.perform(order, Duration::from_secs(5)).await?;
/// assert_eq!(result.content_str(), Some("at the dock"));
/// # Ok(()) }
/// # tokio::runtime::Runtime::new().unwrap().block_on(example()).unwrap();
/// ```
pub struct Responder<'a> {
    agent: &'a Agent,
    handlers: Vec<(Vec<Performative>, Handler)>,
}

impl<'a> Responder<'a> {
    pub(crate) fn new(agent: &'a Agent) -> Responder<'a> {
        Responder {
            agent,
            handlers: Vec::new(),
        }
    }

    /// Handles `request` (fipa-request).
    #[must_use]
    pub fn request<F, R>(self, handler: F) -> Responder<'a>
    where
        F: Fn(Order) -> R + Send + Sync + 'static,
        R: Future<Output = Outcome> + Send + 'static,
    {
        self.on([Performative::Request], handler)
    }

    /// Handles `query-if` and `query-ref` (fipa-query).
    #[must_use]
    pub fn query<F, R>(self, handler: F) -> Responder<'a>
    where
        F: Fn(Order) -> R + Send + Sync + 'static,
        R: Future<Output = Outcome> + Send + 'static,
    {
        self.on([Performative::QueryIf, Performative::QueryRef], handler)
    }

    /// Handles `subscribe` (fipa-subscribe): the handler [informs](Order::inform) as long as it
    /// runs.
    #[must_use]
    pub fn subscribe<F, R>(self, handler: F) -> Responder<'a>
    where
        F: Fn(Order) -> R + Send + Sync + 'static,
        R: Future<Output = Outcome> + Send + 'static,
    {
        self.on([Performative::Subscribe], handler)
    }

    /// Handles `cfp` (fipa-contract-net): the handler refuses, or [proposes](Order::propose).
    #[must_use]
    pub fn call<F, R>(self, handler: F) -> Responder<'a>
    where
        F: Fn(Order) -> R + Send + Sync + 'static,
        R: Future<Output = Outcome> + Send + 'static,
    {
        self.on([Performative::Cfp], handler)
    }

    /// Handles `propose` (fipa-propose).
    #[must_use]
    pub fn proposal<F, R>(self, handler: F) -> Responder<'a>
    where
        F: Fn(Order) -> R + Send + Sync + 'static,
        R: Future<Output = Outcome> + Send + 'static,
    {
        self.on([Performative::Propose], handler)
    }

    fn on<F, R, const N: usize>(mut self, acts: [Performative; N], handler: F) -> Responder<'a>
    where
        F: Fn(Order) -> R + Send + Sync + 'static,
        R: Future<Output = Outcome> + Send + 'static,
    {
        let handler: Handler = Arc::new(move |order| Box::pin(handler(order)));
        self.handlers.push((acts.into(), handler));
        self
    }

    /// Answers until the platform has ended. When the future is dropped, so are the handlers.
    pub async fn run(self) {
        let acts = self.handlers.iter().flat_map(|(acts, _)| acts.clone());
        let (id, mut opened) = self.agent.talk.routes().serve(acts.collect());
        let _service = Service {
            agent: self.agent,
            id,
        };
        let mut running = JoinSet::new();
        loop {
            let notified = self.agent.mail().notified();
            tokio::pin!(notified);
            notified.as_mut().enable();
            self.agent.take_mail_in();
            while let Ok(opened) = opened.try_recv() {
                self.start(opened, &mut running);
            }
            if self.agent.has_ended() {
                return;
            }
            tokio::select! {
                () = notified => {}
                // Another task of this agent may have taken the mail.
                Some(opened) = opened.recv() => self.start(opened, &mut running),
                Some(ended) = running.join_next() => {
                    if let Err(error) = ended {
                        tracing::error!("{}: a handler failed: {error}", self.agent.name());
                    }
                }
            }
        }
    }

    fn start(&self, opened: Opened, running: &mut JoinSet<()>) {
        let act = &opened.message.performative;
        let found = self.handlers.iter().find(|(acts, _)| acts.contains(act));
        if let Some((_, handler)) = found {
            running.spawn(handle(self.agent.voice(), Arc::clone(handler), opened));
        }
    }
}

/// A responder that runs.
struct Service<'a> {
    agent: &'a Agent,
    id: u64,
}

impl Drop for Service<'_> {
    fn drop(&mut self) {
        self.agent.talk.routes().end_service(self.id);
    }
}

/// A conversation that is being answered.
struct Conversation {
    voice: Voice,
    opening: Message,
}

impl Drop for Conversation {
    fn drop(&mut self) {
        if let Some(key) = key(&self.opening) {
            self.voice.talk.routes().forget_answering(&key);
        }
    }
}

async fn handle(voice: Voice, handler: Handler, opened: Opened) {
    let Opened {
        message,
        said,
        mut stop,
    } = opened;
    let conversation = Conversation {
        voice: voice.clone(),
        opening: message.clone(),
    };
    let tag = Arc::new(Mutex::new(message.reply_with.clone()));
    let order = Order {
        message,
        voice: voice.clone(),
        said,
        tag: Arc::clone(&tag),
    };
    let reply = tokio::select! {
        biased;
        Some(stop) = stop.recv() => match stop {
            Stop::InitiatorGone => None,
            Stop::Cancelled(cancel) => {
                let mut reply = cancel.reply(Performative::Inform);
                reply.content.clone_from(&cancel.content);
                Some(reply)
            }
        },
        outcome = handler(order) => match outcome {
            Ok(Answer(answer)) => answer.map(|(act, content)| {
                let mut reply = conversation.opening.reply(act);
                let mut tag = tag.lock().unwrap_or_else(PoisonError::into_inner);
                reply.in_reply_to = tag.take();
                reply.content = content;
                reply
            }),
            Err(error) => {
                tracing::warn!("{}: a conversation ended: {error}", voice.talk.name);
                None
            }
        },
    };
    // The initiator may open the next conversation under this id as soon as it has the last word.
    drop(conversation);
    if let Some(reply) = reply {
        let outcomes = voice.send(reply, DEFAULT_TIMEOUT).await;
        if let Some(error) = ConversationError::undelivered(&outcomes) {
            tracing::warn!("{}: the last word did not arrive: {error}", voice.talk.name);
        }
    }
}

/// What another agent asks for, with the conversation about it.
pub struct Order {
    message: Message,
    voice: Voice,
    said: UnboundedReceiver<Message>,
    /// What the next answer is tagged with.
    tag: Arc<Mutex<Option<Expression>>>,
}

impl Order {
    /// The message that opened the conversation.
    pub fn message(&self) -> &Message {
        &self.message
    }

    /// Tells the other agent that it will be done, and how that ended later.
    ///
    /// # Errors
    /// The message did not arrive.
    pub async fn agree(&self) -> Result<(), ConversationError> {
        let agree = self.message.reply(Performative::Agree);
        self.say(agree).await
    }

    /// Tells a subscriber the news.
    ///
    /// # Errors
    /// The message did not arrive.
    pub async fn inform(&self, content: impl Into<Bytes>) -> Result<(), ConversationError> {
        let inform = self.message.reply(Performative::Inform);
        self.say(inform.content(content)).await
    }

    /// Makes a proposal, and waits for the decision: the `accept-proposal`, or `None` for a
    /// `reject-proposal`, after which [nothing](Answer::nothing) more is to be said.
    ///
    /// # Errors
    /// The proposal did not arrive, or the platform has ended.
    pub async fn propose(
        &mut self,
        content: impl Into<Bytes>,
    ) -> Result<Option<Message>, ConversationError> {
        let proposal = self.message.reply(Performative::Propose).content(content);
        self.say(proposal).await?;
        loop {
            let Some(decision) = self.said.recv().await else {
                return Err(ConversationError::Ended);
            };
            match decision.performative {
                Performative::AcceptProposal => {
                    let mut tag = self.tag.lock().unwrap_or_else(PoisonError::into_inner);
                    tag.clone_from(&decision.reply_with);
                    drop(tag);
                    return Ok(Some(decision));
                }
                Performative::RejectProposal => return Ok(None),
                _ => {}
            }
        }
    }

    async fn say(&self, message: Message) -> Result<(), ConversationError> {
        let outcomes = self.voice.send(message, DEFAULT_TIMEOUT).await;
        match ConversationError::undelivered(&outcomes) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}
