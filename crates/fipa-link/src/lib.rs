//! The stream link: how platforms, and programs with their platform, talk over a byte stream.
//!
//! ```text
//!   preamble  8F "FIPA" 0D 0A 01          begins like no FIPA encoding, TLS record or HTTP request
//!   frame     length: u32 │ kind: u8 │ body          length counts what follows it; big endian
//!             length: u32 │ kind: u8 + 128 │ CRC-32 of the body │ CRC-32 of these 9 octets │ body
//!
//!   hello ──▶              who speaks: version, instance, name, scope, endpoints
//!   letter ─▶ ◀─ receipt   a letter, and what became of it, receiver by receiver
//!   attach, detach ─▶ ◀─ answer      a program's agents
//!   directory ─▶           snapshot, then changes; numbered by their owner
//!   platforms ─▶           who else has an open link with the speaker, and where to dial
//!   revoked ─▶             what the fleet has revoked
//!   ask ─▶ ◀─ facts        what a person who looks for a fault wants to know
//!   sniff ─▶ ◀─ sniffed   a program watches what passes; on the control socket only
//!   ask ─▶ ◀─ called back  whether the other side reaches the speaker
//!   ping ─▶ ◀─ pong        heartbeat                goodbye ─▶ the reason for closing
//! ```
//!
//! Frames have checksums once both sides have said in their hello that they want them: services do
//! on a network, programs on their control socket do not. The hello has one of its own.
//!
//! **Knows** the octets of a frame and the life of one link: preamble, hello, heartbeat, end.
//! **Never knows** a socket or a clock, where a letter goes, or what the directory holds. A link
//! between daemons and the control link of a program are the same.

mod call_back;
mod check;
mod facts;
mod frame;
mod hello;
mod incoming;
mod lanes;
mod link;
mod outcome;
mod outgoing;
mod parts;
mod platforms;
mod run;
mod sniffed;
mod wire;

pub use call_back::{AskCallBack, CallBack, CallBackResult, CalledBack};
pub use facts::{Facts, PeerFacts};
pub use frame::{DirectoryFrame, DirectoryItem, Frame, LetterFrame};
pub use hello::{Hello, Role};
pub use link::{Event, Link, LinkConfig, LinkError};
pub use outcome::{Outcome, Outcomes, ReceiverOutcome, WrittenOutcomes};
pub use parts::Parts;
pub use platforms::KnownPlatform;
pub use run::{Piece, Run};
pub use sniffed::{Inside, Passed, Sniffed};
pub use wire::FrameError;

/// Streams beside the main one that a link may have for its letters.
pub const LANES: usize = 3;

/// The octets that open a link; the last is the version of the framing.
pub const PREAMBLE: [u8; 8] = *b"\x8fFIPA\r\n\x01";
