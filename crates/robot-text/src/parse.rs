//! From the octets of one message to a [`Message`].

use std::collections::BTreeMap;

use crate::message::MAX_OCTETS;
use crate::{Kind, Message};

/// Why a message cannot be read. Where several hold, the first of this order is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, thiserror::Error)]
pub enum Fault {
    /// Another message began, or the stream ended, before its closing brace.
    #[error("it has no closing brace")]
    Unfinished,
    /// It is longer than [`MAX_OCTETS`].
    #[error("it is longer than {MAX_OCTETS} octets")]
    Length,
    /// It has an octet that may not stand where it stands.
    #[error("it has an octet that is not printable ASCII")]
    Character,
    /// A field is empty, has no `:` or `=`, or a key that is none.
    #[error("a field is empty, has no : or =, or its key is no word")]
    Syntax,
    /// A key stands twice.
    #[error("a key stands twice")]
    Duplicate,
    /// It is not exactly one of action, question, answer and status.
    #[error("it has not exactly one of A, Q, R and S")]
    Kind,
    /// A field that it needs is absent, or O, D or X is empty.
    #[error("O, D or X is empty, or one that it needs is absent")]
    Missing,
    /// It is a status with a receiver.
    #[error("a status has no receiver")]
    Unexpected,
    /// The urgency is not one digit.
    #[error("the urgency is not one digit")]
    Urgency,
}

impl Fault {
    /// The word that programs are told.
    pub fn word(self) -> &'static str {
        match self {
            Fault::Unfinished => "unfinished",
            Fault::Length => "length",
            Fault::Character => "character",
            Fault::Syntax => "syntax",
            Fault::Duplicate => "duplicate",
            Fault::Kind => "kind",
            Fault::Missing => "missing",
            Fault::Unexpected => "unexpected",
            Fault::Urgency => "urgency",
        }
    }
}

/// Reads one message, from its opening to its closing brace.
///
/// # Errors
/// What is wrong with it; octets before, behind or between braces are [`Fault::Unfinished`].
pub fn parse(octets: &[u8]) -> Result<Message, Fault> {
    let inner = octets
        .strip_prefix(b"{")
        .and_then(|rest| rest.strip_suffix(b"}"))
        .filter(|inner| !inner.iter().any(|octet| matches!(octet, b'{' | b'}')))
        .ok_or(Fault::Unfinished)?;
    if octets.len() > MAX_OCTETS {
        return Err(Fault::Length);
    }
    let raw: Vec<&[u8]> = inner.split(|octet| *octet == b';').collect();
    // Characters come first over the whole message, then the fields one by one.
    if !raw.iter().all(|field| has_legal_characters(field)) {
        return Err(Fault::Character);
    }
    let raw = match raw.as_slice() {
        // The last field may end with a semicolon as well.
        [fields @ .., last] if !fields.is_empty() && trim(last).is_empty() => fields,
        all => all,
    };
    let fields = raw
        .iter()
        .map(|field| split(field).ok_or(Fault::Syntax))
        .collect::<Result<Vec<_>, _>>()?;
    let mut by_key = BTreeMap::new();
    for (key, value) in fields {
        if by_key.insert(key, value).is_some() {
            return Err(Fault::Duplicate);
        }
    }
    build(by_key)
}

fn build(mut fields: BTreeMap<&str, &str>) -> Result<Message, Fault> {
    let mut bodies = Kind::ALL
        .into_iter()
        .filter_map(|kind| Some((kind, fields.remove(kind.key())?.to_owned())));
    let body = bodies.next().ok_or(Fault::Kind)?;
    if bodies.next().is_some() {
        return Err(Fault::Kind);
    }
    drop(bodies);
    let mut take = |key| fields.remove(key).map(str::to_owned);
    let (origin, destination, reference) = (take("O"), take("D"), take("X"));
    let urgency = take("U");
    let message = Message {
        origin,
        destination,
        reference,
        urgency: None,
        body,
        other: owned(&fields),
    };
    check_presence(&message)?;
    let urgency = urgency
        .map(|digit| match digit.as_bytes() {
            [digit @ b'0'..=b'9'] => Ok(digit - b'0'),
            _ => Err(Fault::Urgency),
        })
        .transpose()?;
    Ok(Message { urgency, ..message })
}

fn owned(fields: &BTreeMap<&str, &str>) -> BTreeMap<String, String> {
    fields
        .iter()
        .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
        .collect()
}

/// Which of sender, receiver and reference a message of its kind needs and may have.
pub(crate) fn check_presence(message: &Message) -> Result<(), Fault> {
    let names = [&message.origin, &message.destination, &message.reference];
    let empty = |name: &&Option<String>| name.as_ref().is_some_and(String::is_empty);
    let (origin, destination) = (message.origin.is_some(), message.destination.is_some());
    let complete = match message.kind() {
        Kind::Action => destination,
        Kind::Question | Kind::Answer => origin && destination,
        Kind::Status => origin,
    };
    if names.iter().any(empty) || !complete {
        return Err(Fault::Missing);
    }
    match message.kind() {
        Kind::Status if destination => Err(Fault::Unexpected),
        _ => Ok(()),
    }
}

/// Whether the only octets besides printable ASCII are blanks around the key and the value.
fn has_legal_characters(field: &[u8]) -> bool {
    let separator = field.iter().position(|octet| is_separator(*octet));
    let (key, value) = match separator {
        Some(at) => (&field[..at], &field[at + 1..]),
        None => (field, &[][..]),
    };
    let printable = |part: &[u8]| trim(part).iter().all(|octet| is_printable(*octet));
    printable(key) && printable(value)
}

fn split(field: &[u8]) -> Option<(&str, &str)> {
    let at = field.iter().position(|octet| is_separator(*octet))?;
    let (key, value) = (trim(&field[..at]), trim(&field[at + 1..]));
    let (key, value) = (
        std::str::from_utf8(key).ok()?,
        std::str::from_utf8(value).ok()?,
    );
    is_key(key).then_some((key, value))
}

pub(crate) fn is_key(key: &str) -> bool {
    let legal = |octet| matches!(octet, 0x21..=0x7E) && !is_reserved(octet) && !is_separator(octet);
    !key.is_empty() && key.bytes().all(legal)
}

pub(crate) fn is_value(value: &str) -> bool {
    let legal = |octet| is_printable(octet) && !is_reserved(octet);
    value.bytes().all(legal) && trim(value.as_bytes()).len() == value.len()
}

fn is_separator(octet: u8) -> bool {
    matches!(octet, b':' | b'=')
}

fn is_printable(octet: u8) -> bool {
    matches!(octet, 0x20..=0x7E)
}

fn is_reserved(octet: u8) -> bool {
    matches!(octet, b'{' | b'}' | b';')
}

fn trim(octets: &[u8]) -> &[u8] {
    let blank = |octet: &u8| matches!(octet, b' ' | b'\t' | b'\r' | b'\n');
    let Some(first) = octets.iter().position(|octet| !blank(octet)) else {
        return &[];
    };
    let last = octets
        .iter()
        .rposition(|octet| !blank(octet))
        .unwrap_or(first);
    &octets[first..=last]
}
