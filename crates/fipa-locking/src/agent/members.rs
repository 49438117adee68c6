//! Agents that come, go, and are not reached.

use std::time::Duration;

use fipa_acl::Text;

use super::LockAgent;
use crate::request::{Phase, Request};
use crate::{FailureReason, LossReason, Output};

impl LockAgent {
    /// The agents that may want a requested resource changed. Whoever came is asked at once;
    /// whoever is missing now is asked no more, but may still hold the resource: it is waited for
    /// until it is known to be [`gone`](Self::agent_gone) or silent for four heartbeats.
    pub fn set_participants(
        &mut self,
        now: Duration,
        resource: &str,
        participants: impl IntoIterator<Item = Text>,
    ) {
        let participants = self.others(participants);
        let Some((resource, request)) = self.requests.get_key_value(resource) else {
            return;
        };
        let (resource, phase) = (resource.clone(), request.phase);
        let known = &request.participants;
        let joiners: Vec<Text> = participants.difference(known).cloned().collect();
        if phase != Phase::Discovering {
            for joiner in joiners {
                self.ask_joiner(now, &resource, &joiner);
            }
            return;
        }
        if let Some(request) = self.requests.get_mut(&resource) {
            request.participants = participants;
            self.ask_for_owner(&resource, joiners);
        }
    }

    /// An agent is certainly gone: it, or the daemon that it was attached to, has said so. One
    /// that is only not heard of, or not in the directory any more, may still hold something; its
    /// lease takes care of it.
    pub fn agent_gone(&mut self, now: Duration, name: &str) {
        let owned: Vec<Text> = self.owned.keys().cloned().collect();
        for resource in owned {
            let Some(owned) = self.owned.get_mut(&resource) else {
                continue;
            };
            owned.forget(name);
            if owned.is_held_by(name) {
                self.free(now, &resource);
            }
        }
        for chain in self.chains.values_mut() {
            chain.heard.remove(name);
        }
        let requested: Vec<Text> = self.requests.keys().cloned().collect();
        for resource in requested {
            self.participant_gone(now, &resource, name);
        }
        let held = |resource: &Text| self.requests.contains_key(resource);
        self.owners
            .retain(|resource, owner| owner != name || held(resource));
    }

    fn participant_gone(&mut self, now: Duration, resource: &Text, name: &str) {
        let owner = self.owners.get(resource).is_some_and(|owner| owner == name);
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        if owner {
            // A lease that runs is kept: the owner may come back before it ends.
            if request.phase != Phase::Held {
                self.fail(now, resource, FailureReason::OwnerGone);
            }
            return;
        }
        drop_participant(request, name);
        request.deferred.remove(name);
        self.confirm_if_granted(now, resource);
    }

    /// A message of a conversation did not reach an agent. In a plain algorithm that agent counts
    /// as dead, as in the C++ library; in an extended one the message is said again.
    pub fn delivery_failed(&mut self, now: Duration, to: &str, conversation: &str) {
        let mut requests = self.requests.iter_mut();
        let found = requests.find(|(_, request)| request.conversation == *conversation);
        let Some((resource, request)) = found else {
            return;
        };
        if request.algorithm.is_extended() {
            request.repeat = request.repeat.min(now + request.heartbeat);
            return;
        }
        let resource = resource.clone();
        if self.owners.get(&resource).is_some_and(|owner| owner == to) {
            if request.phase == Phase::Waiting {
                self.fail(now, &resource, FailureReason::OwnerSilent);
            }
            return;
        }
        drop_participant(request, to);
        self.confirm_if_granted(now, &resource);
    }

    /// The connection to the other agents ended, which take us for dead from now on: everything
    /// that is held is lost, and everything that is waited for fails.
    pub fn disconnected(&mut self) {
        for (resource, request) in std::mem::take(&mut self.requests) {
            self.post.put(if request.phase == Phase::Held {
                Output::Lost {
                    resource,
                    reason: LossReason::Disconnected,
                }
            } else {
                Output::Failed {
                    resource,
                    reason: FailureReason::Disconnected,
                }
            });
        }
    }
}

/// The request does without this agent's grant.
pub(super) fn drop_participant(request: &mut Request, name: &str) {
    request.participants.remove(name);
    request.owed.remove(name);
    request.watches.remove(name);
}
