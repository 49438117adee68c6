//! What of an agent and of a message decides nothing any more, so that the search through all
//! orders of events takes those for the same that differ in nothing else.
//!
//! * Of probes that were answered, and of those that never will be, nothing is kept.
//! * Of what is said again after a while it is not kept when: the search says it at any time.
//! * Who was served by a token, with which number, is freight for agents of the C++ library: the
//!   owner of an extended algorithm decides by what it was asked.
//! * The conversation in which an agent has given back is kept against claims that come late. None
//!   does where messages keep their order.
//! * Whom the owner names counts for an agent that is silent for four heartbeats, and is told anew
//!   in each: it is kept from the second silent one on. Who is not told by the owner fails with it.
//! * Times that are over for longer than anything waits are the same.

use std::time::Duration;

use fipa_acl::{Message, Performative, Text};

use super::LockAgent;
use crate::request::{Phase, Request};
use crate::token::Token;
use crate::watch::{SILENCE, Watch};
use crate::{Algorithm, wire};

/// Conversations are counted from a multiple of this: one for each request.
const CONVERSATIONS: u64 = 32;

/// The number in a message by which the Lamport clocks go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Stamp {
    pub(crate) number: u64,
    /// Whether others compare their requests with it; else it only moves their clock.
    pub(crate) compared: bool,
}

pub(crate) fn stamp(message: &Message) -> Option<Stamp> {
    let (number, _) = wire::stamped(message)?;
    let compared = message.performative == Performative::Request;
    Some(Stamp { number, compared })
}

pub(crate) fn with_stamp(message: &Message, number: u64) -> Message {
    let mut stamped = message.clone();
    if let Some((_, resource)) = wire::stamped(message) {
        stamped.content = Some(format!("{number}\n{resource}").into());
    }
    stamped
}

/// A message as it comes to one of its receivers.
pub(crate) fn received(message: &Message, to: &str) -> Message {
    let mut received = message.clone();
    // Only the owner that is asked for looks at who else was.
    if received.performative != Performative::QueryIf {
        received.receiver.retain(|receiver| receiver.name == *to);
    }
    if let Some(token) = token(message) {
        received.content = Some(Token::new(token.resource).encode().into());
    }
    received
}

fn token(message: &Message) -> Option<Token> {
    if message.performative != Performative::Propagate {
        return None;
    }
    Token::decode(message.content_str()?, usize::MAX).ok()
}

/// Whether a message does nothing at an agent that never owns anything, whatever else it does.
pub(crate) fn is_for_owners(message: &Message) -> bool {
    let protocol = message.protocol.as_deref().unwrap_or_default();
    match message.performative {
        Performative::QueryIf => true,
        Performative::Request => protocol == Algorithm::SuzukiKasamiExtended.protocol(),
        _ => false,
    }
}

impl LockAgent {
    /// The Lamport clock, and the stamp with which requests of others are compared.
    pub(crate) fn lamport(&self) -> (u64, Option<u64>) {
        let stamp = self.requests.values().find(|r| compares(r));
        (self.clock, stamp.map(|request| request.stamp))
    }

    pub(crate) fn set_lamport(&mut self, clock: u64, stamp: Option<u64>) {
        self.clock = clock;
        for request in self.requests.values_mut().filter(|r| compares(r)) {
            request.stamp = stamp.unwrap_or(request.stamp);
        }
    }

    pub(crate) fn is_discovering(&self) -> bool {
        let mut requests = self.requests.values();
        requests.any(|request| request.phase == Phase::Discovering)
    }

    /// Whether there is something that it says again after a while.
    pub(crate) fn says_again(&self) -> bool {
        let mut requests = self.requests.values();
        requests.any(|request| request.phase != Phase::Held)
    }

    pub(crate) fn say_again(&mut self, now: Duration) {
        let requests = self.requests.values_mut();
        requests.for_each(|request| request.repeat = now);
    }

    /// It has found the owner before.
    pub(crate) fn know_owner(&mut self, resource: &str, owner: &str) {
        self.owners.insert(Text::from(resource), Text::from(owner));
    }

    /// The next conversations are those of a new request.
    pub(crate) fn count_request(&mut self) {
        let counted = self.post.counter() / CONVERSATIONS * CONVERSATIONS;
        self.post.set_counter(counted + CONVERSATIONS);
    }

    /// Whether a probe is not answered yet.
    pub(crate) fn waits_for_probes(&mut self) -> bool {
        let mut waits = false;
        self.each_watch(&mut |watch| waits |= !watch.open.is_empty());
        waits
    }

    /// Time passes: all that it remembers is so much longer ago.
    pub(crate) fn age(&mut self, by: Duration) {
        self.each_time(&mut |time| *time = time.saturating_sub(by));
    }

    /// Forgets what decides nothing any more. If it was `probed`, answers to
    /// probes may come.
    pub(crate) fn forget(&mut self, now: Duration, probed: bool) {
        let heartbeat = self.config.heartbeat;
        self.chains.clear();
        for request in self.requests.values_mut() {
            forget_of_request(request, now, heartbeat);
        }
        for (resource, owned) in &mut self.owned {
            owned.ended.clear();
            owned.token = Token::new(resource.clone());
            let held = owned.holding.iter_mut().map(|holding| &mut holding.claim);
            let claims = owned.claims.iter_mut().chain(held);
            claims.for_each(|claim| claim.sequence = 0);
        }
        if !probed {
            self.each_watch(&mut |watch| watch.open.clear());
            let counted = self.post.counter() / CONVERSATIONS * CONVERSATIONS;
            self.post.set_counter(counted);
        }
        let oldest = now.saturating_sub(heartbeat * (SILENCE + 1));
        self.each_time(&mut |time| *time = (*time).max(oldest));
    }

    fn each_watch(&mut self, f: &mut dyn FnMut(&mut Watch)) {
        for request in self.requests.values_mut() {
            request.watches.values_mut().for_each(&mut *f);
        }
        for owned in self.owned.values_mut() {
            let holding = owned.holding.iter_mut();
            holding.for_each(|holding| f(&mut holding.watch));
        }
    }

    fn each_time(&mut self, f: &mut dyn FnMut(&mut Duration)) {
        self.each_watch(&mut |watch| {
            f(&mut watch.heard);
            f(&mut watch.next);
            watch.open.iter_mut().for_each(|probe| f(&mut probe.sent));
        });
        for request in self.requests.values_mut() {
            f(&mut request.since);
            f(&mut request.repeat);
            request.renewed.iter_mut().for_each(&mut *f);
        }
        for owned in self.owned.values_mut() {
            owned.quarantine.iter_mut().for_each(&mut *f);
            owned.waiting.values_mut().for_each(&mut *f);
        }
    }
}

/// Whether requests of others are compared with the stamp of this one.
fn compares(request: &Request) -> bool {
    !request.algorithm.has_token() && request.phase == Phase::Waiting
}

fn forget_of_request(request: &mut Request, now: Duration, heartbeat: Duration) {
    let has_token = request.algorithm.has_token();
    let phase = request.phase;
    request.repeat = now + heartbeat * SILENCE;
    if !compares(request) {
        request.stamp = 0;
        if phase != Phase::Discovering {
            request.participants.clear();
        }
    }
    if phase == Phase::Waiting && !has_token {
        request.renewed = None;
    }
    if phase != Phase::Discovering && request.fenced != Some(false) {
        request.since = now;
    }
    let mut watches = request.watches.values();
    let lately = watches.all(|watch| watch.heard + heartbeat * 2 > now);
    if lately || phase == Phase::Held {
        request.named = None;
    }
    if let Some(token) = &mut request.token {
        *token = Token::new(token.resource.clone());
    }
}
