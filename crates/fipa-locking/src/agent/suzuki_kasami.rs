//! The algorithm of Suzuki and Kasami: a request goes to all, and who has the token passes it on.

use std::time::Duration;

use fipa_acl::{Message, Performative, Text};

use super::LockAgent;
use crate::owned::Claim;
use crate::request::{Phase, Request};
use crate::token::Token;
use crate::{Algorithm, wire};

/// A token on its way.
struct Passing<'a> {
    algorithm: Algorithm,
    token: &'a Token,
    to: &'a Text,
    conversation: &'a str,
    fencing: Option<u64>,
    heartbeat: Option<Duration>,
}

impl LockAgent {
    pub(super) fn ask_for_token(&mut self, now: Duration, resource: &Text) {
        let owner = self.owner(resource);
        let chain = self.chains.entry(resource.clone()).or_default();
        chain.own = chain.own.saturating_add(1);
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        request.stamp = chain.own;
        if !request.algorithm.is_extended() {
            request.token = chain.token.take();
            if request.token.is_some() {
                return self.hold(now, resource);
            }
        } else if owner.as_ref() == Some(&self.config.name) {
            request.phase = Phase::Confirming;
            return self.claim_own(now, resource);
        }
        let message = self.token_request(resource, None);
        let Some((message, request)) = message.zip(self.requests.get_mut(resource)) else {
            return;
        };
        request.conversation = Text::from(wire::conversation(&message).unwrap_or_default());
        self.post
            .send(message, request.participants.iter().cloned());
        if let Some(owner) = owner {
            self.watch(now, resource, &owner);
            self.probe_due(now, resource);
        }
    }

    /// Says the request once more to the owner, through whom the token goes.
    pub(super) fn repeat_token_request(&mut self, resource: &Text) {
        let conversation = self.requests.get(resource);
        let conversation = conversation.map(|request| request.conversation.clone());
        let message = self.token_request(resource, conversation);
        if let Some((message, owner)) = message.zip(self.owner(resource)) {
            self.post.send(message, [owner]);
        }
    }

    fn token_request(&mut self, resource: &Text, conversation: Option<Text>) -> Option<Message> {
        let request = self.requests.get(resource)?;
        let protocol = request.algorithm.protocol();
        let message = match conversation {
            Some(id) => self.post.continued(Performative::Request, protocol, &id),
            None => self.post.open(Performative::Request, protocol),
        };
        let message = message.content(format!("{resource}\n{}", request.stamp));
        Some(if request.algorithm.is_extended() {
            let millis = request.heartbeat.as_millis().to_string();
            message.user_defined(wire::HEARTBEAT, millis)
        } else {
            message
        })
    }

    pub(super) fn handle_suzuki_kasami(
        &mut self,
        now: Duration,
        algorithm: Algorithm,
        from: &Text,
        message: &Message,
    ) -> Option<()> {
        let conversation = Text::from(wire::conversation(message)?);
        match message.performative {
            Performative::Request => {
                let (resource, sequence) = wire::numbered(message)?;
                let heartbeat = wire::heartbeat(message);
                let claim = Claim {
                    agent: from.clone(),
                    conversation,
                    algorithm,
                    fenced: heartbeat.is_some(),
                    heartbeat: heartbeat
                        .unwrap_or(self.config.heartbeat)
                        .min(self.config.heartbeat),
                    sequence,
                };
                self.token_wanted(now, &resource, claim);
            }
            Performative::Propagate => {
                let text = message.content_str()?;
                let token = Token::decode(text, self.config.max_participants).ok()?;
                self.token_came(now, algorithm, from, &conversation, message, token);
            }
            Performative::Refuse => self.refused(now, from, &conversation, message),
            _ => {}
        }
        Some(())
    }

    fn token_wanted(&mut self, now: Duration, resource: &Text, claim: Claim) {
        let full = self.chains.len() >= self.config.max_resources;
        if full && !self.chains.contains_key(resource) {
            return;
        }
        let chain = self.chains.entry(resource.clone()).or_default();
        let known = chain.heard.contains_key(&claim.agent);
        if known || chain.heard.len() < self.config.max_participants {
            let heard = (claim.sequence, claim.conversation.clone());
            chain.heard.insert(claim.agent.clone(), heard);
        }
        if claim.algorithm.is_extended() {
            return self.claim(now, resource, claim);
        }
        let Some(mut token) = chain.token.take() else {
            return;
        };
        let served = token.served.entry(claim.agent.clone()).or_insert(0);
        if served.checked_add(1) == Some(claim.sequence) {
            self.pass(&Passing {
                algorithm: claim.algorithm,
                token: &token,
                to: &claim.agent,
                conversation: &claim.conversation,
                fencing: None,
                heartbeat: None,
            });
        } else {
            chain.token = Some(token);
        }
    }

    fn token_came(
        &mut self,
        now: Duration,
        algorithm: Algorithm,
        from: &Text,
        conversation: &Text,
        message: &Message,
        token: Token,
    ) {
        let resource = token.resource.clone();
        let fencing = wire::number(message, wire::FENCING);
        let extended = algorithm.is_extended();
        if extended && self.owned.contains_key(&resource) {
            return self.token_returned(now, &resource, from, token, fencing);
        }
        let from_owner = self.owners.get(&resource) == Some(from);
        let request = self.requests.get_mut(&resource);
        let request = request.filter(|request| request.algorithm == algorithm);
        let Some(request) = request.filter(|request| request.phase != Phase::Discovering) else {
            return self.token_unwanted(algorithm, from, conversation, fencing, token);
        };
        if !extended {
            if request.phase == Phase::Waiting {
                request.token = Some(token);
                self.hold(now, &resource);
            }
        } else if fencing.is_some() && request.conversation != *conversation {
            // It was lent for an earlier request.
            self.token_unwanted(algorithm, from, conversation, fencing, token);
        } else if from_owner && request.phase != Phase::Held {
            request.token = Some(token);
            request.fencing = fencing;
            request.fenced = Some(fencing.is_some());
            if fencing.is_none() {
                request.renewed = Some(now);
                return self.hold(now, &resource);
            }
            // It was lent after this request was made, and so was the lease.
            request.shorten_heartbeat(wire::heartbeat(message));
            request.phase = Phase::Confirming;
            self.try_hold(now, &resource);
        }
    }

    /// A token for which we do not wait any more.
    fn token_unwanted(
        &mut self,
        algorithm: Algorithm,
        from: &Text,
        conversation: &Text,
        fencing: Option<u64>,
        token: Token,
    ) {
        if algorithm.is_extended() {
            self.pass(&Passing {
                algorithm,
                token: &token,
                to: from,
                conversation,
                fencing,
                heartbeat: None,
            });
        } else if self.chains.contains_key(&token.resource) {
            self.pass_on(algorithm, token);
        }
    }

    pub(super) fn release_token(&mut self, now: Duration, resource: &Text, request: Request) {
        let owner = self.owner(resource);
        if request.algorithm.is_extended() && owner.as_ref() == Some(&self.config.name) {
            let name = self.config.name.clone();
            return self.given_back(now, resource, &name, &request.conversation, None);
        }
        let Some(mut token) = request.token else {
            return;
        };
        token.served.insert(self.config.name.clone(), request.stamp);
        if !request.algorithm.is_extended() {
            return self.pass_on(request.algorithm, token);
        }
        let Some(owner) = owner else {
            return;
        };
        self.queue_waiting(&mut token);
        let heard = self.chains.get(resource);
        let asked = heard.and_then(|chain| chain.heard.get(&owner));
        let conversation = asked.map_or(&request.conversation, |(_, id)| id).clone();
        self.pass(&Passing {
            algorithm: request.algorithm,
            token: &token,
            to: &owner,
            conversation: &conversation,
            fencing: request.fencing,
            heartbeat: None,
        });
    }

    /// Whoever has asked since is served next, in the order of the names.
    fn queue_waiting(&self, token: &mut Token) {
        let Some(chain) = self.chains.get(&token.resource) else {
            return;
        };
        for (agent, (sequence, _)) in &chain.heard {
            let served = token.served.entry(agent.clone()).or_insert(0);
            if served.checked_add(1) == Some(*sequence) && !token.queue.contains(agent) {
                *served = *sequence;
                token.queue.push_back(agent.clone());
            }
        }
    }

    /// The plain algorithm: the token goes to the next one, or stays here.
    fn pass_on(&mut self, algorithm: Algorithm, mut token: Token) {
        self.queue_waiting(&mut token);
        let next = token.queue.pop_front();
        let Some(chain) = self.chains.get_mut(&token.resource) else {
            return;
        };
        let asked = next.and_then(|agent| Some((chain.heard.get(&agent)?.1.clone(), agent)));
        let Some((conversation, to)) = asked else {
            chain.token = Some(token);
            return;
        };
        self.pass(&Passing {
            algorithm,
            token: &token,
            to: &to,
            conversation: &conversation,
            fencing: None,
            heartbeat: None,
        });
    }

    fn pass(&mut self, passing: &Passing<'_>) {
        let protocol = passing.algorithm.protocol();
        let act = Performative::Propagate;
        let message = self.post.continued(act, protocol, passing.conversation);
        let mut message = message
            .language(wire::TOKEN_LANGUAGE)
            .content(passing.token.encode());
        if let Some(fencing) = passing.fencing {
            message = message.user_defined(wire::FENCING, fencing.to_string());
        }
        if let Some(heartbeat) = passing.heartbeat {
            let millis = heartbeat.as_millis().to_string();
            message = message.user_defined(wire::HEARTBEAT, millis);
        }
        self.post.send(message, [passing.to.clone()]);
    }

    /// The owner lends the token.
    pub(super) fn lend_token(&mut self, resource: &Text) {
        let Some(owned) = self.owned.get(resource) else {
            return;
        };
        let Some(holding) = &owned.holding else {
            return;
        };
        let claim = holding.claim.clone();
        let mut token = owned.token.clone();
        let queued = owned.claims.iter();
        let queued = queued.filter(|claim| claim.algorithm.has_token());
        token.queue = queued.map(|claim| claim.agent.clone()).collect();
        let fencing = holding.fencing;
        self.pass(&Passing {
            algorithm: claim.algorithm,
            token: &token,
            to: &claim.agent,
            conversation: &claim.conversation,
            fencing,
            heartbeat: Some(claim.heartbeat).filter(|_| claim.fenced),
        });
    }

    fn token_returned(
        &mut self,
        now: Duration,
        resource: &Text,
        from: &Text,
        token: Token,
        fencing: Option<u64>,
    ) {
        let Some(owned) = self.owned.get_mut(resource) else {
            return;
        };
        let lent = owned.holding.as_ref().filter(|holding| {
            let same = fencing.map_or(!holding.claim.fenced, |n| holding.fencing == Some(n));
            holding.claim.agent == *from && same
        });
        let Some(conversation) = lent.map(|holding| holding.claim.conversation.clone()) else {
            // One that was taken for dead had it; another one was made since.
            return;
        };
        owned.token.served = token.served;
        for claim in owned.claims.iter().filter(|c| c.algorithm.has_token()) {
            let agent = claim.agent.clone();
            owned.token.served.insert(agent, claim.sequence);
        }
        self.given_back(now, resource, from, &conversation, fencing);
    }
}
