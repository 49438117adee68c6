//! Sockets: streams between platforms, and between programs and their platform.
//!
//! **Knows** how to listen, how to reach the first of several addresses, and how to move octets
//! with few system calls. **Never knows** what the octets mean: a [`Driver`] takes what was read
//! and gives what is to be written.

mod buffers;
mod dial;
mod handle;
#[cfg(feature = "http")]
pub mod http;
mod listen;
mod pump;
mod stream;
mod tcp;
mod unix;

pub use buffers::Buffers;
pub use dial::{DialError, dial};
pub use handle::Handle;
pub use listen::{BindError, Listener};
pub use pump::{Driver, End, pump};
pub use stream::Stream;
