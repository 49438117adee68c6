//! Sockets: streams between platforms, and between programs and their platform.
//!
//! **Knows** how to listen, how to reach the first of several addresses, and how to move octets
//! with few system calls. **Never knows** what the octets mean: a [`Driver`] takes what was read
//! and gives what is to be written.
//!
//! With the feature `tls`, TCP streams between robots of a fleet are secured: each shows its
//! certificate, and a [`Stream`] says by [`identity`](Stream::identity) whose it is. With the feature
//! `quic` they may be linked over QUIC as well.

mod buffers;
mod dial;
mod handle;
#[cfg(feature = "http")]
pub mod http;
mod listen;
mod pump;
#[cfg(feature = "quic")]
mod quic;
#[cfg(feature = "raw")]
pub mod raw;
mod stream;
mod tcp;
#[cfg(feature = "tls")]
mod tls;
mod unix;

pub use buffers::Buffers;
#[cfg(feature = "quic")]
pub use dial::dial_link;
#[cfg(feature = "tls")]
pub use dial::dial_secured;
pub use dial::{DialError, dial};
pub use handle::Handle;
pub use listen::{BindError, Listener};
pub use pump::{Driver, End, LANES, pump};
#[cfg(feature = "quic")]
pub use quic::Quic;
pub use stream::Stream;
#[cfg(feature = "tls")]
pub use tls::{FirstOctet, KeyError, Tls};
