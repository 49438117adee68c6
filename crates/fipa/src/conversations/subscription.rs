use std::time::Duration;

use fipa_acl::{Message, Performative};
use tokio::time::Instant;

use super::ConversationError;
use super::exchange::{Exchange, TIME_TO_CANCEL, failure_of};
use super::routes::Heard;
use crate::Agent;

/// What another agent tells about what was subscribed to. Dropping it cancels the subscription.
pub struct Subscription<'a> {
    exchange: Exchange<'a>,
    first: Option<Message>,
    is_over: bool,
}

impl Agent {
    /// Subscribes at another agent and waits until it has agreed or told the first news
    /// (fipa-subscribe, SC00035H).
    ///
    /// A missing conversation-id, reply-with, reply-by and protocol are filled in. When the future
    /// is dropped, the other one is sent a `cancel`.
    ///
    /// # Errors
    /// As with [`perform`](Agent::perform).
    pub async fn subscribe(
        &self,
        subscription: Message,
        deadline: Duration,
    ) -> Result<Subscription<'_>, ConversationError> {
        let until = Instant::now() + deadline;
        let mut exchange = Exchange::new(
            self,
            subscription,
            "fipa-subscribe",
            deadline + TIME_TO_CANCEL,
        );
        exchange.open(deadline).await?;
        let mut subscription = Subscription {
            exchange,
            first: None,
            is_over: false,
        };
        match subscription.hear(Some(until)).await? {
            Some(message) => {
                subscription.first = Some(message).filter(is_news);
                Ok(subscription)
            }
            None => Err(ConversationError::NoAnswer(deadline)),
        }
    }
}

fn is_news(message: &Message) -> bool {
    message.performative == Performative::Inform
}

impl Subscription<'_> {
    /// The next news. An error is the last thing that comes, then there is `None`. Cancel-safe.
    pub async fn next(&mut self) -> Option<Result<Message, ConversationError>> {
        if let Some(first) = self.first.take() {
            return Some(Ok(first));
        }
        while !self.is_over {
            match self.hear(None).await {
                Ok(Some(message)) if is_news(&message) => return Some(Ok(message)),
                Ok(_) => {}
                Err(error) => return Some(Err(error)),
            }
        }
        None
    }

    /// Cancels the subscription and waits until that is confirmed. News that cross the cancel are
    /// lost.
    ///
    /// # Errors
    /// The cancel did not arrive, the other one could not cancel or gave no answer. It sends
    /// nothing that anybody would take any more, whatever the error.
    pub async fn cancel(mut self, deadline: Duration) -> Result<(), ConversationError> {
        if self.is_over {
            return Ok(());
        }
        let until = Instant::now() + deadline;
        let cancel = self.exchange.cancel();
        let tag = cancel.reply_with.clone();
        let sent = self.exchange.send(cancel, deadline).await;
        self.exchange.break_off();
        sent?;
        loop {
            match self.hear(Some(until)).await? {
                Some(answer) if answer.in_reply_to == tag => return Ok(()),
                Some(_) => {}
                None => return Err(ConversationError::NoAnswer(deadline)),
            }
        }
    }

    async fn hear(&mut self, until: Option<Instant>) -> Result<Option<Message>, ConversationError> {
        let error = match self.exchange.hear(until).await {
            Ok(None) => return Ok(None),
            Ok(Some(Heard::Said(message))) => match failure_of(&message) {
                None => return Ok(Some(*message)),
                Some(end) => end(message),
            },
            Ok(Some(Heard::Gone(name))) => ConversationError::PeerLost(name),
            Err(error) => error,
        };
        self.is_over = true;
        self.exchange.all_settled();
        Err(error)
    }
}
