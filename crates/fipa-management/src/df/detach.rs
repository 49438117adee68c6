use fipa_acl::{AgentId, Expression, Message, Text, UserDefined};

/// The same message without its content, in memory of its own: what is kept for long must not
/// keep the buffer alive that the message was read from.
pub(super) fn detached(message: &Message) -> Message {
    Message {
        performative: message.performative.clone(),
        sender: message.sender.as_ref().map(agent),
        receiver: message.receiver.iter().map(agent).collect(),
        reply_to: message.reply_to.iter().map(agent).collect(),
        content: None,
        language: message.language.as_ref().map(expression),
        encoding: message.encoding.as_ref().map(expression),
        ontology: message.ontology.as_ref().map(expression),
        protocol: message.protocol.as_ref().map(Text::detached),
        conversation_id: message.conversation_id.as_ref().map(expression),
        reply_with: message.reply_with.as_ref().map(expression),
        in_reply_to: message.in_reply_to.as_ref().map(expression),
        reply_by: message.reply_by,
        user_defined: message.user_defined.iter().map(user_defined).collect(),
    }
}

fn agent(agent_id: &AgentId) -> AgentId {
    AgentId {
        name: agent_id.name.detached(),
        addresses: agent_id.addresses.iter().map(Text::detached).collect(),
        resolvers: agent_id.resolvers.iter().map(agent).collect(),
        user_defined: agent_id.user_defined.iter().map(user_defined).collect(),
    }
}

fn user_defined(parameter: &UserDefined) -> UserDefined {
    UserDefined {
        name: parameter.name.detached(),
        value: expression(&parameter.value),
    }
}

fn expression(value: &Expression) -> Expression {
    match value {
        Expression::Word(text) => Expression::Word(text.detached()),
        Expression::String(text) => Expression::String(text.detached()),
        Expression::Number(text) => Expression::Number(text.detached()),
        Expression::List(items) => Expression::List(items.iter().map(expression).collect()),
    }
}
