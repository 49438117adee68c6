//! Agents that speak the text format.

mod conversations;

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use fipa_acl::{Message, Performative, Text};
use robot_text::{
    DeclareError, Kind, Message as TextMessage, Output, PLATFORM, Place, Platform, PlatformConfig,
    StreamId,
};

use self::conversations::Conversations;

/// What a gateway wants done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TextOutput {
    /// An agent of this name is there.
    Register(Text),
    /// It is not there any more.
    Deregister(Text),
    /// Send this message; its sender is an agent of the gateway.
    Send(Box<Message>),
    /// Write this there; if there is a ticket, say by [`TextGateway::written`] how it went.
    Write {
        /// Where.
        to: Place,
        /// What.
        message: TextMessage,
        /// The number to answer with.
        ticket: Option<u64>,
    },
}

/// The agents of a text platform, and the fleet that they talk to.
///
/// The agent `drive` is `drive@robot1` in the fleet. To an agent a request is an action, a query a
/// question, a subscription nothing until its status comes; from an agent it is the other way
/// round. An action is not acknowledged: the request is agreed to and answered with an inform
/// `sent` once it is written.
#[derive(Debug)]
pub struct TextGateway {
    robot: Text,
    platform: Platform,
    /// Agents that are in the fleet for good, by their names on the platform.
    configured: BTreeSet<String>,
    conversations: Conversations,
    outputs: VecDeque<TextOutput>,
}

impl TextGateway {
    /// A gateway without agents; `robot` is what stands behind the @ of their names.
    pub fn new(robot: impl Into<Text>, config: PlatformConfig) -> TextGateway {
        TextGateway {
            robot: robot.into(),
            platform: Platform::new(config),
            configured: BTreeSet::new(),
            conversations: Conversations::default(),
            outputs: VecDeque::new(),
        }
    }

    /// An agent is in the fleet for good, wherever it is now. While it is nowhere, what the fleet
    /// asks of it fails.
    pub fn configure(&mut self, name: &str) {
        if self.configured.insert(name.to_owned()) && self.platform.get(name).is_none() {
            let name = self.fleet_name(name);
            self.outputs.push_back(TextOutput::Register(name));
        }
    }

    /// An agent is at this place, before it says so itself.
    ///
    /// # Errors
    /// A name that is none, or one that is there at another place.
    pub fn declare_at(&mut self, name: &str, place: Place) -> Result<(), DeclareError> {
        let declared = self.platform.declare_at(name, place);
        self.settle();
        declared
    }

    /// A text message came from a place; `fleet` says who is an agent of the directory.
    pub fn received(
        &mut self,
        now: Duration,
        from: Place,
        message: TextMessage,
        fleet: impl Fn(&str) -> bool,
    ) {
        self.platform.received(now, from, message, fleet);
        self.settle();
    }

    /// A message came for the agent that the fleet knows by this name.
    pub fn deliver(&mut self, now: Duration, to: &str, message: &Message) {
        let Some(agent) = self.local_name(to).map(str::to_owned) else {
            self.reply(
                to,
                message,
                Performative::Refuse,
                "it is no agent of the text platform",
            );
            return;
        };
        match &message.performative {
            Performative::Request => self.request(to, &agent, message),
            Performative::QueryRef | Performative::QueryIf => {
                self.query(now, to, &agent, message);
            }
            Performative::Subscribe => self.subscribe(to, &agent, message),
            Performative::Cancel => self.cancel(to, &agent, message),
            Performative::Inform => self.inform(now, to, &agent, message),
            Performative::Failure | Performative::Refuse | Performative::NotUnderstood => {
                if let Some(question) = self.conversations.answered(&agent, message) {
                    let reason = message.content_str().unwrap_or_default();
                    let text = format!("ERROR {} {reason}", message.performative.as_str());
                    self.answer(now, &question, &text);
                }
            }
            // What follows it is the answer.
            Performative::Agree => {}
            _ => self.reply(
                to,
                message,
                Performative::NotUnderstood,
                "the text format knows request, query-if, query-ref, inform, subscribe and cancel",
            ),
        }
        self.settle();
    }

    /// How the write with this ticket went.
    pub fn written(&mut self, ticket: u64, result: Result<(), &str>) {
        if let Some((to, message)) = self.conversations.written(ticket) {
            match result {
                Ok(()) => self.reply(&to, &message, Performative::Inform, "sent"),
                Err(reason) => self.reply(&to, &message, Performative::Failure, reason),
            }
        }
    }

    /// A message of the gateway did not reach whom it was for.
    pub fn undelivered(&mut self, now: Duration, message: &Message, reason: &str) {
        if let Some(question) = self.conversations.question_of(message) {
            self.answer(now, &question, &format!("ERROR {reason}"));
            self.settle();
        }
    }

    /// A stream has ended.
    pub fn stream_closed(&mut self, stream: StreamId) {
        self.platform.stream_closed(stream);
        self.settle();
    }

    /// An agent of the fleet is gone, and with it what it asked for.
    pub fn agent_gone(&mut self, name: &str) {
        for agent in self.conversations.forget_subscriber(name) {
            self.platform.unsubscribe(name, &agent);
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called.
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.platform.poll_timeout()
    }

    /// The time has come.
    pub fn handle_timeout(&mut self, now: Duration) {
        self.platform.handle_timeout(now);
        self.settle();
    }

    /// What is to be done next.
    pub fn poll_output(&mut self) -> Option<TextOutput> {
        self.outputs.pop_front()
    }

    fn request(&mut self, to: &str, agent: &str, message: &Message) {
        let Some(action) = self.text_of(to, agent, message, Kind::Action) else {
            return;
        };
        let Some(place) = self.platform.get(agent) else {
            self.reply(to, message, Performative::Failure, GONE);
            return;
        };
        self.reply(to, message, Performative::Agree, "");
        let ticket = self.conversations.write(to, message.clone());
        self.outputs.push_back(TextOutput::Write {
            to: place,
            message: action,
            ticket: Some(ticket),
        });
    }

    fn query(&mut self, now: Duration, to: &str, agent: &str, message: &Message) {
        let Some(mut question) = self.text_of(to, agent, message, Kind::Question) else {
            return;
        };
        let Some(asker) = question.origin.clone() else {
            return;
        };
        if self.platform.get(agent).is_none() {
            self.reply(to, message, Performative::Failure, GONE);
            return;
        }
        let reference = self.platform.free_reference(&asker, agent);
        question.reference = Some(reference);
        if self.platform.send(now, question.clone()) {
            self.conversations.ask(&question, to, message.clone());
        } else {
            self.reply(
                to,
                message,
                Performative::Refuse,
                "too many questions are open",
            );
        }
    }

    fn subscribe(&mut self, to: &str, agent: &str, message: &Message) {
        let Some(subscriber) = sender(message) else {
            return;
        };
        if !self.conversations.subscribe(agent, to, message.clone()) {
            self.reply(
                to,
                message,
                Performative::Refuse,
                "there are too many subscriptions",
            );
            return;
        }
        self.platform.subscribe(subscriber, agent);
        self.reply(to, message, Performative::Agree, "");
    }

    /// Ends a subscription, or forgets a question.
    fn cancel(&mut self, to: &str, agent: &str, message: &Message) {
        let Some(sender) = sender(message) else {
            return;
        };
        let conversation = message.conversation_id.as_ref();
        let cancelled = if let Some(reference) =
            self.conversations
                .forget_question(sender, agent, conversation)
        {
            self.platform.forget_question(sender, agent, &reference);
            true
        } else if let Some(last) = self.conversations.unsubscribe(sender, agent, conversation) {
            if last {
                self.platform.unsubscribe(sender, agent);
            }
            true
        } else {
            false
        };
        match cancelled {
            true => self.reply(to, message, Performative::Inform, "cancelled"),
            false => self.reply(to, message, Performative::Failure, "nothing to cancel"),
        }
    }

    /// The answer to a question of the agent, or else something for it to do.
    fn inform(&mut self, now: Duration, to: &str, agent: &str, message: &Message) {
        if let Some(question) = self.conversations.answered(agent, message) {
            match message.content_str() {
                Some(text) if question.answer(text).to_text().is_ok() => {
                    self.answer(now, &question, text);
                }
                _ => {
                    self.answer(now, &question, "ERROR the answer cannot be written");
                    self.reply(to, message, Performative::NotUnderstood, UNWRITABLE);
                }
            }
            return;
        }
        let action = self.text_of(to, agent, message, Kind::Action);
        match (action, self.platform.get(agent)) {
            (Some(message), Some(place)) => self.outputs.push_back(TextOutput::Write {
                to: place,
                message,
                ticket: None,
            }),
            (Some(_), None) => {
                self.reply(to, message, Performative::Failure, GONE);
            }
            (None, _) => {}
        }
    }

    /// Hands the fleet's answer to the agent that asked; an overlong reason is cut.
    fn answer(&mut self, now: Duration, question: &TextMessage, text: &str) {
        let mut text: String = text
            .chars()
            .map(|c| match c {
                ' '..='~' if !matches!(c, '{' | '}' | ';') => c,
                _ => ' ',
            })
            .collect();
        loop {
            let answer = question.answer(text.trim());
            if answer.to_text().is_ok() || text.is_empty() {
                self.platform.send(now, answer);
                return;
            }
            text.truncate(text.len() / 2);
        }
    }

    /// Does what the platform wants done.
    fn settle(&mut self) {
        while let Some(output) = self.platform.poll_output() {
            match output {
                Output::Send { to, message } => self.outputs.push_back(TextOutput::Write {
                    to,
                    message,
                    ticket: None,
                }),
                Output::Fleet { to, message } => self.tell_fleet(&to, message),
                Output::Declared(name) => {
                    if !self.configured.contains(&name) {
                        let name = self.fleet_name(&name);
                        self.outputs.push_back(TextOutput::Register(name));
                    }
                }
                Output::Gone(name) => self.gone(&name),
                Output::Unanswered { question, reason } => {
                    if let Some((to, query)) = self.conversations.asked(&question) {
                        self.reply(&to, &query, Performative::Failure, &reason.to_string());
                    } else {
                        self.conversations.forget_asking(&question);
                    }
                }
            }
        }
    }

    /// What an agent of the platform says to one of the fleet.
    fn tell_fleet(&mut self, to: &str, text: TextMessage) {
        let content = text.text().as_bytes().to_vec();
        let origin = text.origin.clone().unwrap_or_else(|| PLATFORM.to_owned());
        let from = self.fleet_name(&origin);
        match text.kind() {
            Kind::Action => {
                let request = Message::new(Performative::Request).to(to).content(content);
                self.send(&from, request);
            }
            Kind::Question => {
                let mut query = Message::new(Performative::QueryRef).to(to).content(content);
                if let Some(reference) = &text.reference {
                    query = query.reply_with(reference.as_str());
                }
                let id = self.conversations.asking(&from, text);
                self.send(&from, query.conversation_id(id));
            }
            Kind::Answer => {
                if let Some((asked, query)) = self.conversations.answer_for(&text) {
                    self.reply(&asked, &query, Performative::Inform, text.text());
                }
            }
            Kind::Status => {
                for (agent, subscription) in self.conversations.subscriptions(to, &origin) {
                    self.reply(&agent, &subscription, Performative::Inform, text.text());
                }
            }
        }
    }

    fn gone(&mut self, name: &str) {
        let fleet_name = self.fleet_name(name);
        for request in self.conversations.forget_writes(&fleet_name) {
            self.reply(&fleet_name, &request, Performative::Failure, GONE);
        }
        for (subscriber, agent, subscription) in self.conversations.forget_agent(name) {
            self.platform.unsubscribe(&subscriber, name);
            self.reply(&agent, &subscription, Performative::Failure, GONE);
        }
        if !self.configured.contains(name) {
            self.outputs.push_back(TextOutput::Deregister(fleet_name));
        }
    }

    /// The text message for an ACL message, if it can be written; else its sender is told.
    fn text_of(
        &mut self,
        to: &str,
        agent: &str,
        message: &Message,
        kind: Kind,
    ) -> Option<TextMessage> {
        let text = message.content_str().map(|content| TextMessage {
            origin: sender(message).map(str::to_owned),
            ..TextMessage::new(kind, content).to(agent)
        });
        let writable = text.filter(|text| {
            // Room for the reference that a question gets.
            let longest = text.clone().reference("4294967295");
            longest.to_text().is_ok()
        });
        if writable.is_none() {
            self.reply(to, message, Performative::NotUnderstood, UNWRITABLE);
        }
        writable
    }

    /// Answers for the agent that the fleet knows as `from`. What cannot be answered is not.
    fn reply(&mut self, from: &str, message: &Message, performative: Performative, content: &str) {
        let mut reply = message.reply(performative);
        if reply.receiver.is_empty() {
            return;
        }
        if !content.is_empty() {
            reply = reply.content(content.as_bytes().to_vec());
        }
        self.send(from, reply);
    }

    fn send(&mut self, from: &str, message: Message) {
        let message = message.from_agent(from);
        self.outputs.push_back(TextOutput::Send(Box::new(message)));
    }

    fn fleet_name(&self, name: &str) -> Text {
        Text::from(format!("{name}@{}", self.robot))
    }

    fn local_name<'a>(&self, name: &'a str) -> Option<&'a str> {
        name.strip_suffix(self.robot.as_str())?.strip_suffix('@')
    }
}

const GONE: &str = "the agent is gone";

const UNWRITABLE: &str =
    "the text format has printable ASCII without { } ; and 1024 octets in a message";

fn sender(message: &Message) -> Option<&str> {
    message.sender.as_ref().map(|sender| sender.name.as_str())
}
