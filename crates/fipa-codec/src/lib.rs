//! The FIPA encodings: messages and envelopes to bytes and back.
//!
//! **Knows** every octet of the representations (SC00069G, SC00088D) and the decisions where
//! peers differ. **Never knows** a runtime, socket, clock or logger, nor what a message means.

#[cfg(feature = "proptest")]
pub mod arbitrary;
pub mod bit_efficient;
mod detect;
mod error;
mod limits;
mod output;

pub use detect::{Form, detect};
pub use error::{DecodeError, EncodeError, Fault};
pub use limits::Limits;
pub use output::{Output, Parts};
