//! Asking a DF to register with another one, as JADE's own tool asks its DF.

use fipa_acl::{AgentId, Message};
use fipa_sl::{Functional, Term};

use super::requests::request;
use crate::df::{DF_TOOLS, FEDERATE, LEAVE};

/// Asks a DF to register with another one, its parent, whose searches then come to it as well;
/// [`done`](super::done) reads the answer. A DF does so for agents of its own platform only.
pub fn df_federate_request(df: &AgentId, parent: &AgentId) -> Message {
    of_federation(df, FEDERATE, parent)
}

/// Asks a DF to end its registration with another one; [`done`](super::done) reads the answer.
pub fn df_leave_request(df: &AgentId, parent: &AgentId) -> Message {
    of_federation(df, LEAVE, parent)
}

fn of_federation(df: &AgentId, function: &'static str, parent: &AgentId) -> Message {
    let function = Functional::object(function).with("df", Term::from(parent));
    request(df, function).ontology(DF_TOOLS)
}
