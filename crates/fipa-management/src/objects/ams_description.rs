use fipa_acl::{AgentId, Text};
use fipa_sl::{FrameError, Functional, Term};

use super::ApDescription;
use super::frame::Frame;

pub(crate) const OBJECT: &str = "ams-agent-description";

/// An agent as its platform knows it (FIPA SC00023K, ams-agent-description); a template for those
/// that are searched.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AmsAgentDescription {
    /// Who it is; mandatory where an agent is registered.
    pub name: Option<AgentId>,
    /// Who owns it.
    pub ownership: Option<Text>,
    /// Where it is in its life cycle.
    pub state: Option<AgentState>,
}

/// The states of an agent's life cycle (FIPA SC00023K).
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum AgentState {
    /// Created, not yet invoked.
    Initiated,
    /// At work.
    Active,
    /// Stopped by itself or its AMS.
    Suspended,
    /// Waiting for an event.
    Waiting,
    /// Moving to another platform.
    Transit,
    /// A state outside the standard, such as JADE's `latent`.
    Other(Text),
}

impl AgentState {
    const STANDARD: [AgentState; 5] = [
        AgentState::Initiated,
        AgentState::Active,
        AgentState::Suspended,
        AgentState::Waiting,
        AgentState::Transit,
    ];

    /// The name of the state.
    pub fn as_str(&self) -> &str {
        match self {
            AgentState::Initiated => "initiated",
            AgentState::Active => "active",
            AgentState::Suspended => "suspended",
            AgentState::Waiting => "waiting",
            AgentState::Transit => "transit",
            AgentState::Other(name) => name,
        }
    }
}

impl From<Text> for AgentState {
    fn from(name: Text) -> AgentState {
        let mut states = AgentState::STANDARD.into_iter();
        let standard = states.find(|state| state.as_str().eq_ignore_ascii_case(&name));
        standard.unwrap_or(AgentState::Other(name))
    }
}

impl AmsAgentDescription {
    /// The agent with the addresses of its platform, if it has none of its own: JADE lists
    /// ordinary agents so.
    #[must_use]
    pub fn at(mut self, platform: &ApDescription) -> AmsAgentDescription {
        if let Some(name) = &mut self.name
            && name.addresses.is_empty()
        {
            let addresses = platform.services.iter().flat_map(|s| &s.addresses);
            name.addresses = addresses.cloned().collect();
        }
        self
    }

    /// Whether an agent is as this template says: by its name, and by what else is given here.
    pub(crate) fn matches(&self, agent: &AmsAgentDescription) -> bool {
        fn same<T>(wanted: &Option<T>, there: &Option<T>, equal: impl Fn(&T, &T) -> bool) -> bool {
            match (wanted, there) {
                (None, _) => true,
                (Some(wanted), Some(there)) => equal(wanted, there),
                (Some(_), None) => false,
            }
        }
        same(&self.name, &agent.name, AgentId::is_same_agent)
            && same(&self.ownership, &agent.ownership, |a, b| {
                a.eq_ignore_ascii_case(b)
            })
            && same(&self.state, &agent.state, |a, b| a == b)
    }
}

impl TryFrom<&Term> for AmsAgentDescription {
    type Error = FrameError;

    fn try_from(term: &Term) -> Result<AmsAgentDescription, FrameError> {
        let frame = Frame::of(term, OBJECT)?;
        Ok(AmsAgentDescription {
            name: frame.agent("name")?,
            ownership: frame.text("ownership")?,
            state: frame.text("state")?.map(AgentState::from),
        })
    }
}

impl From<&AmsAgentDescription> for Term {
    fn from(description: &AmsAgentDescription) -> Term {
        let state = description.state.as_ref().map(AgentState::as_str);
        Functional::object(Text::from_static(OBJECT))
            .with_some("name", description.name.as_ref())
            .with_some("ownership", description.ownership.as_ref())
            .with_some("state", state)
            .into()
    }
}
