//! The JSON forms: what is shown, what is read, which errors.

mod letter;
mod message;
mod sniffed;
mod strategies;
