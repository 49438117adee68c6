//! What both algorithms have in common between a request and its grant.

use std::time::Duration;

use fipa_acl::Text;

use super::LockAgent;
use crate::request::Phase;
use crate::watch::{SILENCE, Watch};
use crate::{FailureReason, LossReason, Output};

impl LockAgent {
    /// The owner is known: the algorithm begins.
    pub(super) fn begin(&mut self, now: Duration, resource: &Text) {
        let owner = self.owner(resource);
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        let owner = owner.filter(|owner| *owner != self.config.name);
        request.participants.extend(owner);
        request.phase = Phase::Waiting;
        request.since = now;
        request.renewed = Some(now);
        request.repeat = now + request.heartbeat * SILENCE;
        if request.algorithm.has_token() {
            self.ask_for_token(now, resource);
        } else {
            self.ask_for_grants(now, resource);
        }
    }

    /// Watches an agent on which an extended request depends.
    pub(super) fn watch(&mut self, now: Duration, resource: &Text, agent: &Text) {
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        if request.algorithm.is_extended() {
            let watch = Watch::new(now, request.heartbeat);
            request.watches.entry(agent.clone()).or_insert(watch);
        }
    }

    /// Holds the resource if everything is there: the owner's word, and a lease that still runs.
    pub(super) fn try_hold(&mut self, now: Duration, resource: &Text) {
        let owned_here = self.owned.contains_key(resource);
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        if request.phase != Phase::Confirming || request.fencing.is_none() {
            return;
        }
        if owned_here || request.lease_runs(now) {
            self.hold(now, resource);
        } else if let Some(owner) = self.owner(resource) {
            self.probe(now, resource, &owner);
        }
    }

    pub(super) fn hold(&mut self, now: Duration, resource: &Text) {
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        request.phase = Phase::Held;
        request.since = now;
        let granted = Output::Granted {
            resource: resource.clone(),
            fencing: request.fencing,
        };
        self.post.put(granted);
    }

    /// The request ends without a grant.
    pub(super) fn fail(&mut self, now: Duration, resource: &Text, reason: FailureReason) {
        if matches!(
            reason,
            FailureReason::OwnerSilent | FailureReason::OwnerGone
        ) {
            self.owners.remove(resource);
        }
        self.release(now, resource);
        self.post.put(Output::Failed {
            resource: resource.clone(),
            reason,
        });
    }

    /// The grant ends before it was given back. The owner is told nothing: it waits one heartbeat
    /// longer, in which whatever used the resource can stop.
    pub(super) fn lose(&mut self, resource: &Text, reason: LossReason) {
        let Some(request) = self.requests.remove(resource) else {
            return;
        };
        if reason == LossReason::LeaseExpired {
            self.owners.remove(resource);
        }
        self.grant_deferred(resource, &request);
        self.post.put(Output::Lost {
            resource: resource.clone(),
            reason,
        });
    }
}
