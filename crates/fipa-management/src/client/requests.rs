use fipa_acl::{AgentId, Message, Performative};
use fipa_sl::{Content, Functional, Term};

use crate::{AmsAgentDescription, DfAgentDescription, ONTOLOGY, SearchConstraints};

/// Asks a DF for the descriptions that match a template; [`search_result`](super::search_result)
/// reads the answer.
pub fn df_search_request(
    df: &AgentId,
    template: &DfAgentDescription,
    constraints: &SearchConstraints,
) -> Message {
    request(
        df,
        Functional::new("search", [template.into(), constraints.into()]),
    )
}

/// Asks a DF to register a description; [`registered`](super::registered) reads the answer.
pub fn df_register_request(df: &AgentId, description: &DfAgentDescription) -> Message {
    request(df, Functional::new("register", [description.into()]))
}

/// Asks a DF to put this description in the place of the one that it has of the agent;
/// [`registered`](super::registered) reads the answer.
pub fn df_modify_request(df: &AgentId, description: &DfAgentDescription) -> Message {
    request(df, Functional::new("modify", [description.into()]))
}

/// Asks a DF to forget an agent; [`done`](super::done) reads the answer.
pub fn df_deregister_request(df: &AgentId, agent: &AgentId) -> Message {
    let description = DfAgentDescription::of(agent.clone());
    request(
        df,
        Functional::new("deregister", [Term::from(&description)]),
    )
}

/// Asks a DF to tell what matches a template, now and whenever it changes;
/// [`notification`](super::notification) reads what it tells.
pub fn df_subscribe_request(
    df: &AgentId,
    template: &DfAgentDescription,
    constraints: &SearchConstraints,
) -> Message {
    let search = Functional::new("search", [template.into(), constraints.into()]);
    let action = Functional::action(df.into(), search.into());
    let variable = || Term::Variable("x".into());
    let result = Functional::new("result", [action.into(), variable()]);
    let query = Functional::new("iota", [variable(), result.into()]);
    message(df, Performative::Subscribe, "fipa-subscribe", query)
        // SL2 would do, but JADE's DF knows the whole by this name.
        .language("fipa-sl")
}

/// Tells a DF that a subscription is over. The conversation is that of the SUBSCRIBE; with a
/// reply-with, the DF of another robot confirms it, and JADE's does not.
pub fn df_cancel_request(df: &AgentId, subscribe: &Message) -> Message {
    let conversation = subscribe.conversation_id.as_ref().map(ToString::to_string);
    let act = Functional::object("subscribe")
        .with_some("conversation-id", conversation.as_deref().map(Term::text));
    let action = Functional::action(df.into(), act.into());
    let mut cancel =
        message(df, Performative::Cancel, "fipa-subscribe", action).language("fipa-sl");
    cancel.conversation_id = subscribe.conversation_id.clone();
    cancel
}

/// Asks an AMS what its platform is; [`description_result`](super::description_result) reads the
/// answer.
pub fn ams_description_request(ams: &AgentId) -> Message {
    request(ams, Functional::new("get-description", []))
}

/// Asks an AMS for the agents of its platform that match a template;
/// [`agents_result`](super::agents_result) reads the answer.
pub fn ams_search_request(
    ams: &AgentId,
    template: &AmsAgentDescription,
    constraints: &SearchConstraints,
) -> Message {
    request(
        ams,
        Functional::new("search", [template.into(), constraints.into()]),
    )
}

/// Asks an AMS to register an agent; [`done`](super::done) reads the answer.
pub fn ams_register_request(ams: &AgentId, description: &AmsAgentDescription) -> Message {
    request(ams, Functional::new("register", [description.into()]))
}

/// Asks an AMS to forget an agent; [`done`](super::done) reads the answer.
pub fn ams_deregister_request(ams: &AgentId, agent: &AgentId) -> Message {
    let description = AmsAgentDescription {
        name: Some(agent.clone()),
        ..AmsAgentDescription::default()
    };
    request(
        ams,
        Functional::new("deregister", [Term::from(&description)]),
    )
}

pub(super) fn request(agent: &AgentId, function: Functional) -> Message {
    let action = Functional::action(agent.into(), function.into());
    message(agent, Performative::Request, "fipa-request", action).language("fipa-sl0")
}

fn message(
    agent: &AgentId,
    act: Performative,
    protocol: &'static str,
    expression: Functional,
) -> Message {
    Message::new(act)
        .to(agent.clone())
        .ontology(ONTOLOGY)
        .protocol(protocol)
        .content(Content::new(expression).to_bytes())
}
