//! The owner: it lends the resource to one agent at a time, each time with a new number.

use std::time::Duration;

use fipa_acl::{Performative, Text};

use super::LockAgent;
use crate::owned::{Claim, Holding};
use crate::request::Phase;
use crate::watch::{SILENCE, Watch};
use crate::{FailureReason, Output, Record, wire};

impl LockAgent {
    /// What was to be kept of a resource survives a crash now, and its number may be told.
    pub fn persisted(&mut self, now: Duration, resource: &str, fencing: u64) {
        let Some((resource, owned)) = self.owned.get_key_value(resource) else {
            return;
        };
        let resource = resource.clone();
        let waits = |holding: &&Holding| !holding.told && holding.fencing == Some(fencing);
        if owned.holding.as_ref().filter(waits).is_some() {
            self.lend(now, &resource);
        }
    }

    /// What was to be kept of a resource could not be: whoever would have got it is refused.
    pub fn persist_failed(&mut self, now: Duration, resource: &str, fencing: u64) {
        let Some((resource, owned)) = self.owned.get_key_value(resource) else {
            return;
        };
        let resource = resource.clone();
        let waits = |holding: &&Holding| !holding.told && holding.fencing == Some(fencing);
        let Some(holding) = owned.holding.as_ref().filter(waits) else {
            return;
        };
        let claim = holding.claim.clone();
        self.refuse(&resource, &claim, "the number of the grant cannot be kept");
        self.free(now, &resource);
    }

    fn refuse(&mut self, resource: &Text, claim: &Claim, why: &'static str) {
        if claim.agent != self.config.name {
            let protocol = claim.algorithm.protocol();
            let act = Performative::Refuse;
            let message = self.post.continued(act, protocol, &claim.conversation);
            self.post.send(message.content(why), [claim.agent.clone()]);
        } else if let Some(request) = self.requests.remove(resource) {
            self.grant_deferred(resource, &request);
            self.post.put(Output::Failed {
                resource: resource.clone(),
                reason: FailureReason::Refused(Text::from_static(why)),
            });
        }
    }

    pub(super) fn note_waiting(&mut self, now: Duration, resource: &Text, agent: &Text) {
        let Some(owned) = self.owned.get_mut(resource) else {
            return;
        };
        let full = owned.waiting.len() >= self.config.max_participants;
        if !full || owned.waiting.contains_key(agent) {
            owned.waiting.insert(agent.clone(), now);
        }
    }

    /// Nothing but the owner's word is missing to an agent.
    pub(super) fn claim(&mut self, now: Duration, resource: &Text, claim: Claim) {
        let Some(owned) = self.owned.get(resource) else {
            return;
        };
        if claim.fenced && owned.ended.get(&claim.agent) == Some(&claim.conversation) {
            return;
        }
        self.note_waiting(now, resource, &claim.agent);
        let Some(owned) = self.owned.get_mut(resource) else {
            return;
        };
        let holding = owned.holding.as_mut();
        if let Some(holding) = holding.filter(|holding| holding.claim.agent == claim.agent) {
            if holding.claim.conversation == claim.conversation {
                // It has not heard our word.
                holding.watch.heard = now;
                if holding.told {
                    self.tell(resource);
                }
                return;
            }
            if !holding.claim.fenced {
                owned.holding = None;
            }
        }
        let max = self.config.max_participants;
        owned.claims.retain(|other| other.agent != claim.agent);
        if owned.claims.len() >= max {
            return self.refuse(resource, &claim, "too many agents wait");
        }
        let again = owned.is_held_by(&claim.agent);
        if claim.algorithm.has_token() {
            let free = owned.holding.is_none() && owned.claims.is_empty();
            let served = if free { 1 } else { 0 };
            let served = claim.sequence.saturating_sub(served);
            owned.token.served.insert(claim.agent.clone(), served);
        }
        owned.claims.push_back(claim);
        if again {
            // It gave back what it had, but we have not heard of it.
            self.probe_holder(now, resource);
        } else {
            self.grant_next(now, resource);
        }
    }

    pub(super) fn claim_own(&mut self, now: Duration, resource: &Text) {
        let Some(request) = self.requests.get(resource) else {
            return;
        };
        let claim = Claim {
            agent: self.config.name.clone(),
            conversation: request.conversation.clone(),
            algorithm: request.algorithm,
            fenced: request.algorithm.is_extended(),
            heartbeat: request.heartbeat,
            sequence: request.stamp,
        };
        if let Some(owned) = self.owned.get_mut(resource) {
            owned.claims.push_back(claim);
        }
        self.grant_next(now, resource);
    }

    pub(super) fn grant_next(&mut self, now: Duration, resource: &Text) {
        let Some(owned) = self.owned.get_mut(resource) else {
            return;
        };
        let waits = owned.quarantine.is_some_and(|until| until > now);
        if waits || owned.holding.is_some() {
            return;
        }
        owned.quarantine = None;
        let claim = loop {
            let Some(claim) = owned.claims.pop_front() else {
                return;
            };
            // Whoever died while it waited would keep the others waiting once more.
            let heard = owned.waiting.get(&claim.agent);
            let alive = heard.is_some_and(|heard| *heard + claim.heartbeat * SILENCE > now);
            if alive || !claim.fenced || claim.agent == self.config.name {
                break claim;
            }
        };
        owned.waiting.remove(&claim.agent);
        let numbered =
            claim.algorithm.is_extended() && (claim.fenced || claim.algorithm.has_token());
        let fencing = numbered.then(|| owned.fencing.saturating_add(1));
        owned.holding = Some(Holding {
            watch: Watch::new(now, claim.heartbeat),
            claim,
            fencing,
            told: false,
        });
        let Some(fencing) = fencing else {
            return self.lend(now, resource);
        };
        owned.fencing = fencing;
        self.keep(resource, fencing, true);
    }

    fn keep(&mut self, resource: &Text, fencing: u64, held: bool) {
        self.post.put(Output::Persist {
            resource: resource.clone(),
            record: Record { fencing, held },
        });
    }

    /// The holder is told, and its lease begins.
    fn lend(&mut self, now: Duration, resource: &Text) {
        let owned = self.owned.get_mut(resource);
        let Some(holding) = owned.and_then(|owned| owned.holding.as_mut()) else {
            return;
        };
        holding.told = true;
        holding.watch = Watch::new(now, holding.claim.heartbeat);
        if holding.claim.agent != self.config.name {
            self.tell(resource);
            return self.probe_holder(now, resource);
        }
        let fencing = holding.fencing;
        if let Some(request) = self.requests.get_mut(resource)
            && request.phase == Phase::Confirming
            && request.algorithm.is_extended()
        {
            request.fencing = fencing;
            self.try_hold(now, resource);
        }
    }

    /// Says (again) that the resource is lent.
    fn tell(&mut self, resource: &Text) {
        let owned = self.owned.get(resource);
        let Some(holding) = owned.and_then(|owned| owned.holding.as_ref()) else {
            return;
        };
        if holding.claim.algorithm.has_token() {
            return self.lend_token(resource);
        }
        let Some(fencing) = holding.fencing else {
            return;
        };
        let claim = &holding.claim;
        let protocol = claim.algorithm.protocol();
        let act = Performative::Inform;
        let message = self.post.continued(act, protocol, &claim.conversation);
        let message = message
            .content(resource.clone().into_bytes())
            .user_defined(wire::FENCING, fencing.to_string())
            .user_defined(wire::HEARTBEAT, claim.heartbeat.as_millis().to_string());
        self.post.send(message, [claim.agent.clone()]);
    }

    /// An agent does not hold, or want, the resource any more.
    pub(super) fn given_back(
        &mut self,
        now: Duration,
        resource: &Text,
        agent: &Text,
        conversation: &Text,
        fencing: Option<u64>,
    ) {
        let max = self.config.max_participants;
        let Some(owned) = self.owned.get_mut(resource) else {
            return;
        };
        if owned.ended.len() < max || owned.ended.contains_key(agent) {
            owned.ended.insert(agent.clone(), conversation.clone());
        }
        let same = |claim: &Claim| claim.agent == *agent && claim.conversation == *conversation;
        owned.claims.retain(|claim| !same(claim));
        let holding = owned.holding.as_ref().filter(|holding| {
            let number = fencing.is_some() && holding.fencing == fencing;
            holding.claim.agent == *agent && (same(&holding.claim) || number)
        });
        if holding.is_some() {
            // It may want it once more already.
            if !owned.claims.iter().any(|claim| claim.agent == *agent) {
                owned.waiting.remove(agent);
            }
            self.free(now, resource);
        }
    }

    /// Nobody holds the resource any more: the next one gets it.
    pub(super) fn free(&mut self, now: Duration, resource: &Text) {
        let Some(owned) = self.owned.get_mut(resource) else {
            return;
        };
        owned.holding = None;
        let before = owned.fencing;
        self.grant_next(now, resource);
        let owned = self.owned.get(resource);
        if owned.is_some_and(|owned| owned.holding.is_none() && before > 0) {
            self.keep(resource, before, false);
        }
    }
}
