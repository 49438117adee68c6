//! The DF as the child of another one.

use fipa_acl::{AgentId, FipaTime, Message, Text};
use fipa_directory::Now;

use super::questions::{About, Question};
use super::{Df, DfOutput};
use crate::client::{self, AnswerError};
use crate::{DF_SERVICE, DfAgentDescription, DirectoryView, ONTOLOGY, Reason, ServiceDescription};

impl Df {
    /// Registers this DF with another one, whose searches then come here as well; answered by one
    /// [`DfOutput::Federation`].
    pub fn federate(&mut self, now: Now, parent: &AgentId, directory: &dyn DirectoryView) {
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
        self.ask_parent(now, parent, request);
    }

    /// Ends the registration with another DF; answered by one [`DfOutput::Federation`].
    pub fn leave(&mut self, now: Now, parent: &AgentId) {
        let own = AgentId::new(&self.config.name);
        let request = client::df_deregister_request(parent, &own);
        self.ask_parent(now, parent, request);
    }

    fn ask_parent(&mut self, now: Now, parent: &AgentId, request: Message) {
        let tag = self.fresh();
        let patience = self.config.patience;
        let question = Question {
            whom: parent.name.clone(),
            about: About::Federation,
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
    }

    /// The parent answered. To be registered there already is what is wanted.
    pub(super) fn federated(&mut self, parent: Text, answer: &Message) {
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
        self.federation(parent, result);
    }

    pub(super) fn federation(&mut self, parent: Text, result: Result<(), Reason>) {
        self.outputs
            .push_back(DfOutput::Federation { parent, result });
    }
}
