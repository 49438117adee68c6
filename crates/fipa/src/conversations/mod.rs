//! Conversations of agents: their messages are judged by the interaction protocols, and the usual
//! ones are one call.
//!
//! ```text
//!   Agent ─ send ─▶ Watch (judges) ──▶ platform
//!         ◀─ mail ─ Watch (judges) ◀── platform
//!              │
//!              ├─▶ Exchange   perform, query, propose, subscribe, contract_net
//!              ├─▶ Responder  a handler for each act that opens a conversation
//!              └─▶ receive    everything else
//! ```
//!
//! **Knows** which conversations this agent has open, and with whom. **Never knows** what contents
//! mean, nor how letters travel.

mod contract_net;
mod error;
mod exchange;
mod initiator;
mod responder;
mod routes;
mod subscription;
mod talk;
mod watch;

pub use contract_net::Contracts;
pub use error::ConversationError;
pub use responder::{Answer, Order, Responder};
pub use subscription::Subscription;
pub(crate) use talk::{Talk, Voice};
pub use watch::{ConversationEvent, ConversationEvents, Monitoring, Violated, Violations};
