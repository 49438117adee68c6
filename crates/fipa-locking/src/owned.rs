use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use fipa_acl::Text;

use crate::Algorithm;
use crate::token::Token;
use crate::watch::Watch;

/// A resource that this agent owns.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Owned {
    /// The last number that was issued.
    pub(crate) fencing: u64,
    /// Until when an earlier life of this agent may have left a holder.
    pub(crate) quarantine: Option<Duration>,
    pub(crate) holding: Option<Holding>,
    /// Who is next, in this order.
    pub(crate) claims: VecDeque<Claim>,
    /// Who wants it, and when it was last heard.
    pub(crate) waiting: BTreeMap<Text, Duration>,
    /// The last conversation in which each agent gave it back, so that nothing that comes late
    /// claims it once more.
    pub(crate) ended: BTreeMap<Text, Text>,
    /// The token of the extended algorithm; out of date while it is elsewhere.
    pub(crate) token: Token,
}

/// A grant.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Holding {
    pub(crate) claim: Claim,
    /// Its number, if it has one.
    pub(crate) fencing: Option<u64>,
    /// Whether the holder was told: not before the number is durable.
    pub(crate) told: bool,
    pub(crate) watch: Watch,
}

/// An agent to which nothing but the owner's word is missing.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Claim {
    pub(crate) agent: Text,
    /// Where it asked; empty when only its grant is known.
    pub(crate) conversation: Text,
    pub(crate) algorithm: Algorithm,
    /// Whether it understands numbers, and says so itself whether it still holds.
    pub(crate) fenced: bool,
    pub(crate) heartbeat: Duration,
    /// The number of its request, for the token.
    pub(crate) sequence: u64,
}

impl Owned {
    pub(crate) fn new(resource: Text, fencing: u64, quarantine: Option<Duration>) -> Owned {
        Owned {
            fencing,
            quarantine,
            holding: None,
            claims: VecDeque::new(),
            waiting: BTreeMap::new(),
            ended: BTreeMap::new(),
            token: Token::new(resource),
        }
    }

    pub(crate) fn is_held_by(&self, agent: &str) -> bool {
        self.holding
            .as_ref()
            .is_some_and(|holding| holding.claim.agent == *agent)
    }

    /// Forgets an agent that is gone.
    pub(crate) fn forget(&mut self, agent: &str) {
        self.claims.retain(|claim| claim.agent != *agent);
        self.waiting.remove(agent);
        self.ended.remove(agent);
        self.token.served.remove(agent);
        self.token.queue.retain(|next| next != agent);
    }
}
