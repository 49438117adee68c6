//! What an agent asks of others, and how it has its own conversations watched.

use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{Message, Performative};
use fipa_protocol::Library;
use tokio::time::Instant;

use super::exchange::{Exchange, TIME_TO_CANCEL, failure_of};
use super::routes::Heard;
use super::{ConversationError, ConversationEvents, Monitoring, Responder, Violations};
use crate::Agent;

impl Agent {
    /// Has another agent do something, and waits for the end of it: its `inform` (fipa-request,
    /// SC00026H). An `agree` on the way is taken and waited on.
    ///
    /// A missing conversation-id, reply-with, reply-by and protocol are filled in. When the time is
    /// over, or the future is dropped, the other one is sent a `cancel`.
    ///
    /// # Errors
    /// The order did not arrive, was refused, failed or was not understood; there was no result by
    /// the deadline, or the other agent is gone.
    pub async fn perform(
        &self,
        order: Message,
        deadline: Duration,
    ) -> Result<Message, ConversationError> {
        let protocol = match order.performative {
            Performative::RequestWhen => "fipa-request-when",
            _ => "fipa-request",
        };
        self.ask(order, protocol, deadline).await
    }

    /// Asks another agent a question (`query-if` or `query-ref`) and waits for its `inform`
    /// (fipa-query, SC00027H). All else is as with [`perform`](Agent::perform).
    pub async fn query(
        &self,
        question: Message,
        deadline: Duration,
    ) -> Result<Message, ConversationError> {
        self.ask(question, "fipa-query", deadline).await
    }

    /// Proposes something to another agent and waits for its `accept-proposal` (fipa-propose,
    /// SC00036H); a `reject-proposal` is [`ConversationError::Refused`]. All else is as with
    /// [`perform`](Agent::perform).
    pub async fn propose(
        &self,
        proposal: Message,
        deadline: Duration,
    ) -> Result<Message, ConversationError> {
        self.ask(proposal, "fipa-propose", deadline).await
    }

    async fn ask(
        &self,
        opening: Message,
        protocol: &'static str,
        deadline: Duration,
    ) -> Result<Message, ConversationError> {
        let until = Instant::now() + deadline;
        let mut exchange = Exchange::new(self, opening, protocol, deadline + TIME_TO_CANCEL);
        exchange.open(deadline).await?;
        loop {
            let message = match exchange.hear(Some(until)).await? {
                Some(Heard::Said(message)) => message,
                Some(Heard::Gone(name)) => {
                    exchange.all_settled();
                    return Err(ConversationError::PeerLost(name));
                }
                None => return Err(ConversationError::NoAnswer(deadline)),
            };
            if let Some(end) = failure_of(&message) {
                exchange.all_settled();
                return Err(end(message));
            }
            if let Performative::Inform | Performative::AcceptProposal = message.performative {
                exchange.all_settled();
                return Ok(*message);
            }
        }
    }

    /// Begins to describe how this agent answers others.
    pub fn respond(&self) -> Responder<'_> {
        Responder::new(self)
    }

    /// What becomes of messages that violate their interaction protocols. An agent is
    /// [advisory](Monitoring::Advisory) unless told otherwise.
    ///
    /// A message is judged when it is sent, and when it is read.
    pub fn set_monitoring(&self, monitoring: Monitoring) {
        self.talk.watch.set_mode(monitoring);
    }

    /// How messages that violate their protocols are dealt with now.
    pub fn monitoring(&self) -> Monitoring {
        self.talk.watch.mode()
    }

    /// The protocols by which messages are judged, instead of those of FIPA and of the locks.
    /// Conversations that are open are not watched any further.
    pub fn set_protocols(&self, protocols: Arc<Library>) {
        self.talk.watch.set_protocols(protocols);
    }

    /// The messages that violate their protocols, from now on.
    pub fn violations(&self) -> Violations {
        Violations::new(&self.talk)
    }

    /// What happens in the conversations of this agent, from now on: how they begin, move on and
    /// end, and what violates their protocols.
    pub fn conversation_events(&self) -> ConversationEvents {
        ConversationEvents::new(&self.talk)
    }
}
