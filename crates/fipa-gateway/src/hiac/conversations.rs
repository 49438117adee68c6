//! Which ACL message waits for which packet, and the other way round.

use std::collections::HashMap;
use std::time::Duration;

use fipa_acl::{Expression, Message, Text};
use hiac::Address;
use hiac::station::{Sender, Ticket};

/// Subscriptions at most, and open questions of devices.
const MAX_SUBSCRIPTIONS: usize = 1024;
const MAX_QUESTIONS: usize = 1024;

/// The name of a device in the fleet with a message to it: both are needed for an answer.
pub(super) type Asked = (String, Message);

/// A question of a device to the fleet.
#[derive(Debug)]
struct Question {
    device: Text,
    agent: Text,
    asker: (Sender, u8),
    expires: Duration,
}

/// What a cancel has ended.
pub(super) enum Cancelled {
    Query(Ticket),
    Subscription,
    Nothing,
}

/// The open conversations of a gateway.
#[derive(Debug, Default)]
pub(super) struct Conversations {
    requests: HashMap<Ticket, Asked>,
    queries: HashMap<Ticket, Asked>,
    informs: HashMap<Ticket, Asked>,
    subscriptions: Vec<(Address, Asked)>,
    questions: HashMap<Text, Question>,
    last: u64,
}

impl Conversations {
    pub(super) fn begin_request(&mut self, ticket: Ticket, to: &str, message: &Message) {
        self.requests.insert(ticket, asked(to, message));
    }

    pub(super) fn begin_query(&mut self, ticket: Ticket, to: &str, message: &Message) {
        self.queries.insert(ticket, asked(to, message));
    }

    pub(super) fn begin_inform(&mut self, ticket: Ticket, to: &str, message: &Message) {
        self.informs.insert(ticket, asked(to, message));
    }

    pub(super) fn request(&self, ticket: Ticket) -> Option<&Asked> {
        self.requests.get(&ticket)
    }

    /// The request that is done.
    pub(super) fn requested(&mut self, ticket: Ticket) -> Option<Asked> {
        self.informs.remove(&ticket);
        self.requests.remove(&ticket)
    }

    /// The query that is answered.
    pub(super) fn queried(&mut self, ticket: Ticket) -> Option<Asked> {
        self.queries.remove(&ticket)
    }

    /// What has failed.
    pub(super) fn ended(&mut self, ticket: Ticket) -> Option<Asked> {
        let request = self.requests.remove(&ticket);
        let query = request.or_else(|| self.queries.remove(&ticket));
        query.or_else(|| self.informs.remove(&ticket))
    }

    /// Whether there was room.
    pub(super) fn subscribe(&mut self, device: Address, to: &str, message: &Message) -> bool {
        let room = self.subscriptions.len() < MAX_SUBSCRIPTIONS;
        if room {
            self.subscriptions.push((device, asked(to, message)));
        }
        room
    }

    pub(super) fn subscriptions(&self, device: Address) -> Vec<Asked> {
        let own = self.subscriptions.iter().filter(|(to, _)| *to == device);
        own.map(|(_, asked)| asked.clone()).collect()
    }

    pub(super) fn unsubscribe_all(&mut self, device: Address) -> Vec<Asked> {
        let gone = self.subscriptions.extract_if(.., |(to, _)| *to == device);
        gone.map(|(_, asked)| asked).collect()
    }

    pub(super) fn forget_subscriber(&mut self, name: &str) {
        self.subscriptions
            .retain(|(_, (_, message))| sender(message) != Some(name));
    }

    pub(super) fn moved(&mut self, old: Address, new: Address) {
        for (device, _) in &mut self.subscriptions {
            if *device == old {
                *device = new;
            }
        }
    }

    pub(super) fn cancel(&mut self, to: &str, cancel: &Message) -> Cancelled {
        let same = |(asked, message): &Asked| {
            asked == to
                && sender(message) == sender(cancel)
                && message.conversation_id == cancel.conversation_id
        };
        let mut queries = self.queries.iter();
        let query = queries.find(|(_, asked)| same(asked));
        if let Some(ticket) = query.map(|(ticket, _)| *ticket) {
            self.queries.remove(&ticket);
            return Cancelled::Query(ticket);
        }
        let before = self.subscriptions.len();
        self.subscriptions.retain(|(_, asked)| !same(asked));
        match self.subscriptions.len() < before {
            true => Cancelled::Subscription,
            false => Cancelled::Nothing,
        }
    }

    /// A device asks an agent; the conversation that begins.
    pub(super) fn asking(
        &mut self,
        device: &Text,
        agent: Text,
        asker: (Sender, u8),
        expires: Duration,
    ) -> Text {
        self.last += 1;
        let id = Text::from(format!("{device}-{}", self.last));
        if self.questions.len() < MAX_QUESTIONS {
            let question = Question {
                device: device.clone(),
                agent,
                asker,
                expires,
            };
            self.questions.insert(id.clone(), question);
        }
        id
    }

    /// The question that a message to the device answers, which is over.
    pub(super) fn answered(&mut self, to: &str, message: &Message) -> Option<(Sender, u8)> {
        let id = conversation(message)?;
        let question = self.questions.get(&id)?;
        let fits =
            question.device.as_str() == to && sender(message) == Some(question.agent.as_str());
        fits.then(|| self.questions.remove(&id))
            .flatten()
            .map(|question| question.asker)
    }

    /// The question that a message of the device was, which is over.
    pub(super) fn question_of(&mut self, message: &Message) -> Option<(Sender, u8)> {
        let question = self.questions.remove(&conversation(message)?)?;
        Some(question.asker)
    }

    pub(super) fn forget_asker(&mut self, device: Address) {
        self.questions
            .retain(|_, question| question.asker.0.address != device);
    }

    pub(super) fn next_expiry(&self) -> Option<Duration> {
        self.questions
            .values()
            .map(|question| question.expires)
            .min()
    }

    pub(super) fn expire(&mut self, now: Duration) -> Vec<(Sender, u8)> {
        let late = self
            .questions
            .extract_if(|_, question| question.expires <= now);
        late.map(|(_, question)| question.asker).collect()
    }
}

fn asked(to: &str, message: &Message) -> Asked {
    (to.to_owned(), message.clone())
}

fn sender(message: &Message) -> Option<&str> {
    message.sender.as_ref().map(|sender| sender.name.as_str())
}

fn conversation(message: &Message) -> Option<Text> {
    let id = message
        .conversation_id
        .as_ref()
        .and_then(Expression::as_str)?;
    Some(Text::from(id))
}
