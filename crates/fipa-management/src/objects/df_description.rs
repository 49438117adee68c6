use fipa_acl::{AgentId, FipaTime, Text};
use fipa_sl::{FrameError, Functional, Term};

use super::frame::{Frame, WithLists};

pub(crate) const OBJECT: &str = "df-agent-description";
pub(crate) const SERVICE: &str = "service-description";
pub(crate) const PROPERTY: &str = "property";

/// An agent and what it offers (FIPA SC00023K, df-agent-description); a template for those that
/// are searched, of which every part that is given must match.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DfAgentDescription {
    /// Who it is; mandatory where an agent is registered.
    pub name: Option<AgentId>,
    /// What it offers.
    pub services: Vec<ServiceDescription>,
    /// The interaction protocols it takes part in.
    pub protocols: Vec<Text>,
    /// The ontologies it knows.
    pub ontologies: Vec<Text>,
    /// The content languages it knows.
    pub languages: Vec<Text>,
    /// Until when it is registered; absent: until it is deregistered.
    pub lease_time: Option<FipaTime>,
    /// For whom it is registered: `global` or `local`.
    pub scope: Vec<Text>,
}

/// A service of an agent (FIPA SC00023K, service-description).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ServiceDescription {
    /// The name of the service; mandatory where it is registered.
    pub name: Option<Text>,
    /// What kind of service it is; mandatory where it is registered.
    pub kind: Option<Text>,
    /// Who owns it.
    pub ownership: Option<Text>,
    /// The interaction protocols in which it is given.
    pub protocols: Vec<Text>,
    /// The ontologies it knows.
    pub ontologies: Vec<Text>,
    /// The content languages it knows.
    pub languages: Vec<Text>,
    /// What else is to be said of it.
    pub properties: Vec<Property>,
}

/// A name and its value (FIPA SC00023K, property).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Property {
    /// The name.
    pub name: Text,
    /// The value; in a template none stands for any.
    pub value: Option<Term>,
}

impl DfAgentDescription {
    /// The description of an agent with nothing but its name.
    pub fn of(agent: impl Into<AgentId>) -> DfAgentDescription {
        DfAgentDescription {
            name: Some(agent.into()),
            ..DfAgentDescription::default()
        }
    }

    /// Adds a service.
    #[must_use]
    pub fn service(mut self, service: ServiceDescription) -> DfAgentDescription {
        self.services.push(service);
        self
    }
}

impl ServiceDescription {
    /// A service with its name and type.
    pub fn new(name: impl Into<Text>, kind: impl Into<Text>) -> ServiceDescription {
        ServiceDescription {
            name: Some(name.into()),
            ..ServiceDescription::of_type(kind)
        }
    }

    /// A template for services of this type.
    pub fn of_type(kind: impl Into<Text>) -> ServiceDescription {
        ServiceDescription {
            kind: Some(kind.into()),
            ..ServiceDescription::default()
        }
    }

    /// Adds a property.
    #[must_use]
    pub fn property(mut self, name: impl Into<Text>, value: impl Into<Term>) -> Self {
        self.properties.push(Property {
            name: name.into(),
            value: Some(value.into()),
        });
        self
    }
}

impl TryFrom<&Term> for DfAgentDescription {
    type Error = FrameError;

    fn try_from(term: &Term) -> Result<DfAgentDescription, FrameError> {
        let frame = Frame::of(term, OBJECT)?;
        Ok(DfAgentDescription {
            name: frame.agent("name")?,
            services: frame.objects("services", |term| ServiceDescription::try_from(term))?,
            protocols: frame.texts("protocols")?,
            ontologies: frame.texts("ontologies")?,
            languages: frame.texts("languages")?,
            lease_time: frame.time("lease-time")?,
            scope: frame.texts("scope")?,
        })
    }
}

impl From<&DfAgentDescription> for Term {
    fn from(description: &DfAgentDescription) -> Term {
        Functional::object(Text::from_static(OBJECT))
            .with_some("name", description.name.as_ref())
            .with_set("services", description.services.iter().map(Term::from))
            .with_set("protocols", description.protocols.iter().map(Term::from))
            .with_set("languages", description.languages.iter().map(Term::from))
            .with_set("ontologies", description.ontologies.iter().map(Term::from))
            .with_some("lease-time", description.lease_time.map(Term::Time))
            .with_set("scope", description.scope.iter().map(Term::from))
            .into()
    }
}

impl TryFrom<&Term> for ServiceDescription {
    type Error = FrameError;

    fn try_from(term: &Term) -> Result<ServiceDescription, FrameError> {
        let frame = Frame::of(term, SERVICE)?;
        Ok(ServiceDescription {
            name: frame.text("name")?,
            kind: frame.text("type")?,
            ownership: frame.text("ownership")?,
            protocols: frame.texts("protocols")?,
            ontologies: frame.texts("ontologies")?,
            languages: frame.texts("languages")?,
            properties: frame.objects("properties", |term| Property::try_from(term))?,
        })
    }
}

impl From<&ServiceDescription> for Term {
    fn from(service: &ServiceDescription) -> Term {
        Functional::object(Text::from_static(SERVICE))
            .with_some("name", service.name.as_ref())
            .with_some("type", service.kind.as_ref())
            .with_some("ownership", service.ownership.as_ref())
            .with_set("protocols", service.protocols.iter().map(Term::from))
            .with_set("languages", service.languages.iter().map(Term::from))
            .with_set("ontologies", service.ontologies.iter().map(Term::from))
            .with_set("properties", service.properties.iter().map(Term::from))
            .into()
    }
}

impl TryFrom<&Term> for Property {
    type Error = FrameError;

    fn try_from(term: &Term) -> Result<Property, FrameError> {
        let frame = Frame::of(term, PROPERTY)?;
        Ok(Property {
            name: frame.required_text("name")?,
            value: frame.value("value"),
        })
    }
}

impl From<&Property> for Term {
    fn from(property: &Property) -> Term {
        Functional::object(Text::from_static(PROPERTY))
            .with("name", &property.name)
            .with_some("value", property.value.clone())
            .into()
    }
}
