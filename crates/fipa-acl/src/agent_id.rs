use std::fmt;

use crate::{Expression, Text};

/// An agent identifier (AID; FIPA SC00023K section 3): who an agent is and where to try it.
///
/// Two AIDs mean the same agent if their names are equal ([`is_same_agent`](Self::is_same_agent));
/// `==` compares every parameter.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct AgentId {
    /// The globally unique name, usually `local@platform`.
    pub name: Text,
    /// Transport addresses (URLs) in the order in which they should be tried.
    pub addresses: Vec<Text>,
    /// Name services that can be asked for addresses, in order.
    pub resolvers: Vec<AgentId>,
    /// Parameters outside the standard.
    pub user_defined: Vec<UserDefined>,
}

impl AgentId {
    /// The AID with this name and nothing else.
    pub fn new(name: impl Into<Text>) -> AgentId {
        AgentId {
            name: name.into(),
            ..AgentId::default()
        }
    }

    /// Adds an address behind those already there.
    #[must_use]
    pub fn address(mut self, url: impl Into<Text>) -> AgentId {
        self.addresses.push(url.into());
        self
    }

    /// Adds a resolver behind those already there.
    #[must_use]
    pub fn resolver(mut self, resolver: impl Into<AgentId>) -> AgentId {
        self.resolvers.push(resolver.into());
        self
    }

    /// Adds a user-defined parameter.
    #[must_use]
    pub fn user_defined(mut self, name: impl Into<Text>, value: impl Into<Expression>) -> AgentId {
        self.user_defined.push(UserDefined::new(name, value));
        self
    }

    /// Whether both name the same agent: equal names, whatever else they hold.
    pub fn is_same_agent(&self, other: &AgentId) -> bool {
        self.name == other.name
    }
}

impl<T: Into<Text>> From<T> for AgentId {
    fn from(name: T) -> AgentId {
        AgentId::new(name)
    }
}

impl fmt::Display for AgentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.name)
    }
}

/// A parameter outside the standard: its name without the `X-` that marks it on the wire.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct UserDefined {
    /// The name without any leading `X-`.
    pub name: Text,
    /// The value.
    pub value: Expression,
}

impl UserDefined {
    /// A parameter; leading `X-` of the name are taken off.
    pub fn new(name: impl Into<Text>, value: impl Into<Expression>) -> UserDefined {
        UserDefined {
            name: canonical_user_name(name.into()),
            value: value.into(),
        }
    }
}

/// A user-defined name without its leading `X-` or `x-`, however many there are.
///
/// ```
/// assert_eq!(fipa_acl::canonical_user_name("X-x-Priority".into()), "Priority");
/// ```
pub fn canonical_user_name(name: Text) -> Text {
    let mut rest: &str = &name;
    while let Some(shorter) = rest.strip_prefix("X-").or_else(|| rest.strip_prefix("x-")) {
        rest = shorter;
    }
    let prefix = name.len() - rest.len();
    if prefix == 0 {
        return name;
    }
    let octets = name.into_bytes().slice(prefix..);
    // The prefix is ASCII, so what follows it is text as well.
    Text::from_utf8_lossy(octets)
}
