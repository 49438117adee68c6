mod detach;
mod federation;
mod matching;
mod questions;
mod requests;
mod search;
mod store;
mod subscriptions;

use std::collections::{HashMap, VecDeque};
use std::time::Duration;

use fipa_acl::{AgentId, Message, Performative, Text};
use fipa_directory::Now;

pub(crate) use self::federation::{DF_TOOLS, FEDERATE, LEAVE};
use self::questions::{About, Questions, Served};
use self::search::Search;
use self::store::Store;
use self::subscriptions::Subscriptions;
use crate::answer::{Action, Outcome, answer, not_taken};
use crate::{DfAgentDescription, DirectoryView, KnownAgent, Origin, Reason, SearchConstraints};

/// What a directory facilitator is made with.
#[derive(Clone, Debug)]
pub struct DfConfig {
    /// Its name: `df@` and the name of the platform.
    pub name: Text,
    /// A word that no other run of any DF has; it makes the ids of searches unique.
    pub unique: Text,
    /// The longest lease that is granted; `None`: as long as is wanted, for ever if nothing is.
    pub max_lease: Option<Duration>,
    /// Descriptions that may be registered at the same time.
    pub max_descriptions: usize,
    /// Descriptions that one search finds at most for an agent of this platform. Who wanted more is
    /// told that there are more.
    pub max_results: usize,
    /// The same for agents of other platforms.
    pub max_foreign_results: usize,
    /// Subscriptions at the same time.
    pub max_subscriptions: usize,
    /// Searches that may wait for other DFs at the same time; more are answered without them.
    pub max_searches: usize,
    /// Other DFs that one search goes on to at most.
    pub max_federated: usize,
    /// How long other DFs are waited for.
    pub patience: Duration,
}

impl DfConfig {
    /// The usual settings for the DF of this name, with a word that no other run of any DF has.
    pub fn new(name: impl Into<Text>, unique: impl Into<Text>) -> DfConfig {
        DfConfig {
            name: name.into(),
            unique: unique.into(),
            max_lease: None,
            max_descriptions: 20_000,
            max_results: 30_000,
            max_foreign_results: 1000,
            max_subscriptions: 1000,
            max_searches: 1000,
            max_federated: 100,
            patience: Duration::from_secs(10),
        }
    }
}

/// What a DF wants done, or tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DfOutput {
    /// Send this message; it is complete but for the addresses of its sender.
    Send(Box<Message>),
    /// What became of a request to register with another DF, or to end that.
    Federation {
        /// The DF that was asked.
        parent: Text,
        /// How it went.
        result: Result<(), Reason>,
    },
}

/// The directory facilitator of a platform (FIPA SC00023K): its yellow pages.
///
/// It keeps the descriptions that agents register, until their leases expire or they are gone;
/// finds those that match a template, here and at the DFs that are registered here; and tells
/// subscribers what changes.
#[derive(Debug)]
pub struct Df {
    config: DfConfig,
    store: Store,
    subscriptions: Subscriptions,
    questions: Questions,
    searches: HashMap<u64, Search>,
    /// Requests to register with another DF that it has not answered yet.
    federating: HashMap<u64, (Message, Action)>,
    served: Served,
    /// Counts what needs a name of its own.
    count: u64,
    outputs: VecDeque<DfOutput>,
}

impl Df {
    /// A DF without descriptions.
    pub fn new(config: DfConfig) -> Df {
        Df {
            config,
            store: Store::default(),
            subscriptions: Subscriptions::default(),
            questions: Questions::default(),
            searches: HashMap::new(),
            federating: HashMap::new(),
            served: Served::default(),
            count: 0,
            outputs: VecDeque::new(),
        }
    }

    /// Takes in a message for the DF.
    pub fn handle(
        &mut self,
        now: Now,
        origin: Origin,
        message: &Message,
        directory: &dyn DirectoryView,
    ) {
        self.handle_timeout(now);
        match message.performative {
            Performative::Request => self.request(now, origin, message, directory),
            Performative::Subscribe => self.subscribe(origin, message, directory),
            Performative::Cancel => self.cancel(message),
            Performative::Inform
            | Performative::Failure
            | Performative::Refuse
            | Performative::NotUnderstood => self.answered(message),
            _ => self.send(not_taken(&self.config.name, message)),
        }
    }

    /// What is to be done next.
    pub fn poll_output(&mut self) -> Option<DfOutput> {
        self.outputs.pop_front()
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called, on [`Now::mono`].
    pub fn poll_timeout(&self) -> Option<Duration> {
        let times = [self.store.next_expiry(), self.questions.next_deadline()];
        times.into_iter().flatten().min()
    }

    /// The time has come: leases expire, and other DFs are waited for no longer.
    pub fn handle_timeout(&mut self, now: Now) {
        while let Some(description) = self.store.expire(now.mono) {
            self.changed(Some(&description), None);
        }
        while let Some(question) = self.questions.expire(now.mono) {
            match question.about {
                About::Search(search) => self.one_less(search),
                About::Federation(id) => {
                    let late = Text::from_static("it did not answer in time");
                    self.federation(id, question.whom, Err(Reason::InternalError(late)));
                }
            }
        }
    }

    /// An agent has come into the directory: subscribers are told.
    pub fn agent_known(&mut self, agent: KnownAgent<'_>, directory: &dyn DirectoryView) {
        if !self.store.contains(agent.name) {
            let description = described(agent, directory);
            self.changed(None, Some(&description));
        }
    }

    /// An agent has left the directory, or cannot be reached: its description and its
    /// subscriptions end.
    pub fn agent_gone(&mut self, agent: KnownAgent<'_>) {
        self.subscriptions.drop_subscriber(agent.name);
        let registered = self.store.remove(agent.name);
        let before = registered.unwrap_or_else(|| matching::described(agent));
        self.changed(Some(&before), None);
    }

    /// How many descriptions are registered.
    pub fn len(&self) -> usize {
        self.store.len()
    }

    /// Whether no description is registered.
    pub fn is_empty(&self) -> bool {
        self.store.len() == 0
    }

    fn changed(&mut self, before: Option<&DfAgentDescription>, after: Option<&DfAgentDescription>) {
        let told = self.subscriptions.changed(before, after).into_iter();
        self.outputs
            .extend(told.map(|message| DfOutput::Send(Box::new(message))));
    }

    /// How many descriptions are given to who wants so many, and whether that may be too few.
    fn limit(&self, origin: Origin, constraints: &SearchConstraints) -> (usize, bool) {
        let most = match origin {
            Origin::Local => self.config.max_results,
            Origin::Foreign => self.config.max_foreign_results,
        };
        let limit = constraints.limit(most);
        (limit, constraints.limit(usize::MAX) > limit)
    }

    fn answer(&mut self, message: &Message, action: Option<&Action>, outcome: Outcome) {
        self.send(answer(&self.config.name, message, action, outcome));
    }

    fn send(&mut self, message: Option<Message>) {
        let message = message.map(Box::new);
        self.outputs.extend(message.map(DfOutput::Send));
    }

    /// A name that nothing else has.
    fn fresh(&mut self) -> Text {
        self.count += 1;
        Text::from(format!(
            "{}-{}-{}",
            self.config.name, self.config.unique, self.count
        ))
    }
}

/// The description of an agent of the directory, with the addresses where it is reached.
fn described(agent: KnownAgent<'_>, directory: &dyn DirectoryView) -> DfAgentDescription {
    let mut description = matching::described(agent);
    description.name = Some(AgentId {
        addresses: directory.addresses(agent.name),
        ..AgentId::new(agent.name)
    });
    description
}
