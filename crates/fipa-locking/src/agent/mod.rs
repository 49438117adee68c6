//! The agent: what it is told, and what it wants done.

#[cfg(test)]
pub(crate) mod canonical;
mod discovery;
mod members;
mod owner;
mod probing;
mod requests;
mod ricart_agrawala;
mod suzuki_kasami;
mod timers;

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fipa_acl::{Message, Performative, Text};

use crate::owned::Owned;
use crate::post::Post;
use crate::request::{Phase, Request};
use crate::token::Token;
use crate::{Algorithm, Config, LockView, Output, Record, RequestError, listing, wire};

/// One agent that requests, holds and owns resources.
///
/// Whoever runs it hands in events with the time (since any point that stays the same), then does
/// what [`poll_output`](Self::poll_output) says until that is `None`, and calls
/// [`handle_timeout`](Self::handle_timeout) when [`poll_timeout`](Self::poll_timeout) says so.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct LockAgent {
    config: Config,
    /// The Lamport clock of the Ricart-Agrawala algorithm.
    clock: u64,
    /// Who owns what, as far as we have asked.
    owners: BTreeMap<Text, Text>,
    requests: BTreeMap<Text, Request>,
    owned: BTreeMap<Text, Owned>,
    chains: BTreeMap<Text, Chain>,
    post: Post,
}

/// What the Suzuki-Kasami algorithm keeps of a resource between requests.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
struct Chain {
    /// The number of our last request.
    own: u64,
    /// The number and the conversation of each other agent's last request.
    heard: BTreeMap<Text, (u64, Text)>,
    /// The token of the plain algorithm, while it is here and not in use.
    token: Option<Token>,
}

impl LockAgent {
    /// An agent that neither owns nor wants anything.
    pub fn new(config: Config) -> LockAgent {
        LockAgent {
            post: Post::new(config.name.clone(), config.first_conversation),
            config,
            clock: 0,
            owners: BTreeMap::new(),
            requests: BTreeMap::new(),
            owned: BTreeMap::new(),
            chains: BTreeMap::new(),
        }
    }

    /// The agent's name.
    pub fn name(&self) -> &Text {
        &self.config.name
    }

    /// Owns a resource from now on; `record` is what was last kept of it
    /// ([`Output::Persist`]), or the default for one that is new. Owning it again changes nothing.
    ///
    /// # Errors
    /// A name that is none, or too many resources.
    pub fn own(
        &mut self,
        now: Duration,
        resource: impl Into<Text>,
        record: Record,
    ) -> Result<(), RequestError> {
        let resource = self.checked_name(resource.into())?;
        if self.owned.contains_key(&resource) {
            return Ok(());
        }
        if self.owned.len() >= self.config.max_resources {
            return Err(RequestError::TooManyResources);
        }
        let silence = self.config.heartbeat * crate::watch::SILENCE;
        let quarantine = record.held.then(|| now + silence);
        let owned = Owned::new(resource.clone(), record.fencing, quarantine);
        let token = Token::new(resource.clone());
        self.chains.entry(resource.clone()).or_default().token = Some(token);
        self.owned.insert(resource, owned);
        Ok(())
    }

    /// Asks for a resource: answered by [`Output::Granted`] or [`Output::Failed`], unless it is
    /// [`released`](Self::release) before. `participants` are the agents that may want it too; its
    /// owner is found among them.
    ///
    /// # Errors
    /// A name that is none, a resource that is requested already, or too many of something.
    pub fn request(
        &mut self,
        now: Duration,
        resource: impl Into<Text>,
        algorithm: Algorithm,
        participants: impl IntoIterator<Item = Text>,
    ) -> Result<(), RequestError> {
        let heartbeat = self.config.heartbeat;
        self.request_with_heartbeat(now, resource, algorithm, heartbeat, participants)
    }

    /// The same with a heartbeat of its own, which counts where the owner's is not shorter.
    ///
    /// # Errors
    /// As for [`request`](Self::request).
    pub fn request_with_heartbeat(
        &mut self,
        now: Duration,
        resource: impl Into<Text>,
        algorithm: Algorithm,
        heartbeat: Duration,
        participants: impl IntoIterator<Item = Text>,
    ) -> Result<(), RequestError> {
        let resource = self.checked_name(resource.into())?;
        if self.requests.contains_key(&resource) {
            return Err(RequestError::Requested(resource));
        }
        if self.requests.len() >= self.config.max_resources {
            return Err(RequestError::TooManyResources);
        }
        let participants = self.others(participants);
        if participants.len() > self.config.max_participants {
            return Err(RequestError::TooManyParticipants);
        }
        let request = Request::new(now, algorithm, participants, heartbeat);
        self.requests.insert(resource.clone(), request);
        if self.owner(&resource).is_some() {
            self.begin(now, &resource);
        } else {
            self.discover(now, &resource);
        }
        Ok(())
    }

    /// Gives a resource back, or does not want it any more. Nothing happens if neither is the case.
    pub fn release(&mut self, now: Duration, resource: &str) {
        let Some((resource, request)) = self.requests.remove_entry(resource) else {
            return;
        };
        if request.algorithm.has_token() {
            self.release_token(now, &resource, request);
        } else {
            self.release_grants(now, &resource, request);
        }
    }

    /// Whether the resource is held at this time: a lease that ran out is no more, even if
    /// [`handle_timeout`](Self::handle_timeout) was not called yet.
    pub fn holds(&self, now: Duration, resource: &str) -> bool {
        let Some(request) = self.requests.get(resource) else {
            return false;
        };
        let leased = self.is_leased(resource, request);
        request.phase == Phase::Held && (!leased || request.lease_runs(now))
    }

    /// The resources that this agent owns, by name.
    pub fn owned(&self) -> impl Iterator<Item = LockView> {
        self.owned.iter().map(|(resource, owned)| {
            let holding = owned.holding.as_ref();
            let holder = holding.map(|holding| holding.claim.agent.clone());
            let waiting = owned.waiting.keys();
            let fencing = match holding {
                Some(holding) => holding.fencing,
                None => Some(owned.fencing),
            };
            LockView {
                resource: resource.clone(),
                owner: self.config.name.clone(),
                waiting: waiting
                    .filter(|name| Some(*name) != holder.as_ref())
                    .cloned()
                    .collect(),
                holder,
                fencing,
            }
        })
    }

    /// Whether a message is one of these protocols, and for [`handle`](Self::handle) alone.
    pub fn takes(message: &Message) -> bool {
        let Some(protocol) = message.protocol.as_deref() else {
            return false;
        };
        match protocol {
            wire::DISCOVER | wire::PROBE => true,
            // The answers are for whoever has asked.
            listing::PROTOCOL => message.performative == Performative::QueryRef,
            protocol => Algorithm::from_protocol(protocol).is_some(),
        }
    }

    /// A message came. Whether it is one of these protocols; one that is malformed is answered by
    /// `not-understood` where it asks for something, and does nothing else.
    pub fn handle(&mut self, now: Duration, message: &Message) -> bool {
        if !LockAgent::takes(message) {
            return false;
        }
        let protocol = message.protocol.as_deref().unwrap_or_default();
        let algorithm = Algorithm::from_protocol(protocol);
        let Some(sender) = &message.sender else {
            return true;
        };
        let from = sender.name.detached();
        if from == self.config.name {
            return true;
        }
        let understood = match algorithm {
            Some(algorithm) if algorithm.has_token() => {
                self.handle_suzuki_kasami(now, algorithm, &from, message)
            }
            Some(algorithm) => self.handle_ricart_agrawala(now, algorithm, &from, message),
            None if protocol == wire::DISCOVER => self.handle_discovery(now, &from, message),
            None if protocol == listing::PROTOCOL => self.answer_list_query(&from, message),
            None => self.handle_probe(now, &from, message),
        };
        if understood.is_none() && asks(&message.performative) {
            self.not_understood(&from, message);
        }
        true
    }

    /// Somebody asks for the resources that are owned here.
    fn answer_list_query(&mut self, from: &Text, query: &Message) -> Option<()> {
        let views: Vec<LockView> = self.owned().collect();
        let answer = listing::answer(query, &views).from_agent(self.config.name.clone());
        self.post.send(answer, [from.clone()]);
        Some(())
    }

    /// What is to be done next.
    pub fn poll_output(&mut self) -> Option<Output> {
        self.post.outputs.pop_front()
    }

    fn checked_name(&self, resource: Text) -> Result<Text, RequestError> {
        if wire::is_resource(&resource) {
            Ok(resource.detached())
        } else {
            Err(RequestError::Name(resource))
        }
    }

    fn others(&self, names: impl IntoIterator<Item = Text>) -> BTreeSet<Text> {
        let others = names.into_iter().filter(|name| *name != self.config.name);
        others.map(|name| name.detached()).collect()
    }

    /// Who owns a resource, as far as we know.
    fn owner(&self, resource: &str) -> Option<Text> {
        if self.owned.contains_key(resource) {
            Some(self.config.name.clone())
        } else {
            self.owners.get(resource).cloned()
        }
    }

    /// Whether what a request gets is lent for a time: not by ourselves, and not in the plain
    /// algorithms.
    fn is_leased(&self, resource: &str, request: &Request) -> bool {
        request.algorithm.is_extended() && !self.owned.contains_key(resource)
    }

    fn not_understood(&mut self, from: &Text, message: &Message) {
        let answer = message.reply(Performative::NotUnderstood);
        let answer = answer.from_agent(self.config.name.clone());
        self.post.send(answer, [from.clone()]);
    }
}

/// Whether a performative of these protocols wants an answer.
fn asks(performative: &Performative) -> bool {
    matches!(performative, Performative::Request | Performative::QueryIf)
}
