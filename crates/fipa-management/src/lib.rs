//! Agent management (FIPA SC00023K): the white pages (AMS) and the yellow pages (DF) of a
//! platform, as state machines.
//!
//! ```text
//!            request                               request, subscribe, cancel
//!   agent ─────────────▶ Ams ─▶ answer    agent ─────────────────────────────▶ Df ─▶ answers
//!                         │ ▲                                                  │ ▲   notifications
//!                  change │ │ who is there                        who is there │ │   searches at
//!                         ▼ │                                                  ▼ │   federated DFs
//!                       DirectoryView, kept by the host                        leases, clock
//! ```
//!
//! **Knows** the objects of the ontology and how they look in SL, which request gets which answer,
//! who may register what, which descriptions match a template, leases, subscriptions, and how DFs
//! search for each other. **Never knows** a socket, a clock or how a message travels: the host
//! hands in what was received, with the time and where it came from ([`Origin`]), and sends what
//! comes out.
//!
//! The DF and the directory are two views of one store: a search finds what was registered with
//! the DF, and every other agent that the directory ([`DirectoryView`]) knows.
//!
//! What the other side needs, requests to write and answers to read, is in [`client`].
//!
//! ```
//! # use std::ops::ControlFlow;
//! # use fipa_management::{ApService, DirectoryChange, DirectoryView, KnownAgent, Reason};
//! # struct Host;
//! # impl DirectoryView for Host {
//! #     fn platform(&self) -> fipa_acl::Text { "robot1".into() }
//! #     fn services(&self) -> Vec<ApService> { Vec::new() }
//! #     fn find(&self, _: &str) -> Option<KnownAgent<'_>> { None }
//! #     fn visit(&self, _: &mut dyn FnMut(KnownAgent<'_>) -> ControlFlow<()>) {}
//! #     fn addresses(&self, _: &str) -> Vec<fipa_acl::Text> { Vec::new() }
//! #     fn change(&mut self, _: DirectoryChange) -> Result<(), Reason> { Ok(()) }
//! # }
//! use fipa_acl::AgentId;
//! use fipa_directory::Now;
//! use fipa_management::{
//!     Df, DfAgentDescription, DfConfig, DfOutput, Origin, ServiceDescription, client,
//! };
//!
//! let mut df = Df::new(DfConfig::new("df@robot1", "5f3a"));
//! let description = DfAgentDescription::of("arm@robot2")
//!     .service(ServiceDescription::new("grip", "gripper"));
//! let request = client::df_register_request(&AgentId::new("df@robot1"), &description)
//!     .from_agent("arm@robot2");
//! // `Host` keeps the directory; see `DirectoryView`.
//! df.handle(Now::default(), Origin::Foreign, &request, &Host);
//! let Some(DfOutput::Send(answer)) = df.poll_output() else { panic!("no answer") };
//! assert_eq!(client::registered(&answer).unwrap(), description);
//! ```

mod ams;
mod answer;
pub mod client;
mod df;
mod objects;
mod reason;
mod view;

pub use ams::{Ams, AmsConfig};
pub use df::{Df, DfConfig, DfOutput};
pub use objects::{
    AgentState, AmsAgentDescription, ApDescription, ApService, DfAgentDescription, Property,
    SearchConstraints, ServiceDescription,
};
pub use reason::Reason;
pub use view::{DirectoryChange, DirectoryView, KnownAgent, Origin};

/// The name of the ontology of agent management, compared without case.
pub const ONTOLOGY: &str = "fipa-agent-management";

/// The type of the service that a DF registers with another one.
pub const DF_SERVICE: &str = "fipa-df";
