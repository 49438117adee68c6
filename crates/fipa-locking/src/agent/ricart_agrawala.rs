//! The algorithm of Ricart and Agrawala: a request goes to all, and all have to agree.

use std::time::Duration;

use fipa_acl::{Message, Performative, Text};

use super::LockAgent;
use crate::owned::Claim;
use crate::request::{Phase, Request};
use crate::{Algorithm, FailureReason, wire};

impl LockAgent {
    pub(super) fn ask_for_grants(&mut self, now: Duration, resource: &Text) {
        self.clock = self.clock.saturating_add(1);
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        request.stamp = self.clock;
        request.owed = request.participants.clone();
        let protocol = request.algorithm.protocol();
        let message = self.post.open(Performative::Request, protocol);
        request.conversation = Text::from(wire::conversation(&message).unwrap_or_default());
        let message = message.content(format!("{}\n{resource}", request.stamp));
        let asked = request.owed.clone();
        self.post.send(message, asked.iter().cloned());
        for agent in &asked {
            self.watch(now, resource, agent);
        }
        self.probe_due(now, resource);
        self.confirm_if_granted(now, resource);
    }

    /// Says the request once more to some.
    pub(super) fn repeat_request(&mut self, resource: &Text, to: impl IntoIterator<Item = Text>) {
        let Some(request) = self.requests.get(resource) else {
            return;
        };
        let protocol = request.algorithm.protocol();
        let conversation = request.conversation.clone();
        let message = self
            .post
            .continued(Performative::Request, protocol, &conversation);
        let message = message.content(format!("{}\n{resource}", request.stamp));
        self.post.send(message, to);
    }

    pub(super) fn handle_ricart_agrawala(
        &mut self,
        now: Duration,
        algorithm: Algorithm,
        from: &Text,
        message: &Message,
    ) -> Option<()> {
        let conversation = Text::from(wire::conversation(message)?);
        match message.performative {
            Performative::Request => {
                let (clock, resource) = wire::stamped(message)?;
                self.tell_clock(clock);
                self.wanted(now, algorithm, &resource, clock, from, conversation);
            }
            Performative::Agree => {
                let (clock, resource) = wire::stamped(message)?;
                self.tell_clock(clock);
                self.agreed(now, &resource, from, &conversation);
            }
            Performative::Inform => {
                let resource = wire::resource(message)?;
                self.numbered(now, algorithm, &resource, from, &conversation, message);
            }
            Performative::Confirm => {
                let resource = wire::resource(message)?;
                let heartbeat = wire::heartbeat(message).unwrap_or(self.config.heartbeat);
                let claim = Claim {
                    agent: from.clone(),
                    conversation,
                    algorithm,
                    fenced: wire::number(message, wire::FENCING) == Some(0),
                    heartbeat: heartbeat.min(self.config.heartbeat),
                    sequence: 0,
                };
                self.claim(now, &resource, claim);
            }
            Performative::Disconfirm => {
                let resource = wire::resource(message)?;
                let fencing = wire::number(message, wire::FENCING);
                self.given_back(now, &resource, from, &conversation, fencing);
            }
            Performative::Refuse => self.refused(now, from, &conversation, message),
            _ => {}
        }
        Some(())
    }

    fn tell_clock(&mut self, other: u64) {
        self.clock = self.clock.max(other).saturating_add(1);
    }

    /// Another agent asks for our grant.
    fn wanted(
        &mut self,
        now: Duration,
        algorithm: Algorithm,
        resource: &Text,
        stamp: u64,
        from: &Text,
        conversation: Text,
    ) {
        self.note_waiting(now, resource, from);
        let name = self.config.name.clone();
        let max = self.config.max_participants;
        let request = self.requests.get_mut(resource);
        let Some(request) = request.filter(|request| request.algorithm == algorithm) else {
            return self.grant(algorithm, resource, from, &conversation);
        };
        let earlier = (stamp, from) < (request.stamp, &name);
        match request.phase {
            Phase::Discovering => return self.grant(algorithm, resource, from, &conversation),
            Phase::Waiting if earlier => self.grant(algorithm, resource, from, &conversation),
            _ if request.deferred.len() < max || request.deferred.contains_key(from) => {
                request.deferred.insert(from.clone(), conversation);
            }
            // It asks again.
            _ => {}
        }
        self.ask_joiner(now, resource, from);
    }

    /// While we wait, whoever is new has to agree as well.
    pub(super) fn ask_joiner(&mut self, now: Duration, resource: &Text, joiner: &Text) {
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        let waits = request.phase == Phase::Waiting && !request.algorithm.has_token();
        let full = request.participants.len() >= self.config.max_participants;
        if waits && !full && request.participants.insert(joiner.clone()) {
            request.owed.insert(joiner.clone());
            self.repeat_request(resource, [joiner.clone()]);
            self.watch(now, resource, joiner);
            self.probe_due(now, resource);
        }
    }

    fn grant(&mut self, algorithm: Algorithm, resource: &Text, to: &Text, conversation: &Text) {
        self.clock = self.clock.saturating_add(1);
        let protocol = algorithm.protocol();
        let grant = self
            .post
            .continued(Performative::Agree, protocol, conversation);
        let grant = grant.content(format!("{}\n{resource}", self.clock));
        self.post.send(grant, [to.clone()]);
    }

    pub(super) fn grant_deferred(&mut self, resource: &Text, request: &Request) {
        for (agent, conversation) in &request.deferred {
            self.grant(request.algorithm, resource, agent, conversation);
        }
    }

    fn agreed(&mut self, now: Duration, resource: &Text, from: &Text, conversation: &Text) {
        let owner = self.owner(resource);
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        if request.phase != Phase::Waiting || request.conversation != *conversation {
            return;
        }
        request.owed.remove(from);
        if owner.as_ref() != Some(from) {
            request.watches.remove(from);
        }
        self.confirm_if_granted(now, resource);
    }

    /// With all grants, the owner is told, and in the extended algorithm asked.
    pub(super) fn confirm_if_granted(&mut self, now: Duration, resource: &Text) {
        let owner = self.owner(resource);
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        let waits = request.phase == Phase::Waiting && !request.algorithm.has_token();
        if !waits || !request.owed.is_empty() {
            return;
        }
        request.phase = Phase::Confirming;
        request.since = now;
        request.renewed = Some(now);
        request.repeat = now + request.heartbeat;
        let extended = request.algorithm.is_extended();
        if owner.as_ref() != Some(&self.config.name) {
            self.send_confirm(resource);
        } else {
            self.claim_own(now, resource);
        }
        if !extended {
            self.hold(now, resource);
        }
    }

    pub(super) fn send_confirm(&mut self, resource: &Text) {
        let (Some(owner), Some(request)) = (self.owner(resource), self.requests.get(resource))
        else {
            return;
        };
        let protocol = request.algorithm.protocol();
        let confirm = self
            .post
            .continued(Performative::Confirm, protocol, &request.conversation);
        let mut confirm = confirm.content(resource.clone().into_bytes());
        if request.algorithm.is_extended() {
            let millis = request.heartbeat.as_millis();
            confirm = confirm
                .user_defined(wire::FENCING, "0")
                .user_defined(wire::HEARTBEAT, millis.to_string());
        }
        self.post.send(confirm, [owner]);
    }

    /// The owner answers our `confirm` with a number.
    fn numbered(
        &mut self,
        now: Duration,
        algorithm: Algorithm,
        resource: &Text,
        from: &Text,
        conversation: &Text,
        message: &Message,
    ) {
        let Some(fencing) = wire::number(message, wire::FENCING) else {
            return;
        };
        let current = self.requests.get_mut(resource);
        let current = current.filter(|request| request.conversation == *conversation);
        let Some(request) = current else {
            // We gave it back before the owner lent it.
            let back = (resource, from, conversation);
            return self.send_disconfirm(algorithm, back, Some(fencing));
        };
        if request.phase == Phase::Confirming && self.owners.get(resource) == Some(from) {
            request.fenced = Some(true);
            request.fencing = Some(fencing);
            request.shorten_heartbeat(wire::heartbeat(message));
            self.try_hold(now, resource);
        }
    }

    pub(super) fn release_grants(&mut self, now: Duration, resource: &Text, request: Request) {
        self.grant_deferred(resource, &request);
        if !matches!(request.phase, Phase::Confirming | Phase::Held) {
            return;
        }
        let Some(owner) = self.owner(resource) else {
            return;
        };
        if owner == self.config.name {
            let name = self.config.name.clone();
            self.given_back(now, resource, &name, &request.conversation, None);
        } else {
            let back = (resource, &owner, &request.conversation);
            self.send_disconfirm(request.algorithm, back, request.fencing);
        }
    }

    fn send_disconfirm(
        &mut self,
        algorithm: Algorithm,
        (resource, owner, conversation): (&Text, &Text, &Text),
        fencing: Option<u64>,
    ) {
        let protocol = algorithm.protocol();
        let message = self
            .post
            .continued(Performative::Disconfirm, protocol, conversation);
        let mut message = message.content(resource.clone().into_bytes());
        if let Some(fencing) = fencing {
            message = message.user_defined(wire::FENCING, fencing.to_string());
        }
        self.post.send(message, [owner.clone()]);
    }

    /// The owner does not lend it.
    pub(super) fn refused(
        &mut self,
        now: Duration,
        from: &Text,
        conversation: &Text,
        message: &Message,
    ) {
        let ours = |(_, request): &(&Text, &Request)| request.conversation == *conversation;
        let Some((resource, _)) = self.requests.iter().find(ours) else {
            return;
        };
        if self.owners.get(resource) == Some(from) {
            let resource = resource.clone();
            let reason = Text::from(message.content_str().unwrap_or_default());
            self.fail(now, &resource, FailureReason::Refused(reason));
        }
    }
}
