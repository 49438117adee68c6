use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use fipa_acl::Text;

use crate::Algorithm;
use crate::token::Token;
use crate::watch::{LEASE, Watch};

/// A resource that this agent wants or holds.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Request {
    pub(crate) algorithm: Algorithm,
    pub(crate) phase: Phase,
    /// Who is asked: the others.
    pub(crate) participants: BTreeSet<Text>,
    /// When the phase began.
    pub(crate) since: Duration,
    pub(crate) conversation: Text,
    /// The Lamport clock or the sequence number of the request.
    pub(crate) stamp: u64,
    /// Whose grants are missing.
    pub(crate) owed: BTreeSet<Text>,
    /// Who waits for our grant, and in which conversation.
    pub(crate) deferred: BTreeMap<Text, Text>,
    /// Whom we depend on.
    pub(crate) watches: BTreeMap<Text, Watch>,
    /// When what is unanswered is said again.
    pub(crate) repeat: Duration,
    /// Whether the owner issues numbers, once that is known.
    pub(crate) fenced: Option<bool>,
    /// Whom the owner's latest answer names as the holder.
    pub(crate) named: Option<Text>,
    /// The number of the grant, once the owner has told it.
    pub(crate) fencing: Option<u64>,
    /// When what the owner answered last was sent: it lends nothing to others before four
    /// heartbeats have passed since. `None`: it has answered nothing that proves our grant.
    pub(crate) renewed: Option<Duration>,
    pub(crate) heartbeat: Duration,
    pub(crate) token: Option<Token>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Phase {
    /// Nobody has said yet that it owns the resource.
    Discovering,
    /// Grants are missing, or the token is elsewhere.
    Waiting,
    /// Nothing is missing but the owner's word.
    Confirming,
    Held,
}

impl Request {
    pub(crate) fn new(
        now: Duration,
        algorithm: Algorithm,
        participants: BTreeSet<Text>,
        heartbeat: Duration,
    ) -> Request {
        Request {
            algorithm,
            phase: Phase::Discovering,
            participants,
            since: now,
            conversation: Text::default(),
            stamp: 0,
            owed: BTreeSet::new(),
            deferred: BTreeMap::new(),
            watches: BTreeMap::new(),
            repeat: now,
            fenced: None,
            named: None,
            fencing: None,
            renewed: None,
            heartbeat,
            token: None,
        }
    }

    /// When the lease ends by our clock.
    pub(crate) fn lease_end(&self) -> Option<Duration> {
        Some(self.renewed? + self.heartbeat * LEASE)
    }

    pub(crate) fn lease_runs(&self, now: Duration) -> bool {
        self.lease_end().is_some_and(|end| end > now)
    }

    /// Adopts the heartbeat by which the owner measures the lease, if that is shorter.
    pub(crate) fn shorten_heartbeat(&mut self, told: Option<Duration>) {
        self.heartbeat = told.unwrap_or(self.heartbeat).min(self.heartbeat);
        for watch in self.watches.values_mut() {
            watch.set_heartbeat(self.heartbeat);
        }
    }

    /// The number that probes of the owner want to have confirmed.
    pub(crate) fn proven_number(&self) -> Option<u64> {
        self.fencing
            .filter(|_| matches!(self.phase, Phase::Confirming | Phase::Held))
    }
}
