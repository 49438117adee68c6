//! The platform: where each agent is, who subscribed to whom, and which questions are open.

mod agents;
mod questions;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use self::agents::Agents;
pub use self::agents::{DeclareError, Place, StreamId, is_name};
use self::questions::Questions;
pub use self::questions::Unanswered;
use crate::{Kind, Message};

/// The name under which the platform itself is asked.
pub const PLATFORM: &str = "PLATFORM";

/// How a platform behaves.
#[derive(Clone, Debug)]
pub struct PlatformConfig {
    /// The first address that [`Platform::declare`] assigns; the next ones have the next ports.
    pub assigned: SocketAddr,
    /// How long an asker waits for the answer.
    pub patience: Duration,
    /// How long an agent that was never configured stays after its last datagram.
    pub lifetime: Duration,
    /// How many agents there may be, and how many questions may be open.
    pub capacity: usize,
}

impl Default for PlatformConfig {
    fn default() -> Self {
        PlatformConfig {
            assigned: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 49_152),
            patience: Duration::from_secs(5),
            lifetime: Duration::from_secs(30),
            capacity: 1024,
        }
    }
}

/// What a platform wants done, or tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// Write this message there.
    Send {
        /// Where.
        to: Place,
        /// What.
        message: Message,
    },
    /// This message is for an agent of the fleet: its destination, or a subscriber of its status.
    Fleet {
        /// The agent.
        to: String,
        /// What.
        message: Message,
    },
    /// An agent is there now.
    Declared(String),
    /// An agent is not there any more.
    Gone(String),
    /// A question of the fleet, or to it, stays without an answer. An agent of the platform that
    /// asked the fleet was told.
    Unanswered {
        /// The question.
        question: Message,
        /// Why.
        reason: Unanswered,
    },
}

/// What was dropped, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Messages that came from another place than their sender's own, or whose sender has a name
    /// that no agent here may have.
    pub misplaced: u64,
    /// Messages for agents that nobody knows, questions aside, which are answered.
    pub unknown: u64,
    /// Answers that belong to no open question.
    pub unasked: u64,
    /// Questions with the sender, receiver and reference of one that is still open.
    pub repeated: u64,
    /// Questions and subscriptions when there are too many.
    pub overfull: u64,
}

/// The platform of a small robot.
#[derive(Clone, Debug)]
pub struct Platform {
    config: PlatformConfig,
    agents: Agents,
    /// Who wants the status of an agent; the names may be of agents that are not there yet.
    subscribers: BTreeMap<String, BTreeSet<String>>,
    questions: Questions,
    outputs: VecDeque<Output>,
    counters: Counters,
}

impl Platform {
    /// A platform without agents.
    pub fn new(config: PlatformConfig) -> Platform {
        Platform {
            agents: Agents::new(config.assigned, config.lifetime, config.capacity),
            questions: Questions::new(config.patience, config.capacity),
            subscribers: BTreeMap::new(),
            outputs: VecDeque::new(),
            counters: Counters::default(),
            config,
        }
    }

    /// Declares an agent at an address that nobody else was given. It stays for good.
    ///
    /// # Errors
    /// A name that is none, one that is there already, or no port that is left.
    pub fn declare(&mut self, name: &str) -> Result<SocketAddr, DeclareError> {
        let address = self.agents.assign(name)?;
        self.outputs.push_back(Output::Declared(name.to_owned()));
        Ok(address)
    }

    /// Declares an agent at a place. It stays for good. Declaring it there again changes nothing.
    ///
    /// # Errors
    /// A name that is none, or one that is there at another place.
    pub fn declare_at(&mut self, name: &str, place: Place) -> Result<(), DeclareError> {
        if self.agents.configure(name, place)? {
            self.outputs.push_back(Output::Declared(name.to_owned()));
        }
        Ok(())
    }

    /// Where an agent is reached.
    pub fn get(&self, name: &str) -> Option<Place> {
        self.agents.place(name)
    }

    /// The names of all agents, in alphabetical order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.agents.names()
    }

    /// What was dropped so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// A message came from a place; `fleet` says who is an agent of the fleet.
    pub fn received(
        &mut self,
        now: Duration,
        from: Place,
        message: Message,
        fleet: impl Fn(&str) -> bool,
    ) {
        if let Some(origin) = &message.origin
            && (fleet(origin) || !self.admit(now, origin, from, &message))
        {
            self.counters.misplaced += 1;
            return;
        }
        self.pass_on(now, message, fleet);
    }

    /// An agent of the fleet sends a message; a question has a
    /// [`free_reference`](Self::free_reference).
    ///
    /// A question to an agent that is not there is answered at once with an error. Whether the
    /// message was taken; if not it is counted.
    pub fn send(&mut self, now: Duration, message: Message) -> bool {
        let dropped = self.counters;
        self.pass_on(now, message, |_| false);
        self.counters == dropped
    }

    /// A reference that no open question of this asker to this agent has.
    pub fn free_reference(&mut self, origin: &str, destination: &str) -> String {
        self.questions.free_reference(origin, destination)
    }

    /// The asker does not want the answer any more.
    pub fn forget_question(&mut self, origin: &str, destination: &str, reference: &str) {
        self.questions.forget(origin, destination, reference);
    }

    /// `subscriber` wants each status of `name` from now on.
    pub fn subscribe(&mut self, subscriber: &str, name: &str) {
        let subscribers = self.subscribers.entry(name.to_owned()).or_default();
        if subscribers.len() < self.config.capacity {
            subscribers.insert(subscriber.to_owned());
        } else {
            self.counters.overfull += 1;
        }
    }

    /// `subscriber` does not want them any more.
    pub fn unsubscribe(&mut self, subscriber: &str, name: &str) {
        if let Some(subscribers) = self.subscribers.get_mut(name) {
            subscribers.remove(subscriber);
            if subscribers.is_empty() {
                self.subscribers.remove(name);
            }
        }
    }

    /// A stream has ended: its agents are gone, and with them the answers that they owe.
    pub fn stream_closed(&mut self, stream: StreamId) {
        for name in self.agents.remove_stream(stream) {
            self.gone(name);
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called.
    pub fn poll_timeout(&self) -> Option<Duration> {
        let next = [self.agents.next_expiry(), self.questions.next_expiry()];
        next.into_iter().flatten().min()
    }

    /// The time has come.
    pub fn handle_timeout(&mut self, now: Duration) {
        for name in self.agents.expire(now) {
            self.gone(name);
        }
        for question in self.questions.expire(now) {
            self.unanswered(question, Unanswered::Silent);
        }
    }

    /// What is to be done next.
    pub fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    /// Whether the sender may speak from there. A new one is declared by its first message, which
    /// may ask to be declared on another socket that exists.
    fn admit(&mut self, now: Duration, origin: &str, from: Place, message: &Message) -> bool {
        if self.agents.place(origin).is_some() {
            return self.agents.heard(now, origin, from);
        }
        let place = match Command::of(message) {
            Some(Command::DeclareAt(address)) => self.agents.existing(address).unwrap_or(from),
            _ => from,
        };
        let declared = self.agents.appear(now, origin, place).is_ok();
        if declared {
            self.outputs.push_back(Output::Declared(origin.to_owned()));
        }
        declared
    }

    fn pass_on(&mut self, now: Duration, message: Message, fleet: impl Fn(&str) -> bool) {
        match (message.kind(), message.destination.as_deref()) {
            (Kind::Status, _) | (_, None) => self.publish(&message),
            (_, Some(PLATFORM)) => self.command(&message),
            (kind, Some(destination)) => {
                let to = match self.agents.place(destination) {
                    Some(place) => Some(Output::Send {
                        to: place,
                        message: message.clone(),
                    }),
                    None if fleet(destination) || self.questions.asks(destination) => {
                        Some(Output::Fleet {
                            to: destination.to_owned(),
                            message: message.clone(),
                        })
                    }
                    None => None,
                };
                self.route(now, kind, message, to);
            }
        }
    }

    fn route(&mut self, now: Duration, kind: Kind, message: Message, to: Option<Output>) {
        match (kind, to) {
            (Kind::Question, None) => {
                self.reply(&message, "ERROR unknown name");
            }
            (Kind::Question, Some(output)) => match self.questions.open(now, message) {
                Ok(()) => self.outputs.push_back(output),
                Err(questions::Refusal::Repeated) => self.counters.repeated += 1,
                Err(questions::Refusal::Full) => self.counters.overfull += 1,
            },
            (Kind::Answer, Some(output)) if self.questions.close(&message) => {
                self.outputs.push_back(output);
            }
            (Kind::Answer, Some(_)) => self.counters.unasked += 1,
            (_, Some(output)) => self.outputs.push_back(output),
            (_, None) => self.counters.unknown += 1,
        }
    }

    fn publish(&mut self, status: &Message) {
        let origin = status.origin.as_deref().unwrap_or_default();
        let subscribers = self.subscribers.get(origin).into_iter().flatten();
        for name in subscribers {
            let message = status.clone();
            self.outputs.push_back(match self.agents.place(name) {
                Some(to) => Output::Send { to, message },
                None => Output::Fleet {
                    to: name.clone(),
                    message,
                },
            });
        }
    }

    /// What the platform itself is asked or told to do.
    fn command(&mut self, message: &Message) {
        let Some(asker) = message.origin.clone() else {
            self.counters.unknown += 1;
            return;
        };
        match Command::of(message) {
            Some(Command::Declare) => self.reply_with_place(message, &asker),
            Some(Command::DeclareAt(address)) => match self.agents.check(&asker, address) {
                Ok(()) => self.reply_with_place(message, &asker),
                Err(error) => self.reply(message, &format!("ERROR {error}")),
            },
            Some(Command::Get(name)) => {
                let name = name.to_owned();
                self.reply_with_place(message, &name);
            }
            Some(Command::Subscribe(name)) => {
                let name = name.to_owned();
                self.subscribe(&asker, &name);
            }
            Some(Command::Unsubscribe(name)) => {
                let name = name.to_owned();
                self.unsubscribe(&asker, &name);
            }
            None if message.kind() == Kind::Question => {
                self.reply(message, "ERROR unknown question");
            }
            None => self.counters.unknown += 1,
        }
    }

    fn reply_with_place(&mut self, question: &Message, name: &str) {
        let text = match self.agents.place(name) {
            Some(Place::Datagram(address)) => format!("{} {}", address.ip(), address.port()),
            Some(Place::Stream(_)) => "ERROR it has no address, it is on a stream".to_owned(),
            None => "ERROR unknown name".to_owned(),
        };
        self.reply(question, &text);
    }

    /// The platform's answer.
    fn reply(&mut self, question: &Message, text: &str) {
        let mut answer = question.answer(text);
        answer.origin = Some(PLATFORM.to_owned());
        self.answer(answer);
    }

    /// Hands an answer to wherever the asker is.
    fn answer(&mut self, message: Message) {
        let asker = message.destination.clone().unwrap_or_default();
        self.outputs.push_back(match self.agents.place(&asker) {
            Some(to) => Output::Send { to, message },
            None => Output::Fleet { to: asker, message },
        });
    }

    fn gone(&mut self, name: String) {
        for question in self.questions.abandon(&name) {
            self.unanswered(question, Unanswered::Gone);
        }
        self.outputs.push_back(Output::Gone(name));
    }

    /// Between agents of the robot the asker counts the seconds itself.
    fn unanswered(&mut self, question: Message, reason: Unanswered) {
        let is_here = |name: &Option<String>| {
            let name = name.as_deref().unwrap_or_default();
            self.agents.place(name).is_some()
        };
        let asker = is_here(&question.origin);
        if asker && is_here(&question.destination) {
            return;
        }
        if asker {
            let answer = question.answer(format!("ERROR {reason}"));
            self.answer(answer);
        }
        self.outputs
            .push_back(Output::Unanswered { question, reason });
    }
}

/// What can be asked of the platform.
enum Command<'a> {
    Declare,
    DeclareAt(SocketAddr),
    Get(&'a str),
    Subscribe(&'a str),
    Unsubscribe(&'a str),
}

impl Command<'_> {
    fn of(message: &Message) -> Option<Command<'_>> {
        if message.destination.as_deref() != Some(PLATFORM) {
            return None;
        }
        let words: Vec<&str> = message.text().split_ascii_whitespace().collect();
        match (message.kind(), words.as_slice()) {
            (Kind::Question, ["DECLARE"]) => Some(Command::Declare),
            (Kind::Question, ["DECLARE", ip, port]) => {
                let (ip, port) = (ip.parse::<IpAddr>().ok()?, port.parse().ok()?);
                Some(Command::DeclareAt(SocketAddr::new(ip, port)))
            }
            (Kind::Question, ["GET", name]) => Some(Command::Get(name)),
            (Kind::Action, ["SUBSCRIBE", name]) => Some(Command::Subscribe(name)),
            (Kind::Action, ["UNSUBSCRIBE", name]) => Some(Command::Unsubscribe(name)),
            _ => None,
        }
    }
}
