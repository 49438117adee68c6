//! Which ACL message waits for which text message, and the other way round.

use std::collections::HashMap;

use fipa_acl::{Expression, Message, Text};
use robot_text::Message as TextMessage;

/// Subscriptions at most.
const MAX_SUBSCRIPTIONS: usize = 1024;

/// The name of an agent in the fleet with a message to it: both are needed for an answer.
type Asked = (String, Message);

/// Asker, asked and reference of a question.
type Reference = (String, String, String);

#[derive(Debug)]
struct Subscription {
    /// Whose status, by its name on the platform.
    agent: String,
    asked: Asked,
}

/// The open conversations of a gateway.
#[derive(Debug, Default)]
pub(super) struct Conversations {
    /// Requests whose actions wait to be written.
    writes: HashMap<u64, Asked>,
    /// Queries of the fleet.
    queries: HashMap<Reference, Asked>,
    /// Questions of the platform's agents to the fleet, by conversation.
    questions: HashMap<Text, TextMessage>,
    subscriptions: Vec<Subscription>,
    next: u64,
}

impl Conversations {
    /// A request is going to be written.
    pub(super) fn write(&mut self, to: &str, request: Message) -> u64 {
        self.next += 1;
        self.writes.insert(self.next, (to.to_owned(), request));
        self.next
    }

    pub(super) fn written(&mut self, ticket: u64) -> Option<Asked> {
        self.writes.remove(&ticket)
    }

    /// The requests of one of the fleet's agents here that were not written, and will not be.
    pub(super) fn forget_writes(&mut self, to: &str) -> Vec<Message> {
        let lost = self.writes.extract_if(|_, (agent, _)| agent == to);
        lost.map(|(_, (_, request))| request).collect()
    }

    /// One of the fleet asks.
    pub(super) fn ask(&mut self, question: &TextMessage, to: &str, query: Message) {
        self.queries
            .insert(reference_of(question), (to.to_owned(), query));
    }

    /// The query that became this question, which is over.
    pub(super) fn asked(&mut self, question: &TextMessage) -> Option<Asked> {
        self.queries.remove(&reference_of(question))
    }

    /// The query that this answers, which is over.
    pub(super) fn answer_for(&mut self, answer: &TextMessage) -> Option<Asked> {
        let (agent, asker, reference) = reference_of(answer);
        self.queries.remove(&(asker, agent, reference))
    }

    /// Forgets a query of `asker`; its reference.
    pub(super) fn forget_question(
        &mut self,
        asker: &str,
        agent: &str,
        conversation: Option<&Expression>,
    ) -> Option<String> {
        let same = |((known, asked, _), (_, query)): &(&Reference, &Asked)| {
            known == asker && asked == agent && query.conversation_id.as_ref() == conversation
        };
        let key = self.queries.iter().find(same).map(|(key, _)| key.clone())?;
        self.queries.remove(&key);
        Some(key.2)
    }

    /// An agent of the platform asks the fleet; the conversation that begins.
    pub(super) fn asking(&mut self, from: &Text, question: TextMessage) -> Text {
        self.next += 1;
        let conversation = Text::from(format!("{from}-{}", self.next));
        self.questions.insert(conversation.clone(), question);
        conversation
    }

    /// The question of `agent` that a message of the fleet answers, which is over.
    pub(super) fn answered(&mut self, agent: &str, message: &Message) -> Option<TextMessage> {
        let sender = message.sender.as_ref().map(|sender| sender.name.as_str());
        let fits = |question: &TextMessage| {
            question.origin.as_deref() == Some(agent) && question.destination.as_deref() == sender
        };
        let told = message
            .conversation_id
            .as_ref()
            .and_then(Expression::as_str);
        let conversation = match told {
            Some(told) => Text::from(told),
            // Some answer with in-reply-to alone.
            None => {
                let reply = message.in_reply_to.as_ref().and_then(Expression::as_str)?;
                let same = |(_, question): &(&Text, &TextMessage)| {
                    fits(question) && question.reference.as_deref() == Some(reply)
                };
                self.questions.iter().find(same)?.0.clone()
            }
        };
        self.questions.get(&conversation).filter(|q| fits(q))?;
        self.questions.remove(&conversation)
    }

    /// The question that became this query, which is over.
    pub(super) fn question_of(&mut self, query: &Message) -> Option<TextMessage> {
        let conversation = query.conversation_id.as_ref()?.as_str()?;
        self.questions.remove(conversation)
    }

    /// A question to the fleet was given up.
    pub(super) fn forget_asking(&mut self, question: &TextMessage) {
        self.questions.retain(|_, known| known != question);
    }

    /// Whether there was room for one more.
    pub(super) fn subscribe(&mut self, agent: &str, to: &str, subscribe: Message) -> bool {
        let room = self.subscriptions.len() < MAX_SUBSCRIPTIONS;
        if room {
            self.subscriptions.push(Subscription {
                agent: agent.to_owned(),
                asked: (to.to_owned(), subscribe),
            });
        }
        room
    }

    /// Ends a subscription; whether it was the last of this subscriber to this agent.
    pub(super) fn unsubscribe(
        &mut self,
        subscriber: &str,
        agent: &str,
        conversation: Option<&Expression>,
    ) -> Option<bool> {
        let at = self.subscriptions.iter().position(|known| {
            known.is_of(subscriber, agent) && known.asked.1.conversation_id.as_ref() == conversation
        })?;
        self.subscriptions.remove(at);
        let more = |known: &Subscription| known.is_of(subscriber, agent);
        Some(!self.subscriptions.iter().any(more))
    }

    /// The subscriptions of one of the fleet to the status of an agent.
    pub(super) fn subscriptions(&self, subscriber: &str, agent: &str) -> Vec<Asked> {
        self.subscriptions
            .iter()
            .filter(|known| known.is_of(subscriber, agent))
            .map(|known| known.asked.clone())
            .collect()
    }

    /// Ends all subscriptions of one of the fleet; the agents that it had subscribed to.
    pub(super) fn forget_subscriber(&mut self, subscriber: &str) -> Vec<String> {
        let ended = self
            .subscriptions
            .extract_if(.., |known| known.subscriber() == subscriber);
        ended.map(|known| known.agent).collect()
    }

    /// Ends what hangs on an agent of the platform: its questions, and the subscriptions to it,
    /// each with its subscriber.
    pub(super) fn forget_agent(&mut self, agent: &str) -> Vec<(String, String, Message)> {
        self.questions
            .retain(|_, question| question.origin.as_deref() != Some(agent));
        self.subscriptions
            .extract_if(.., |known| known.agent == agent)
            .map(|known| {
                let subscriber = known.subscriber().to_owned();
                (subscriber, known.asked.0, known.asked.1)
            })
            .collect()
    }
}

impl Subscription {
    fn subscriber(&self) -> &str {
        let sender = self.asked.1.sender.as_ref();
        sender
            .map(|sender| sender.name.as_str())
            .unwrap_or_default()
    }

    fn is_of(&self, subscriber: &str, agent: &str) -> bool {
        self.subscriber() == subscriber && self.agent == agent
    }
}

fn reference_of(message: &TextMessage) -> Reference {
    let text = |text: &Option<String>| text.clone().unwrap_or_default();
    (
        text(&message.origin),
        text(&message.destination),
        text(&message.reference),
    )
}
