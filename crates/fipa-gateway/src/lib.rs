//! Makes what is too small for FIPA appear as agents.
//!
//! ```text
//!   text agent ─▶ robot_text::Platform ─┐                        ┌─▶ register, deregister
//!   place      ◀─        write        ◀─┤ TextGateway ◀── now ──▶│
//!                                       └─ conversations ────────┴─▶ ACL message ─▶ fleet
//!   HIAC device ◀─▶ hiac::Station ◀─▶ HiacGateway ◀─▶ the same
//! ```
//!
//! **Knows** which ACL message stands for which message inside the robot, both ways, and which
//! conversations wait for an answer. **Never knows** a socket, a clock or the directory: those
//! come in as arguments, what is to be done comes out as values.

mod hiac;
mod text;

pub use self::hiac::{HIAC_DEVICE, HiacGateway, HiacNames, HiacOutput};
pub use text::{TextGateway, TextOutput};
