//! EDCP and HIACP: how the microcontrollers inside a robot talk to their employers and to each
//! other ("Hierarchical Inter-Agent Communication").
//!
//! ```text
//!   octets of the link ─ edcp::Decoder ─▶ octets of a packet ─ Packet::decode ─▶ Packet
//!   octets of the link ◀─ edcp::escaped ─ octets of a packet ◀─ Packet::encode ── Packet
//!   octets of the link ◀────────────── Station ──────────────▶ messages, signals, confirmations
//! ```
//!
//! **Knows** how a packet is written and found again in a noisy stream, and with the feature
//! `alloc` how stations of a hierarchy speak by such packets ([`Station`]). **Never knows** a clock,
//! nor a socket outside of `links`: it is `no_std` and runs unchanged on a microcontroller and in
//! the daemon. Without `alloc` it works octet by octet in memory that it is given.
//!
//! A port of a microcontroller for packets of up to 64 octets takes 100 octets of memory and some
//! kilobytes of code, besides the tables of CRC-32: see `examples/microcontroller`, which is not
//! built when that does not hold.
//!
//! ```
//! use hiac::{Addressing, Mask, Packet, PacketType, edcp};
//!
//! // "Signal 1" from employee 3 to employee 5, under a mask of eight bits.
//! let mask = Mask::new(0x0000_00FF).unwrap();
//! let addressing = Addressing::Level { target: 5, source: 3 };
//! let packet = Packet::new(PacketType::SIG, 1, addressing, &[1]);
//! let encoded = packet.encode(Some(mask)).unwrap();
//! let link: Vec<u8> = edcp::escaped(encoded.octets()).collect();
//! assert_eq!(link, [0xF8, 0x11, 0x10, 0x05, 0x03, 0x01, 0x01, 0x2B, 0xF9]);
//! ```

#![no_std]

#[cfg(feature = "alloc")]
extern crate alloc;
#[cfg(feature = "links")]
extern crate std;

mod address;
mod buffer;
pub mod content;
pub mod edcp;
#[cfg(feature = "links")]
pub mod links;
mod packet;
mod read;
#[cfg(feature = "alloc")]
pub mod station;
pub mod sys;
mod write;

pub use address::{Address, AddressError, Level, Mask, MaskError};
#[cfg(feature = "alloc")]
pub use buffer::Growing;
pub use buffer::{Buffer, Fixed};
pub use content::Content;
pub use packet::{Addressing, Check, Fragment, Numbered, Packet, PacketType};
pub use read::ReadError;
#[cfg(feature = "alloc")]
pub use station::Station;
pub use sys::Outcome;
pub use write::{Encoded, WriteError};
