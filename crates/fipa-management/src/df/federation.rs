//! The DF as the child of another one.

use fipa_acl::{AgentId, FipaTime, Message, Text};
use fipa_directory::Now;
use fipa_sl::agent_id;

use super::detach::detached;
use super::questions::{About, Question};
use super::{Df, DfOutput};
use crate::answer::{Action, Outcome};
use crate::client::{self, AnswerError};
use crate::{DF_SERVICE, DfAgentDescription, DirectoryView, ONTOLOGY, Reason, ServiceDescription};

/// The ontology in which JADE's tool asks its DF to federate, and the functions there.
pub(crate) const DF_TOOLS: &str = "DFApplet-Management";
pub(crate) const FEDERATE: &str = "federate";
pub(crate) const LEAVE: &str = "deregister-from";

impl Df {
    /// Does what a request to federate, or to end that, asks for; it is answered when the parent
    /// has answered. Tells whether the message is one.
    pub(super) fn asked_to_federate(
        &mut self,
        now: Now,
        message: &Message,
        directory: &dyn DirectoryView,
    ) -> bool {
        let ontology = message.ontology.as_ref().map(ToString::to_string);
        if !ontology.is_some_and(|name| name.eq_ignore_ascii_case(DF_TOOLS)) {
            return false;
        }
        let Ok(action) = Action::of(message) else {
            return false;
        };
        let function = &action.function;
        let joins = function.is(FEDERATE);
        if !joins && !function.is(LEAVE) {
            return false;
        }
        let parent = function.parameter("df").map(agent_id);
        let Some(Ok(parent)) = parent else {
            let reason = Reason::MissingParameter {
                object: function.symbol.clone(),
                parameter: Text::from_static("df"),
            };
            self.answer(message, Some(&action), Outcome::Refused(reason));
            return true;
        };
        let id = match joins {
            true => self.join(now, &parent, directory),
            false => self.part(now, &parent),
        };
        self.federating.insert(id, (detached(message), action));
        true
    }

    /// Registers this DF with another one. The number of the question.
    fn join(&mut self, now: Now, parent: &AgentId, directory: &dyn DirectoryView) -> u64 {
        let own = AgentId {
            addresses: directory.addresses(&self.config.name),
            ..AgentId::new(&self.config.name)
        };
        let service = ServiceDescription {
            ontologies: vec![Text::from_static(ONTOLOGY)],
            ..ServiceDescription::new("df-service", DF_SERVICE)
        };
        let description = DfAgentDescription::of(own).service(service);
        let request = client::df_register_request(parent, &description);
        self.ask_parent(now, parent, request)
    }

    /// Ends the registration with another DF. The number of the question.
    fn part(&mut self, now: Now, parent: &AgentId) -> u64 {
        let own = AgentId::new(&self.config.name);
        let request = client::df_deregister_request(parent, &own);
        self.ask_parent(now, parent, request)
    }

    fn ask_parent(&mut self, now: Now, parent: &AgentId, request: Message) -> u64 {
        let tag = self.fresh();
        let id = self.count;
        let patience = self.config.patience;
        let question = Question {
            whom: parent.name.clone(),
            about: About::Federation(id),
            deadline: now.mono.saturating_add(patience),
        };
        self.questions.ask(tag.clone(), question);
        let reply_by = FipaTime::from_unix_millis(now.plus(patience).unix_millis);
        let request = request
            .from_agent(AgentId::new(&self.config.name))
            .conversation_id(tag.clone())
            .reply_with(tag)
            .reply_by(reply_by);
        self.send(Some(request));
        id
    }

    /// The parent answered. To be registered there already is what is wanted.
    pub(super) fn federated(&mut self, id: u64, parent: Text, answer: &Message) {
        let result = match client::done(answer) {
            Ok(()) => Ok(()),
            Err(AnswerError::Failed(Reason::AlreadyRegistered)) => Ok(()),
            Err(
                AnswerError::Failed(reason)
                | AnswerError::Refused(reason)
                | AnswerError::NotUnderstood(reason),
            ) => Err(reason),
            Err(error) => Err(Reason::InternalError(Text::from(error.to_string()))),
        };
        self.federation(id, parent, result);
    }

    pub(super) fn federation(&mut self, id: u64, parent: Text, result: Result<(), Reason>) {
        if let Some((request, action)) = self.federating.remove(&id) {
            let outcome = match &result {
                Ok(()) => Outcome::Done,
                Err(reason) => Outcome::Failed(reason.clone()),
            };
            self.answer(&request, Some(&action), outcome);
        }
        self.outputs
            .push_back(DfOutput::Federation { parent, result });
    }
}
