//! FIPA's vocabulary as plain data: messages, agent identifiers, envelopes.
//!
//! ```text
//!   Letter ── Envelope ── base Slots, overlays (stamps, changed slots)
//!      └───── payload: Bytes ──▶ Message ── performative, AgentIds, Expressions, content: Bytes
//! ```
//!
//! **Knows** what a message, an agent identifier (AID), an expression, a date and an envelope
//! are (FIPA SC00061G, SC00037J, SC00067F), and how to build and answer a message.
//! **Never knows** how they look on a wire, who they are for, what time it is, or a runtime.
//!
//! Contents are slices of shared buffers ([`bytes::Bytes`]), and so are texts but short ones, which
//! are held within their values ([`Text`]): decoding a received buffer allocates for neither.
//!
//! ```
//! use fipa_acl::{AgentId, Message, Performative};
//!
//! let request = Message::new(Performative::Request)
//!     .from_agent("a@robot1")
//!     .to("b@robot2")
//!     .protocol("fipa-request")
//!     .conversation_id("c-1")
//!     .reply_with("r-1")
//!     .content("(open gripper)");
//! let answer = request.reply(Performative::Inform).content("(done)");
//! assert_eq!(answer.receiver, [AgentId::new("a@robot1")]);
//! assert_eq!(answer.in_reply_to.unwrap().to_string(), "r-1");
//! ```

mod agent_id;
mod envelope;
mod expression;
mod message;
mod performative;
mod text;
mod time;

pub use agent_id::{AgentId, UserDefined, canonical_user_name};
pub use envelope::{Envelope, Letter, Received, Representation, Slots};
pub use expression::{Expression, ParseExpressionError};
pub use message::Message;
pub use performative::Performative;
pub use text::{NotUtf8, Text};
pub use time::{CivilTime, FipaTime, InvalidTime, InvalidToken, Relative, Zone};
