//! The FIPA encodings: messages and envelopes to bytes and back.
//!
//! **Knows** every octet of the representations (SC00069G, SC00088D) and the decisions where
//! peers differ. **Never knows** a runtime, socket, clock or logger, nor what a message means.

#[cfg(feature = "proptest")]
pub mod arbitrary;
pub mod bit_efficient;
mod charset;
mod dates;
mod decimal;
mod detect;
mod dialect;
mod dispatch;
mod error;
#[cfg(feature = "fuzzing")]
pub mod fuzzing;
mod letter;
mod limits;
mod output;
pub mod string;
mod user_names;
pub mod xml;

pub use detect::{Form, detect};
pub use dialect::Dialect;
pub use dispatch::{
    EnvelopeRepresentation, decode_envelope, decode_layers, decode_letter, decode_letter_prefix,
    decode_message, decode_message_prefix, encode_envelope, encode_envelope_as, encode_letter,
    encode_letter_as, encode_message, encode_message_as,
};
pub use error::{DecodeError, EncodeError, Fault};
pub use letter::{decode_payload, decode_payload_as, payload_encoding, payload_representation};
pub use limits::Limits;
pub use output::{Output, Parts};
