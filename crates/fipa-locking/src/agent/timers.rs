//! What happens when nothing comes.

use std::time::Duration;

use fipa_acl::Text;

use super::LockAgent;
use super::members::drop_participant;
use crate::request::{Phase, Request};
use crate::watch::SILENCE;
use crate::{FailureReason, LossReason};

impl LockAgent {
    /// When [`handle_timeout`](Self::handle_timeout) wants to be called.
    pub fn poll_timeout(&self) -> Option<Duration> {
        let requests = self.requests.iter();
        let requests = requests.flat_map(|(resource, request)| self.deadlines(resource, request));
        let owned = self.owned.values().flat_map(|owned| {
            let others = owned
                .holding
                .as_ref()
                .filter(|holding| holding.told && holding.claim.agent != self.config.name);
            let watch = others.map(|holding| &holding.watch);
            let silence = self.config.heartbeat * SILENCE;
            let waiting = owned.waiting.values().map(|heard| *heard + silence).min();
            let quarantine = owned.quarantine;
            let watched = watch.map(|watch| watch.next.min(watch.dead_at()));
            [watched, waiting, quarantine].into_iter().flatten()
        });
        requests.chain(owned).min()
    }

    fn deadlines<'a>(
        &'a self,
        resource: &'a Text,
        request: &'a Request,
    ) -> impl Iterator<Item = Duration> + 'a {
        let extended = request.algorithm.is_extended();
        let phase = request.phase;
        let give_up =
            (phase == Phase::Discovering).then(|| request.since + request.heartbeat * SILENCE);
        let repeats = phase == Phase::Discovering || (extended && self.repeats(resource, request));
        let repeat = repeats.then_some(request.repeat);
        let lease = request
            .lease_end()
            .filter(|_| phase == Phase::Held && self.is_leased(resource, request));
        let unnumbered = self
            .is_unnumbered(request)
            .then(|| request.since + request.heartbeat);
        let fixed = [give_up, repeat, lease, unnumbered];
        let watches = request.watches.iter().map(move |(agent, watch)| {
            let counts = phase != Phase::Held && !self.may_hold(resource, request, agent);
            if counts {
                watch.next.min(watch.dead_at())
            } else {
                watch.next
            }
        });
        fixed.into_iter().flatten().chain(watches)
    }

    /// Whether something is said again: while an answer is missing.
    fn repeats(&self, resource: &Text, request: &Request) -> bool {
        let elsewhere = !self.owned.contains_key(resource);
        match request.phase {
            Phase::Discovering => true,
            Phase::Waiting => true,
            Phase::Confirming => elsewhere && request.fencing.is_none(),
            Phase::Held => false,
        }
    }

    /// Whether an owner that issues no numbers was told that we have all grants.
    fn is_unnumbered(&self, request: &Request) -> bool {
        request.phase == Phase::Confirming && request.fenced == Some(false)
    }

    /// Whether the owner's latest answer names this agent: then it is waited for, silent or not.
    fn may_hold(&self, resource: &Text, request: &Request, agent: &Text) -> bool {
        match self.owned.get(resource) {
            Some(owned) => owned.is_held_by(agent),
            None => request.named.as_ref() == Some(agent),
        }
    }

    /// The time has come.
    pub fn handle_timeout(&mut self, now: Duration) {
        // First what we own: whom our own requests wait for depends on who holds it.
        let owned: Vec<Text> = self.owned.keys().cloned().collect();
        for resource in owned {
            self.owned_timeout(now, &resource);
        }
        let requested: Vec<Text> = self.requests.keys().cloned().collect();
        for resource in requested {
            self.request_timeout(now, &resource);
        }
    }

    fn request_timeout(&mut self, now: Duration, resource: &Text) {
        let Some(request) = self.requests.get(resource) else {
            return;
        };
        match request.phase {
            Phase::Discovering if request.since + request.heartbeat * SILENCE <= now => {
                return self.fail(now, resource, FailureReason::NoOwner);
            }
            Phase::Discovering if request.repeat <= now => return self.discover(now, resource),
            Phase::Held if self.is_leased(resource, request) && !request.lease_runs(now) => {
                return self.lose(resource, LossReason::LeaseExpired);
            }
            _ => {}
        }
        if !request.algorithm.is_extended() {
            return;
        }
        if request.phase != Phase::Held && !self.bury_silent(now, resource) {
            return;
        }
        self.probe_due(now, resource);
        let Some(request) = self.requests.get(resource) else {
            return;
        };
        if self.is_unnumbered(request) && request.since + request.heartbeat <= now {
            return self.hold(now, resource);
        }
        self.repeat_due(now, resource);
    }

    /// Does without those that are silent. Whether the owner is not one of them.
    fn bury_silent(&mut self, now: Duration, resource: &Text) -> bool {
        let Some(request) = self.requests.get(resource) else {
            return false;
        };
        let silent = request.watches.iter().filter(|(agent, watch)| {
            watch.is_silent(now) && !self.may_hold(resource, request, agent)
        });
        let silent: Vec<Text> = silent.map(|(agent, _)| agent.clone()).collect();
        let owner = self.owners.get(resource);
        if silent.iter().any(|agent| Some(agent) == owner) {
            self.fail(now, resource, FailureReason::OwnerSilent);
            return false;
        }
        if let Some(request) = self.requests.get_mut(resource) {
            for agent in &silent {
                drop_participant(request, agent);
            }
        }
        self.confirm_if_granted(now, resource);
        true
    }

    fn repeat_due(&mut self, now: Duration, resource: &Text) {
        let Some(request) = self.requests.get(resource) else {
            return;
        };
        if request.repeat > now || !self.repeats(resource, request) {
            return;
        }
        let (phase, token) = (request.phase, request.algorithm.has_token());
        let (owed, heartbeat) = (request.owed.clone(), request.heartbeat);
        match (phase, token) {
            (Phase::Confirming, false) => self.send_confirm(resource),
            (_, true) => self.repeat_token_request(resource),
            (_, false) => self.repeat_request(resource, owed),
        }
        let span = if phase == Phase::Confirming {
            heartbeat
        } else {
            heartbeat * SILENCE
        };
        if let Some(request) = self.requests.get_mut(resource) {
            request.repeat = now + span;
        }
    }

    fn owned_timeout(&mut self, now: Duration, resource: &Text) {
        let silence = self.config.heartbeat * SILENCE;
        let name = self.config.name.clone();
        let Some(owned) = self.owned.get_mut(resource) else {
            return;
        };
        owned.waiting.retain(|_, heard| *heard + silence > now);
        if owned.quarantine.is_some_and(|until| until <= now) {
            self.grant_next(now, resource);
        }
        let owned = self.owned.get(resource);
        let Some(holding) = owned.and_then(|owned| owned.holding.as_ref()) else {
            return;
        };
        if !holding.told || holding.claim.agent == name {
            return;
        }
        if holding.watch.is_silent(now) {
            self.free(now, resource);
        } else if holding.watch.is_due(now) {
            self.probe_holder(now, resource);
        }
    }
}
