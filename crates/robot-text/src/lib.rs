//! The plain text format of small robots ("Projet Robot, format des messages inter agents", 2016)
//! and the platform on which its agents find each other.
//!
//! ```text
//!   octets ─ Reader ─▶ Message ─▶ Platform ─┬─▶ another agent's place ─ UrgencyQueue ─ write ─▶ octets
//!                                           └─▶ the fleet
//! ```
//!
//! **Knows** how a message is read and written, which answer belongs to which question, who
//! subscribed to whose status, and where each agent is. **Never knows** a socket or a clock: time
//! and octets come in as arguments, what is to be done comes out as [`Output`].
//!
//! ```
//! use robot_text::{Kind, Message, Reader};
//!
//! let mut reader = Reader::new();
//! reader.push(b"{O: MAITRE ; D: ESCLAVE ; X=1 ; A: COM}");
//! let message = reader.next().unwrap().unwrap();
//! assert_eq!(message.destination.as_deref(), Some("ESCLAVE"));
//! assert_eq!(message.body, (Kind::Action, "COM".to_owned()));
//! assert_eq!(message.to_text().unwrap(), "{O:MAITRE;D:ESCLAVE;X=1;A:COM}");
//! ```

#[cfg(feature = "links")]
pub mod links;
mod message;
mod parse;
mod platform;
mod queue;
mod reader;
mod write;

pub use message::{Kind, MAX_OCTETS, Message};
pub use parse::{Fault, parse};
pub use platform::{
    Counters, DeclareError, Output, PLATFORM, Place, Platform, PlatformConfig, StreamId,
    Unanswered, is_name,
};
pub use queue::UrgencyQueue;
pub use reader::{Reader, Unreadable};
pub use write::WriteError;
