use std::ops::ControlFlow;

use fipa_acl::{AgentId, Text};

use crate::{ApDescription, ApService, Reason};

/// Where a message came from, as the message transport service knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// From an agent of this platform: it is who the sender says.
    Local,
    /// From another platform: the sender is what the message claims.
    Foreign,
}

/// An agent that the directory knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnownAgent<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its service type.
    pub kind: &'a str,
    /// Whether this platform vouches for it: it is attached here, or registered with the AMS.
    pub local: bool,
}

/// What is to be changed in the directory at the request of an agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DirectoryChange {
    /// An agent is to be known, at the addresses of its identifier.
    Register(AgentId),
    /// An agent has these addresses from now on.
    Modify(AgentId),
    /// An agent is to be forgotten.
    Deregister(Text),
}

/// The directory of agents as the AMS and the DF see it; the host keeps it.
pub trait DirectoryView {
    /// The name of this platform, which stands behind the @ of its agents.
    fn platform(&self) -> Text;

    /// The transport services of this platform, with the addresses that the one who asks can use.
    fn services(&self) -> Vec<ApService>;

    /// The agent of exactly this name.
    fn find(&self, name: &str) -> Option<KnownAgent<'_>>;

    /// Shows every known agent, each once, until told to stop.
    fn visit(&self, visitor: &mut dyn FnMut(KnownAgent<'_>) -> ControlFlow<()>);

    /// The addresses of an agent that the one who asks can use.
    fn addresses(&self, name: &str) -> Vec<Text>;

    /// Changes the directory, or says why not.
    fn change(&mut self, change: DirectoryChange) -> Result<(), Reason>;

    /// What this platform tells about itself. Its SL is also what `APDescription.txt` holds.
    fn description(&self) -> ApDescription {
        ApDescription {
            name: self.platform(),
            services: self.services(),
        }
    }
}
