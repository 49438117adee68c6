//! The JSON forms of messages, letters and what passes inside a robot, which programs script.
//!
//! **Knows** which key stands for which parameter, how octets, dates, expressions and
//! user-defined names look in JSON, and which value is wrong in what a program wrote.
//! **Never knows** an encoding, in which order a representation writes envelopes, a clock or a file.
//!
//! ```
//! use fipa_acl::{Message, Performative};
//!
//! let inform = Message::new(Performative::Inform).to("b@robot2").content("hi");
//! let json = fipa_json::message_to_json(&inform);
//! assert_eq!(
//!     json.to_string(),
//!     r#"{"performative":"inform","receiver":[{"name":"b@robot2"}],"content":"hi"}"#
//! );
//! assert_eq!(fipa_json::message_from_json(&json), Ok(inform));
//! ```
//!
//! # Shapes
//!
//! * Absent parameters and empty lists are absent keys. `null` is no value.
//! * Octets are a string when they are UTF-8, else `{"base64":"…"}`; both are read.
//! * User-defined names stand with exactly one `X-`; read are names with any number of them, none
//!   included. A name given twice has the value given last.
//! * Unknown keys are errors, so that a misspelt parameter is not lost silently. A caller that
//!   allows further keys takes them out first.

mod agent_id;
mod directory;
mod envelope;
mod error;
mod hiac;
mod letter;
mod message;
mod reader;
mod robot_text;
mod sniffed;
mod values;

pub use agent_id::{agent_id_from_json, agent_id_to_json};
pub use directory::{outcome_to_json, record_to_json};
pub use error::JsonError;
pub use hiac::{HiacForm, hiac_from_json, hiac_to_json};
pub use letter::{
    Body, EnvelopeForm, LetterForm, envelope_for, letter_from_json, letter_to_json,
    raw_letter_to_json,
};
pub use message::{message_from_json, message_to_json};
pub use robot_text::{text_from_json, text_to_json, unreadable_text_to_json};
pub use sniffed::sniffed_to_json;
