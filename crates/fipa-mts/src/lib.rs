//! The message transport service (FIPA SC00067F) as a state machine, and the program's end of it.
//!
//! ```text
//!             register, submit                      mailbox
//!   agent ───────────────┐                        ┌────────▶ agent
//!                        ▼                        │
//!   link ─ letter ──▶ take in: stamped by us? ──▶ resolve: exact name, then pattern
//!                        │ 1 submission           │ 1 delivery a receiver, with its own overlay
//!                        ▼                        ▼
//!   link ◀─ receipt ── outcomes of all ◀── mailbox │ program's link │ peer's link │ dial
//!                                                  │ a connection of its own, in a dialect
//! ```
//!
//! A connection that somebody else opened is our link, or brings one letter of another make: its
//! first octets tell. Letters to agents of other makes leave in the dialect of their location's
//! signature, one a connection, posted over HTTP or handed to a transport that is plugged in, and their outcome is `sent`: nobody over there
//! gives receipts.
//!
//! **Knows** stamps, receivers, who is reached over which link, what became of each letter, when
//! to dial and when a peer is gone. **Never knows** a socket, a clock or a payload: time and
//! octets come in as arguments ([`Machine`]), what is to be done comes out as [`Output`].
//!
//! [`Mts`] is a daemon or an in-process platform, [`Program`] the end of a control link that
//! attaches agents to a daemon.

mod config;
mod failure;
mod machine;
mod mailbox;
mod mts;
mod outbox;
mod pieces;
mod program;
mod rules;
mod urgency;

pub use config::{Config, ProgramConfig};
pub use failure::DeliveryFailure;
pub use machine::{
    Announced, Arrived, ConnId, Connected, DialId, Ended, Machine, Notice, Output, PostFailure,
    PostId, PostedLetter, Refusal, RegisterError, Registration, SentLetter, Submission, TakenOver,
    is_full,
};
pub use mailbox::{Mailbox, MailboxFull};
pub use mts::{Mts, ONLY_FLEET};
pub use outbox::{OutboxConfig, StoredLetter};
pub use program::Program;
pub use rules::{Action, NamePattern, Network, NetworkError, Rule, Rules};
pub use urgency::Urgency;
