//! The conversation monitor: whether each message of a conversation is one that its interaction
//! protocol has, and what would have been.
//!
//! ```text
//!   message in or out, time ──▶ Monitor ── by conversation-id ──▶ Conversation
//!                                  │                               initiator
//!            Verdict, Event ◀──────┘                               participant: state, roles, deadline
//!                                                                  └── sub-conversations
//! ```
//!
//! **Knows** who plays which role, which state each participant is in, until when an answer is waited
//! for, and how conversations end. **Never knows** contents, a clock, or whether a violating message
//! is taken all the same: that is the agent's decision.
//!
//! ```
//! use std::sync::Arc;
//! use fipa_acl::{Message, Performative};
//! use fipa_conversation::{Config, Monitor, Verdict};
//! use fipa_directory::Now;
//! use fipa_protocol::Library;
//!
//! let mut monitor = Monitor::new(Arc::new(Library::builtin()), Some("arm@r1".into()), Config::default());
//! let request = Message::new(Performative::Request)
//!     .from_agent("arm@r1")
//!     .to("drive@r2")
//!     .protocol("fipa-request")
//!     .conversation_id("c-1");
//! assert_eq!(monitor.observe(Now::default(), &request), Verdict::Accepted { state: "requested".into() });
//! let answer = request.reply(Performative::Propose).from_agent("drive@r2");
//! let Verdict::Violation(violation) = monitor.observe(Now::default(), &answer) else { panic!() };
//! assert_eq!(
//!     violation.text,
//!     "drive@r2 may not send propose in the state requested of fipa-request; expected: \
//!      refuse, agree, inform or failure from participant (drive@r2) to initiator (arm@r1)"
//! );
//! ```
//!
//! # Conversations within a conversation
//!
//! Where the state has a `subprotocol`, a message with the same conversation-id and the name of
//! another protocol begins a sub-conversation, or belongs to one. An agent that uses ids of their
//! own for them, as the specifications of FIPA have it, has them monitored as conversations of
//! their own.
//!
//! # Where this differs from the monitor of fipa_acl
//!
//! With a protocol that asks for the rules `fipa-acl` it behaves as that one does, except that
//!
//! * a message that violates the protocol is told as a [`Violation`], not by an exception, and
//!   changes nothing; one that names no known protocol or no conversation is
//!   [not monitored](Verdict::NotMonitored);
//! * the encoding is not compared: it may change with every content; in-reply-to, language and
//!   ontology are where a file asks for that (`fipa:match`);
//! * a conversation that has ended is forgotten in time, without being removed by hand;
//! * a final state with transitions does not end the conversation, because what they take would
//!   then always be refused: it is over when nothing was heard for a while, as done;
//! * without an announced number of sub-conversations, any number is accepted: who only watches
//!   cannot know it;
//! * an accepted message gives an event, and the end another one, so that a protocol of one
//!   message is seen to begin as well.
//!
//! With the rules of FIPA, which hold for all other files, each participant has a state of its own,
//! `cancel` comes from the initiator only and does not end what could not be cancelled, and a
//! broker passes on an answer of each agent that it asked.

mod branch;
mod conversation;
mod event;
mod explain;
mod foreign;
mod judge;
mod machine;
mod monitor;
mod not_understood;
mod plan;
mod verdict;

pub use conversation::{Conversation, Participant};
pub use event::{Event, EventKind};
pub use monitor::{Config, Monitor};
pub use not_understood::not_understood_reply;
pub use verdict::{Expected, Rule, Verdict, Violation};
