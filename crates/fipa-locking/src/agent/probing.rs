//! Probes: whether others live, whether we still hold, and who holds.

use std::time::Duration;

use fipa_acl::{Message, Performative, Text};

use super::LockAgent;
use crate::owned::{Claim, Holding};
use crate::request::{Phase, Request};
use crate::watch::{Probe, Watch};
use crate::{Algorithm, LossReason, wire};

impl LockAgent {
    /// Probes an agent on which a request depends.
    pub(super) fn probe(&mut self, now: Duration, resource: &Text, agent: &Text) {
        let owner = self.owners.get(resource) == Some(agent);
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        let fencing = request.proven_number();
        let Some(watch) = request.watches.get_mut(agent) else {
            return;
        };
        let mut probe = self.post.open(Performative::Request, wire::PROBE);
        watch.sent(Probe {
            conversation: Text::from(wire::conversation(&probe).unwrap_or_default()),
            sent: now,
            fencing: fencing.filter(|_| owner),
        });
        if owner {
            probe = probe.user_defined(wire::RESOURCE, resource.clone());
            if let Some(fencing) = fencing {
                probe = probe.user_defined(wire::FENCING, fencing.to_string());
            }
        }
        self.post.send(probe, [agent.clone()]);
    }

    /// Probes all whose turn it is.
    pub(super) fn probe_due(&mut self, now: Duration, resource: &Text) {
        let Some(request) = self.requests.get(resource) else {
            return;
        };
        let due = request
            .watches
            .iter()
            .filter(|(_, watch)| watch.is_due(now));
        let due: Vec<Text> = due.map(|(agent, _)| agent.clone()).collect();
        for agent in due {
            self.probe(now, resource, &agent);
        }
    }

    /// The owner asks the holder whether it is one.
    pub(super) fn probe_holder(&mut self, now: Duration, resource: &Text) {
        let owned = self.owned.get_mut(resource);
        let Some(holding) = owned.and_then(|owned| owned.holding.as_mut()) else {
            return;
        };
        if !holding.told || holding.claim.agent == self.config.name {
            return;
        }
        let mut probe = self.post.open(Performative::Request, wire::PROBE);
        holding.watch.sent(Probe {
            conversation: Text::from(wire::conversation(&probe).unwrap_or_default()),
            sent: now,
            fencing: holding.fencing,
        });
        let claim = &holding.claim;
        if let (true, Some(fencing)) = (claim.fenced, holding.fencing) {
            probe = probe
                .user_defined(wire::RESOURCE, resource.clone())
                .user_defined(wire::FENCING, fencing.to_string());
            if !claim.conversation.is_empty() {
                probe = probe.user_defined(wire::CONVERSATION, claim.conversation.clone());
            }
        }
        self.post.send(probe, [claim.agent.clone()]);
    }

    pub(super) fn handle_probe(
        &mut self,
        now: Duration,
        from: &Text,
        message: &Message,
    ) -> Option<()> {
        let conversation = wire::conversation(message)?;
        match message.performative {
            Performative::Request => self.answer_probe(now, from, conversation, message),
            Performative::Confirm => self.probe_answered(now, from, conversation, message),
            _ => {}
        }
        Some(())
    }

    fn answer_probe(&mut self, now: Duration, from: &Text, conversation: &str, probe: &Message) {
        let answer = Performative::Confirm;
        let mut answer = self.post.continued(answer, wire::PROBE, conversation);
        match wire::parameter(probe, wire::RESOURCE) {
            Some(resource) if self.owned.contains_key(resource) => {
                let resource = Text::from(resource);
                self.renew(now, &resource, from, probe);
                answer = self.name_holder(now, &resource, from, answer);
            }
            Some(resource) => {
                if let Some(number) = self.own_number(resource, probe) {
                    answer = answer.user_defined(wire::FENCING, number.to_string());
                }
            }
            None => {
                let all: Vec<Text> = self.owned.keys().cloned().collect();
                for resource in all {
                    answer = self.name_holder(now, &resource, from, answer);
                }
            }
        }
        self.post.send(answer, [from.clone()]);
    }

    fn name_holder(
        &mut self,
        now: Duration,
        resource: &Text,
        to: &Text,
        answer: Message,
    ) -> Message {
        let Some(owned) = self.owned.get_mut(resource) else {
            return answer;
        };
        if let Some(heard) = owned.waiting.get_mut(to) {
            *heard = now;
        }
        let Some(holding) = &owned.holding else {
            return answer.user_defined(wire::HOLDER, wire::NOBODY);
        };
        let answer = answer.user_defined(wire::HOLDER, holding.claim.agent.clone());
        match holding.fencing.filter(|_| holding.told) {
            Some(fencing) => answer.user_defined(wire::FENCING, fencing.to_string()),
            None => answer,
        }
    }

    /// A holder that names its number keeps the resource; so it does when we have forgotten it.
    fn renew(&mut self, now: Duration, resource: &Text, from: &Text, probe: &Message) {
        let fencing = wire::number(probe, wire::FENCING);
        let heartbeat = self.config.heartbeat;
        let Some(owned) = self.owned.get_mut(resource) else {
            return;
        };
        if fencing.is_none() {
            return;
        }
        match &mut owned.holding {
            Some(holding) if holding.claim.agent == *from && holding.fencing == fencing => {
                holding.watch.heard = now;
            }
            None if owned.quarantine.is_some() && fencing == Some(owned.fencing) => {
                owned.quarantine = None;
                owned.holding = Some(Holding {
                    claim: Claim {
                        agent: from.clone(),
                        conversation: Text::default(),
                        algorithm: Algorithm::RicartAgrawalaExtended,
                        fenced: true,
                        heartbeat,
                        sequence: 0,
                    },
                    fencing,
                    told: true,
                    watch: Watch::new(now, heartbeat),
                });
            }
            _ => {}
        }
    }

    /// What a holder says to the owner that asks whether it still is one: its number, 0 if it is
    /// none, and nothing while our word may be on its way.
    fn own_number(&self, resource: &str, probe: &Message) -> Option<u64> {
        wire::number(probe, wire::FENCING)?;
        let Some(request) = self.requests.get(resource) else {
            return Some(0);
        };
        let asked = wire::parameter(probe, wire::CONVERSATION);
        if asked.is_some_and(|asked| request.conversation != *asked) && request.fencing.is_none() {
            return Some(0);
        }
        request.fencing
    }

    fn probe_answered(&mut self, now: Duration, from: &Text, conversation: &str, answer: &Message) {
        self.holder_answered(now, from, conversation, answer);
        let mut answered = None;
        for (resource, request) in &mut self.requests {
            if let Some(watch) = request.watches.get_mut(from)
                && let Some(probe) = watch.answered(now, conversation)
            {
                answered = Some((resource.clone(), probe));
            }
        }
        if let Some((resource, probe)) = answered
            && self.owners.get(&resource) == Some(from)
        {
            self.owner_answered(now, &resource, &probe, answer);
        }
    }

    fn holder_answered(
        &mut self,
        now: Duration,
        from: &Text,
        conversation: &str,
        answer: &Message,
    ) {
        let fencing = wire::number(answer, wire::FENCING);
        let mut released = Vec::new();
        for (resource, owned) in &mut self.owned {
            let holding = owned.holding.as_mut();
            let Some(holding) = holding.filter(|holding| holding.claim.agent == *from) else {
                continue;
            };
            if holding.watch.answered(now, conversation).is_some()
                && holding.claim.fenced
                && fencing.is_some_and(|number| holding.fencing != Some(number))
            {
                released.push(resource.clone());
            }
        }
        for resource in released {
            self.free(now, &resource);
        }
    }

    fn owner_answered(&mut self, now: Duration, resource: &Text, probe: &Probe, answer: &Message) {
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        let Some(holder) = wire::parameter(answer, wire::HOLDER) else {
            return Self::plain_owner_answered(request, probe);
        };
        request.fenced = Some(true);
        request.named = Some(Text::from(holder)).filter(|name| *name != wire::NOBODY);
        let asked = probe
            .fencing
            .filter(|_| request.proven_number() == probe.fencing);
        let Some(number) = asked else {
            return;
        };
        let named = holder == &*self.config.name;
        if named && wire::number(answer, wire::FENCING) == Some(number) {
            request.renewed = request.renewed.max(Some(probe.sent));
            self.try_hold(now, resource);
        } else if request.phase == Phase::Held {
            self.lose(resource, LossReason::TakenBack);
        } else {
            // It was lent and taken back before we knew: we still want it.
            request.fencing = None;
            request.token = None;
            request.repeat = now + request.heartbeat;
            if request.algorithm.has_token() {
                request.phase = Phase::Waiting;
            }
        }
    }

    /// The owner issues no numbers: that it lives is all that there is to know.
    fn plain_owner_answered(request: &mut Request, probe: &Probe) {
        if request.fenced.is_none() {
            request.fenced = Some(false);
        }
        if request.fenced == Some(false) {
            request.renewed = request.renewed.max(Some(probe.sent));
        }
    }
}
