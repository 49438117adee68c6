//! Registering, and subscriptions.

use std::time::Duration;

use fipa_acl::{AgentId, FipaTime, Message, Performative, Text};
use fipa_directory::Now;
use fipa_sl::{Arguments, Content, Functional, Term};

use super::Df;
use super::search::marked;
use super::subscriptions::Subscription;
use crate::answer::{Action, Outcome, check_terms_of, read_content, reply};
use crate::objects::{DF_DESCRIPTION, SERVICE_DESCRIPTION};
use crate::{DfAgentDescription, DirectoryView, Origin, Reason};

impl Df {
    pub(super) fn request(
        &mut self,
        now: Now,
        origin: Origin,
        message: &Message,
        directory: &dyn DirectoryView,
    ) {
        if origin == Origin::Local && self.asked_to_federate(now, message, directory) {
            return;
        }
        let mut action = match check_terms_of(message).and_then(|()| Action::of(message)) {
            Ok(action) => action,
            Err(outcome) => return self.answer(message, None, outcome),
        };
        if action.function.is("search") {
            return self.search(now, (origin, message), action, directory);
        }
        let outcome = self.perform(now, origin, message, &mut action, directory);
        let outcome = outcome.unwrap_or_else(|outcome| outcome);
        self.answer(message, Some(&action), outcome);
        self.handle_timeout(now);
    }

    /// Errors are outcomes as well.
    fn perform(
        &mut self,
        now: Now,
        origin: Origin,
        message: &Message,
        action: &mut Action,
        directory: &dyn DirectoryView,
    ) -> Result<Outcome, Outcome> {
        let symbol = action.function.symbol.to_ascii_lowercase();
        if !["register", "modify", "deregister"].contains(&symbol.as_str()) {
            let name = action.function.symbol.clone();
            return Err(Outcome::Refused(Reason::UnsupportedFunction(name)));
        }
        let (agent, mut description) = description_of(action)?;
        if !may(origin, message, &agent, directory) {
            return Err(Outcome::Refused(Reason::Unauthorised));
        }
        if symbol == "deregister" {
            let old = self.store.remove(&agent.name);
            let old = old.ok_or(Outcome::Failed(Reason::NotRegistered))?;
            self.changed(Some(&old), None);
            return Ok(Outcome::Done);
        }
        check_services(&description)?;
        let expires = self.grant(now, &mut description, action);
        let stored = if symbol == "register" {
            self.register(agent.name, description, expires)
        } else {
            self.modify(&agent.name, description, expires)
        };
        stored.map(|()| Outcome::Done).map_err(Outcome::Failed)
    }

    fn register(
        &mut self,
        agent: Text,
        description: DfAgentDescription,
        expires: Option<Duration>,
    ) -> Result<(), Reason> {
        if self.store.len() >= self.config.max_descriptions && !self.store.contains(&agent) {
            let full = Text::from_static("no more descriptions can be registered");
            return Err(Reason::InternalError(full));
        }
        self.store.insert(agent, description.clone(), expires)?;
        self.changed(None, Some(&description));
        Ok(())
    }

    fn modify(
        &mut self,
        agent: &str,
        description: DfAgentDescription,
        expires: Option<Duration>,
    ) -> Result<(), Reason> {
        let old = self.store.replace(agent, description.clone(), expires)?;
        self.changed(Some(&old), Some(&description));
        Ok(())
    }

    /// Grants a lease, as a point in time, and tells when it expires. What is granted stands in
    /// the action that the answer repeats.
    fn grant(
        &self,
        now: Now,
        description: &mut DfAgentDescription,
        action: &mut Action,
    ) -> Option<Duration> {
        let wanted = description.lease_time;
        let longest = self
            .config
            .max_lease
            .map(|lease| now.plus(lease).unix_millis);
        let until = wanted.map(|time| time.resolve(now.unix_millis));
        let until = until.into_iter().chain(longest).min();
        description.lease_time = until.map(FipaTime::from_unix_millis);
        if description.lease_time != wanted {
            action.function.arguments = Arguments::Positional(vec![Term::from(&*description)]);
        }
        let span = until?.saturating_sub(now.unix_millis);
        let span = Duration::from_millis(u64::try_from(span).unwrap_or(0));
        Some(now.mono.saturating_add(span))
    }

    pub(super) fn subscribe(
        &mut self,
        origin: Origin,
        message: &Message,
        directory: &dyn DirectoryView,
    ) {
        let subscription = check_terms_of(message)
            .and_then(|()| Subscription::of(&self.config.name, message))
            .and_then(|subscription| {
                if self.subscriptions.len() >= self.config.max_subscriptions {
                    let full = Text::from_static("no more subscriptions can be held");
                    return Err(Outcome::Refused(Reason::InternalError(full)));
                }
                Ok(subscription)
            });
        let subscription = match subscription {
            Ok(subscription) => subscription,
            Err(outcome) => return self.answer(message, None, outcome),
        };
        let limit = self.limit(origin, &subscription.constraints);
        let (found, more) = self.find(&subscription.template, limit, directory);
        if !found.is_empty() {
            let notification = subscription.notification(&found);
            self.send(Some(marked(notification, more)));
        }
        self.subscriptions.insert(message, subscription);
    }

    /// JADE expects no answer; who asks for one by a `reply-with` gets it.
    pub(super) fn cancel(&mut self, message: &Message) {
        let was_there = self.subscriptions.cancel(message);
        if message.reply_with.is_none() {
            return;
        }
        let Ok(cancelled) = read_content(message) else {
            return;
        };
        let (act, content) = if was_there {
            let done = Functional::new("done", [cancelled.into_first()]);
            (Performative::Inform, Content::new(done))
        } else {
            let unknown = Reason::InternalError(Text::from_static("there is no such subscription"));
            let content = Content::new(cancelled.into_first()).and(&unknown);
            (Performative::Failure, content)
        };
        self.send(reply(&self.config.name, message, act, &content));
    }
}

/// Agents of other platforms speak for themselves only, and never in the name of one of ours.
fn may(origin: Origin, message: &Message, agent: &AgentId, directory: &dyn DirectoryView) -> bool {
    let sender = message.sender.as_ref();
    match origin {
        Origin::Local => true,
        Origin::Foreign => {
            let is_sender = sender.is_some_and(|sender| sender.is_same_agent(agent));
            is_sender && !directory.find(&agent.name).is_some_and(|known| known.local)
        }
    }
}

/// The description in a request to register, modify or deregister, and whom it describes.
fn description_of(action: &Action) -> Result<(AgentId, DfAgentDescription), Outcome> {
    let description: DfAgentDescription = action.object(0, DF_DESCRIPTION)?;
    action.at_most(1)?;
    let agent = description.name.clone();
    let agent = agent.ok_or_else(|| missing(DF_DESCRIPTION, "name"))?;
    Ok((agent, description))
}

fn check_services(description: &DfAgentDescription) -> Result<(), Outcome> {
    for service in &description.services {
        if service.name.is_none() {
            return Err(missing(SERVICE_DESCRIPTION, "name"));
        }
        if service.kind.is_none() {
            return Err(missing(SERVICE_DESCRIPTION, "type"));
        }
    }
    Ok(())
}

fn missing(object: &'static str, parameter: &'static str) -> Outcome {
    Outcome::Refused(Reason::MissingParameter {
        object: Text::from_static(object),
        parameter: Text::from_static(parameter),
    })
}
