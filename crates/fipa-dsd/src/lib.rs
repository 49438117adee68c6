//! The distributed service directory: how the daemons of several robots find each other.
//!
//! Every daemon announces one service instance by multicast DNS and listens for those of the
//! others. What it learns is only who is there and at which addresses; the directory of agents is
//! told over the link that is opened to such an address.
//!
//! Robots that run the C++ `fipa_services` have no such link: among them each agent is a service
//! instance. So a daemon announces its agents in that form as well, up to a limit, and reports the
//! agents that others announce.
//!
//! Only the module `mdns` knows which library speaks mDNS; no type of that library is public.
mod agent;
mod config;
mod error;
mod event;
mod interface;
mod mdns;
mod probe;
mod service_directory;

pub use agent::{AgentsReport, DEFAULT_AGENTS, DiscoveredAgent, LeftOut};
pub use config::{InterfaceSelector, MDNS_PORT, MdnsConfig, ParseSelectorError, free_mdns_port};
pub use error::MdnsError;
pub use event::{DiscoveredPeer, DiscoveryEvent};
pub use mdns::Mdns;
pub use probe::{HeardDaemon, InterfaceProbe, Multicast, probe};
