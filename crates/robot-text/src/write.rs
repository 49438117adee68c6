//! From a [`Message`] to its one written form.

use crate::message::MAX_OCTETS;
use crate::parse::{Fault, check_presence, is_key, is_value};
use crate::{Kind, Message};

/// Why a message cannot be written: it could not be read back as the same.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// A value has an octet that is not printable ASCII, one of `{`, `}` and `;`, or a blank at an
    /// end.
    #[error("{key}: {value:?} is not printable ASCII without {{ }} ; and blanks at the ends")]
    Value {
        /// The key.
        key: String,
        /// The value.
        value: String,
    },
    /// A further key is no word, or one of the format's own.
    #[error("{0:?} is no key that a message may have besides its own")]
    Key(String),
    /// O, D or X is empty, or one that it needs is absent.
    #[error("O, D or X is empty, or one that it needs is absent")]
    Missing,
    /// A status has a receiver.
    #[error("a status has no receiver")]
    Unexpected,
    /// The urgency is above 9.
    #[error("the urgency {0} is not one digit")]
    Urgency(u8),
    /// The message would be longer than [`MAX_OCTETS`].
    #[error("the message has {0} octets, more than {MAX_OCTETS}")]
    Length(usize),
}

impl Message {
    /// Its written form: O, D, X, U, then the body, then what else there is in the order of the
    /// keys; `=` behind X and U, `:` behind all others; no blanks.
    ///
    /// # Errors
    /// If it could not be read back as the same.
    pub fn to_text(&self) -> Result<String, WriteError> {
        match check_presence(self) {
            Err(Fault::Unexpected) => return Err(WriteError::Unexpected),
            Err(_) => return Err(WriteError::Missing),
            Ok(()) => {}
        }
        let mut text = String::from("{");
        field(&mut text, "O", ':', self.origin.as_deref())?;
        field(&mut text, "D", ':', self.destination.as_deref())?;
        field(&mut text, "X", '=', self.reference.as_deref())?;
        if let Some(urgency) = self.urgency {
            let digit = char::from_digit(urgency.into(), 10).ok_or(WriteError::Urgency(urgency))?;
            field(&mut text, "U", '=', Some(digit.encode_utf8(&mut [0])))?;
        }
        field(&mut text, self.kind().key(), ':', Some(self.text()))?;
        for (key, value) in &self.other {
            if !is_key(key) || is_own(key) {
                return Err(WriteError::Key(key.clone()));
            }
            field(&mut text, key, ':', Some(value))?;
        }
        // The last field's semicolon makes room for the brace.
        text.pop();
        text.push('}');
        match text.len() {
            ..=MAX_OCTETS => Ok(text),
            length => Err(WriteError::Length(length)),
        }
    }
}

fn field(
    text: &mut String,
    key: &str,
    separator: char,
    value: Option<&str>,
) -> Result<(), WriteError> {
    let Some(value) = value else {
        return Ok(());
    };
    if !is_value(value) {
        return Err(WriteError::Value {
            key: key.to_owned(),
            value: value.to_owned(),
        });
    }
    text.push_str(key);
    text.push(separator);
    text.push_str(value);
    text.push(';');
    Ok(())
}

fn is_own(key: &str) -> bool {
    matches!(key, "O" | "D" | "X" | "U") || Kind::ALL.iter().any(|kind| kind.key() == key)
}
