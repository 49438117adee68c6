//! Who owns a resource: asked of all, answered by the owner to all.

use std::time::Duration;

use fipa_acl::{Message, Performative, Text};

use super::LockAgent;
use crate::request::Phase;
use crate::wire;

impl LockAgent {
    /// Asks all participants of a request whose owner is not known.
    pub(super) fn discover(&mut self, now: Duration, resource: &Text) {
        let Some(request) = self.requests.get_mut(resource) else {
            return;
        };
        request.repeat = now + request.heartbeat;
        let asked = request.participants.clone();
        self.ask_for_owner(resource, asked);
    }

    pub(super) fn ask_for_owner(&mut self, resource: &Text, asked: impl IntoIterator<Item = Text>) {
        let query = self.post.open(Performative::QueryIf, wire::DISCOVER);
        self.post
            .send(query.content(resource.clone().into_bytes()), asked);
    }

    pub(super) fn handle_discovery(
        &mut self,
        now: Duration,
        from: &Text,
        message: &Message,
    ) -> Option<()> {
        match message.performative {
            Performative::QueryIf => self.answer_query(from, message),
            Performative::Inform => self.learn_owner(now, from, message),
            _ => Some(()),
        }
    }

    fn answer_query(&mut self, from: &Text, message: &Message) -> Option<()> {
        let resource = wire::resource(message)?;
        let conversation = wire::conversation(message)?;
        if !self.owned.contains_key(&resource) {
            return Some(());
        }
        let names = message.receiver.iter().map(|agent| agent.name.clone());
        let mut told = self.others(names);
        told.insert(from.clone());
        let inform = Performative::Inform;
        let answer = self.post.continued(inform, wire::DISCOVER, conversation);
        self.post.send(answer.content(resource.into_bytes()), told);
        Some(())
    }

    fn learn_owner(&mut self, now: Duration, from: &Text, message: &Message) -> Option<()> {
        let resource = wire::resource(message)?;
        // Only what was asked for is believed, so that nobody fills our memory.
        let wanted = self.requests.get(&resource);
        let wanted = wanted.is_some_and(|request| request.phase == Phase::Discovering);
        if wanted && !self.owned.contains_key(&resource) {
            self.owners.insert(resource.clone(), from.clone());
            self.begin(now, &resource);
        }
        Some(())
    }
}
