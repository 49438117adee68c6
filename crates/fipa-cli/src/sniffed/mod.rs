//! What passed a daemon, as people are shown it.
//!
//! **Knows** the lines of a letter log, and what the protocols of conversations say of them.
//! **Never knows** where they come from: a daemon or a file.

mod charts;
mod lines;

use std::time::Duration;

use fipa::{FipaTime, Message, Pattern};
use fipa_directory::Now;
use fipa_json::message_from_json;
use serde_json::Value;

pub(crate) use charts::charts;
pub(crate) use lines::lines;

use crate::chart::shortened;

/// Letters of a content that are kept for a chart.
const KEPT: usize = 64;

/// A line of a letter log.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    /// As it stands there, which is in the order of time.
    time: String,
    /// The order of those of one time.
    number: u64,
    what: What,
}

#[derive(Clone, Debug)]
enum What {
    Letter(Letter),
    Inside(Inside),
    /// So much was not told.
    Lost(u64),
}

#[derive(Clone, Debug)]
struct Letter {
    from: String,
    receivers: Vec<Receiver>,
    /// `?` where the message cannot be read.
    performative: String,
    protocol: Option<String>,
    conversation: Option<String>,
    content: String,
    octets: Option<u64>,
    /// Without its content; only what is to be judged has one.
    message: Option<Box<Message>>,
}

#[derive(Clone, Debug)]
struct Receiver {
    name: String,
    /// The outcome and the reason; `None` when it is not known.
    outcome: Option<(String, String)>,
}

/// A message between the daemon and a device.
#[derive(Clone, Debug)]
struct Inside {
    protocol: String,
    direction: String,
    place: String,
    from: String,
    to: String,
    /// Whether it says itself from whom to whom it is.
    is_addressed: bool,
    /// The key of what it says, or its type.
    kind: String,
    text: String,
}

impl Entry {
    /// Reads a line; what is wrong with it, if it is none. A line with nothing but a message is
    /// one.
    pub(crate) fn read(line: &Value) -> Result<Entry, String> {
        let event = line.get("event").and_then(Value::as_str);
        let what = match event {
            None | Some("letter") => What::Letter(letter(line)?),
            Some("lost") => What::Lost(line.get("count").and_then(Value::as_u64).unwrap_or(0)),
            Some(protocol) => What::Inside(inside(line, protocol)?),
        };
        Ok(Entry {
            time: text(line, "time").unwrap_or_default(),
            number: line.get("number").and_then(Value::as_u64).unwrap_or(0),
            what,
        })
    }

    /// With its message, which can be judged then. A message that is none is not judged.
    pub(crate) fn with_message(mut self, line: &Value) -> Entry {
        if let (What::Letter(letter), Some(message)) = (&mut self.what, line.get("message")) {
            let message = message_from_json(message).ok();
            letter.message = message.map(|message| {
                Box::new(Message {
                    content: None,
                    ..message
                })
            });
            // Many may be kept, and no more than this is drawn.
            letter.content = shortened(&letter.content, KEPT);
        }
        self
    }

    /// Whether an agent of such a name has to do with it. What is lost may have been for any.
    pub(crate) fn concerns(&self, agent: &Pattern) -> bool {
        let is_match = |name: &String| agent.matches(name);
        match &self.what {
            What::Letter(letter) => {
                is_match(&letter.from) || letter.receivers.iter().any(|to| is_match(&to.name))
            }
            What::Inside(inside) => is_match(&inside.from) || is_match(&inside.to),
            What::Lost(_) => true,
        }
    }

    /// By what entries are ordered: a log holds them in the order in which outcomes were known.
    pub(crate) fn order(&self) -> (&str, u64) {
        (&self.time, self.number)
    }
}

fn letter(line: &Value) -> Result<Letter, String> {
    let (message, envelope) = (line.get("message"), line.get("envelope"));
    if message.is_none() && envelope.is_none() && line.get("error").is_none() {
        return Err("there is no message in it".to_owned());
    }
    let of_message = |key| message.and_then(|message| text(message, key));
    let sender = message.and_then(|m| m.get("sender"));
    let from = sender.or_else(|| envelope?.get("from"));
    Ok(Letter {
        from: from
            .and_then(|from| text(from, "name"))
            .unwrap_or_else(unknown),
        receivers: receivers(line, message, envelope),
        performative: of_message("performative").unwrap_or_else(unknown),
        protocol: of_message("protocol"),
        conversation: of_message("conversation-id"),
        content: message.map_or_else(String::new, content),
        octets: line.get("octets").and_then(Value::as_u64),
        message: None,
    })
}

/// Since 1970-01-01T00:00:00Z.
fn unix_millis(time: &str) -> Option<i64> {
    match time.parse() {
        Ok(FipaTime::Absolute { unix_millis, .. }) => Some(unix_millis),
        _ => None,
    }
}

/// The time of a line, by which deadlines are judged. Where there is none, nothing is late.
pub(crate) fn now(time: &str) -> Now {
    let unix_millis = unix_millis(time).unwrap_or(0);
    Now {
        mono: Duration::from_millis(unix_millis.try_into().unwrap_or(0)),
        unix_millis,
    }
}

/// Those who were found, else those who were meant.
fn receivers(line: &Value, message: Option<&Value>, envelope: Option<&Value>) -> Vec<Receiver> {
    let outcomes = list(Some(line), "outcomes").map(|outcome| Receiver {
        name: text(outcome, "to").unwrap_or_default(),
        outcome: text(outcome, "outcome").map(|word| {
            let reason = text(outcome, "reason").unwrap_or_default();
            (word, reason)
        }),
    });
    let told: Vec<Receiver> = outcomes.collect();
    if !told.is_empty() {
        return told;
    }
    let meant = [
        (envelope, "intended-receiver"),
        (envelope, "to"),
        (message, "receiver"),
    ];
    let meant = meant.into_iter().map(|(of, key)| {
        let names = list(of, key).filter_map(|agent| text(agent, "name"));
        let receiver = |name| Receiver {
            name,
            outcome: None,
        };
        names.map(receiver).collect::<Vec<_>>()
    });
    meant
        .into_iter()
        .find(|names| !names.is_empty())
        .unwrap_or_default()
}

fn content(message: &Value) -> String {
    match message.get("content") {
        Some(Value::String(text)) => text.clone(),
        Some(_) => "octets".to_owned(),
        None => String::new(),
    }
}

fn inside(line: &Value, protocol: &str) -> Result<Inside, String> {
    let form = line.get(protocol);
    let form = form.ok_or_else(|| format!("there is no {protocol} in it"))?;
    let direction = text(line, "direction").unwrap_or_else(unknown);
    let place = text(line, "place").unwrap_or_else(unknown);
    let (here, there) = ("daemon".to_owned(), place.clone());
    let (from, to) = match direction.as_str() {
        "out" => (here, there),
        _ => (there, here),
    };
    let either = |one: &str, other: &str| text(form, one).or_else(|| text(form, other));
    let kinds = ["action", "question", "answer", "status", "error", "type"];
    let kind = kinds.iter().find(|kind| form.get(**kind).is_some());
    let said = kind.and_then(|kind| text(form, kind));
    let (kind, said) = match kind {
        // A packet is called what its type is, and says its data.
        Some(&"type") => (said.unwrap_or_else(unknown), text(form, "data")),
        // One that cannot be read is called what is wrong with it, and says its octets.
        Some(&"error") if protocol == "hiac" => {
            (said.unwrap_or_else(unknown), text(form, "octets"))
        }
        Some(kind) => ((*kind).to_owned(), said),
        None => (unknown(), None),
    };
    let (origin, destination) = (either("origin", "source"), either("destination", "target"));
    Ok(Inside {
        protocol: protocol.to_owned(),
        direction,
        place,
        is_addressed: origin.is_some() && destination.is_some(),
        from: origin.unwrap_or(from),
        to: destination.unwrap_or(to),
        kind,
        text: said.unwrap_or_default(),
    })
}

fn list<'a>(of: Option<&'a Value>, key: &str) -> impl Iterator<Item = &'a Value> {
    let items = of.and_then(|of| of.get(key)).and_then(Value::as_array);
    items.into_iter().flatten()
}

fn text(of: &Value, key: &str) -> Option<String> {
    match of.get(key)? {
        Value::String(text) => Some(text.clone()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    }
}

fn unknown() -> String {
    "?".to_owned()
}
