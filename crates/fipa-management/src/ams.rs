use std::collections::HashMap;
use std::ops::ControlFlow;

use fipa_acl::{AgentId, Message, Performative, Text};
use fipa_sl::Term;

use crate::answer::{Action, Outcome, answer, check_terms_of, not_taken};
use crate::objects::{AMS_DESCRIPTION, CONSTRAINTS};
use crate::{
    AgentState, AmsAgentDescription, DirectoryChange, DirectoryView, KnownAgent, Origin, Reason,
    SearchConstraints,
};

/// What an agent management system is made with.
#[derive(Clone, Debug)]
pub struct AmsConfig {
    /// Its name: `ams@` and the name of the platform.
    pub name: Text,
    /// Whether agents of other platforms may register here, each under its own name.
    pub allow_foreign: bool,
    /// Agents that may be registered by requests at the same time.
    pub max_registrations: usize,
    /// Agents that one search finds at most.
    pub max_results: usize,
}

impl AmsConfig {
    /// The usual settings for the AMS of this name.
    pub fn new(name: impl Into<Text>) -> AmsConfig {
        AmsConfig {
            name: name.into(),
            allow_foreign: false,
            max_registrations: 10_000,
            max_results: 10_000,
        }
    }
}

/// The agent management system of a platform (FIPA SC00023K): its white pages.
///
/// It lists the agents for which the platform vouches, tells what the platform is, and registers
/// agents at the request of others, as far as they may. It describes the life cycle of agents, and
/// does not steer it.
#[derive(Debug)]
pub struct Ams {
    config: AmsConfig,
    /// What was said about agents by request.
    described: HashMap<Text, Described>,
}

#[derive(Debug)]
struct Described {
    description: AmsAgentDescription,
    /// Whether the agent is there by that request, and not by its own connection.
    registered: bool,
}

impl Ams {
    /// An AMS that knows of no registration yet.
    pub fn new(config: AmsConfig) -> Ams {
        Ams {
            config,
            described: HashMap::new(),
        }
    }

    /// Takes in a message for the AMS; the answer, if one is due, is complete but for the
    /// addresses of its sender.
    pub fn handle(
        &mut self,
        origin: Origin,
        message: &Message,
        directory: &mut dyn DirectoryView,
    ) -> Option<Message> {
        if message.performative != Performative::Request {
            return not_taken(&self.config.name, message);
        }
        let (action, outcome) = match check_terms_of(message).and_then(|()| Action::of(message)) {
            Err(outcome) => (None, outcome),
            Ok(action) => {
                let outcome = self.perform(origin, message, &action, directory);
                (Some(action), outcome.unwrap_or_else(|outcome| outcome))
            }
        };
        answer(&self.config.name, message, action.as_ref(), outcome)
    }

    /// An agent has left the directory: what was said about it is forgotten.
    pub fn agent_gone(&mut self, name: &str) {
        self.described.remove(name);
    }

    /// Errors are outcomes as well.
    fn perform(
        &mut self,
        origin: Origin,
        message: &Message,
        action: &Action,
        directory: &mut dyn DirectoryView,
    ) -> Result<Outcome, Outcome> {
        let function = &action.function;
        if function.is("get-description") {
            action.at_most(0)?;
            return Ok(Outcome::Result(vec![Term::from(&directory.description())]));
        }
        if function.is("search") {
            return self.search(action, directory);
        }
        let is_known = ["register", "deregister", "modify"]
            .iter()
            .any(|name| function.is(name));
        if !is_known {
            let name = function.symbol.clone();
            return Err(Outcome::Refused(Reason::UnsupportedFunction(name)));
        }
        let (agent, description) = description_of(action)?;
        if !self.may(origin, message, &agent, directory) {
            return Err(Outcome::Refused(Reason::Unauthorised));
        }
        let done = if function.is("register") {
            self.register(agent, description, directory)
        } else if function.is("modify") {
            self.modify(agent, description, directory)
        } else {
            self.deregister(&agent.name, directory)
        };
        done.map(|()| Outcome::Done).map_err(Outcome::Failed)
    }

    /// Agents of other platforms speak for themselves only, if at all, and never for ours.
    fn may(
        &self,
        origin: Origin,
        message: &Message,
        agent: &AgentId,
        directory: &dyn DirectoryView,
    ) -> bool {
        let is_sender = message
            .sender
            .as_ref()
            .is_some_and(|s| s.is_same_agent(agent));
        let is_registered = self.is_registered(&agent.name);
        match origin {
            // Who is attached speaks for itself; who was registered by request, anybody here may.
            Origin::Local => is_sender || is_registered || !is_local(directory, &agent.name),
            Origin::Foreign => {
                let of_ours = agent.name.rsplit_once('@').is_some_and(|(_, platform)| {
                    platform.eq_ignore_ascii_case(&directory.platform())
                });
                let is_ours = of_ours || (!is_registered && is_local(directory, &agent.name));
                self.config.allow_foreign && is_sender && !is_ours
            }
        }
    }

    fn is_registered(&self, name: &str) -> bool {
        self.described.get(name).is_some_and(|d| d.registered)
    }

    fn register(
        &mut self,
        agent: AgentId,
        description: AmsAgentDescription,
        directory: &mut dyn DirectoryView,
    ) -> Result<(), Reason> {
        if self.is_registered(&agent.name) || is_local(directory, &agent.name) {
            return Err(Reason::AlreadyRegistered);
        }
        if self.described.len() >= self.config.max_registrations {
            let full = Text::from_static("no more agents can be registered");
            return Err(Reason::InternalError(full));
        }
        let name = agent.name.clone();
        directory.change(DirectoryChange::Register(agent))?;
        let described = Described {
            description,
            registered: true,
        };
        self.described.insert(name, described);
        Ok(())
    }

    fn modify(
        &mut self,
        agent: AgentId,
        description: AmsAgentDescription,
        directory: &mut dyn DirectoryView,
    ) -> Result<(), Reason> {
        let registered = self.is_registered(&agent.name);
        if !registered && !is_local(directory, &agent.name) {
            return Err(Reason::NotRegistered);
        }
        let name = agent.name.clone();
        if registered {
            directory.change(DirectoryChange::Modify(agent))?;
        }
        let described = Described {
            description,
            registered,
        };
        self.described.insert(name, described);
        Ok(())
    }

    fn deregister(&mut self, name: &Text, directory: &mut dyn DirectoryView) -> Result<(), Reason> {
        if !self.is_registered(name) && !is_local(directory, name) {
            return Err(Reason::NotRegistered);
        }
        directory.change(DirectoryChange::Deregister(name.clone()))?;
        self.described.remove(name);
        Ok(())
    }

    fn search(&self, action: &Action, directory: &dyn DirectoryView) -> Result<Outcome, Outcome> {
        let template: AmsAgentDescription = action.object(0, AMS_DESCRIPTION)?;
        let constraints: SearchConstraints = action.object(1, CONSTRAINTS)?;
        action.at_most(2)?;
        let limit = constraints.limit(self.config.max_results);
        let mut found = Vec::new();
        if let Some(wanted) = &template.name {
            let agent = directory.find(&wanted.name);
            if let Some(agent) = agent.filter(|agent| agent.local) {
                found.push(self.description(agent, directory));
            }
        } else {
            directory.visit(&mut |agent| {
                if found.len() >= limit {
                    return ControlFlow::Break(());
                }
                if agent.local {
                    let description = self.description(agent, directory);
                    found.extend(template.matches(&description).then_some(description));
                }
                ControlFlow::Continue(())
            });
        }
        found.retain(|description| template.matches(description));
        found.truncate(limit);
        Ok(Outcome::Result(found.iter().map(Term::from).collect()))
    }

    fn description(
        &self,
        agent: KnownAgent<'_>,
        directory: &dyn DirectoryView,
    ) -> AmsAgentDescription {
        let said = self.described.get(agent.name).map(|d| &d.description);
        let name = AgentId {
            addresses: directory.addresses(agent.name),
            ..AgentId::new(agent.name)
        };
        AmsAgentDescription {
            name: Some(name),
            ownership: said.and_then(|said| said.ownership.clone()),
            state: said
                .and_then(|said| said.state.clone())
                .or(Some(AgentState::Active)),
        }
    }
}

fn is_local(directory: &dyn DirectoryView, name: &str) -> bool {
    directory.find(name).is_some_and(|agent| agent.local)
}

/// The description in a request to register, modify or deregister, and whom it describes.
fn description_of(action: &Action) -> Result<(AgentId, AmsAgentDescription), Outcome> {
    let description: AmsAgentDescription = action.object(0, AMS_DESCRIPTION)?;
    action.at_most(1)?;
    let Some(agent) = description.name.clone() else {
        return Err(Outcome::Refused(Reason::MissingParameter {
            object: Text::from_static(AMS_DESCRIPTION),
            parameter: Text::from_static("name"),
        }));
    };
    Ok((agent, description))
}
