use std::collections::HashMap;
use std::sync::Arc;

use fipa_acl::{Expression, Message};
use fipa_directory::Now;
use fipa_json::message_from_json;
use fipa_protocol::{Library, Protocol};
use serde_json::Value;

use crate::json_values::JsonValues;
use crate::sniffed;

/// What an input holds.
#[derive(Default)]
pub(super) struct Recorded {
    /// In the order in which they begin.
    pub(super) conversations: Vec<Vec<Said>>,
    /// Whether it is a letter log.
    pub(super) is_log: bool,
    /// What is missing in it.
    pub(super) lost: u64,
}

/// A message, and when.
pub(super) struct Said {
    pub(super) now: Now,
    pub(super) message: Message,
}

/// A line of a log, and by what lines are ordered.
struct Line {
    time: String,
    number: u64,
    message: Message,
}

impl Recorded {
    /// Reads messages, or letters as other commands print them, which are one conversation; or a
    /// letter log, of which every conversation is taken that this protocol opens. `id` chooses one,
    /// whatever it is by.
    pub(super) fn read(
        input: &[u8],
        protocol: &Arc<Protocol>,
        library: &Library,
        id: Option<&str>,
    ) -> Result<Recorded, String> {
        let mut recorded = Recorded::default();
        let mut lines = Vec::new();
        for value in JsonValues::new(input) {
            let (position, value) = value.map_err(|failure| failure.to_string())?;
            let line = recorded.line(&value);
            let line = line.map_err(|error| format!("{position}: {error}"))?;
            lines.extend(line.filter(|line| id.is_none() || id_of(&line.message) == id));
        }
        if !recorded.is_log {
            let message = |line: Line| Said {
                now: Now::default(),
                message: line.message,
            };
            recorded.conversations = vec![lines.into_iter().map(message).collect()];
            return Ok(recorded);
        }
        // They stand there in the order in which their outcomes were known.
        lines.sort_by(|a, b| (&a.time, a.number).cmp(&(&b.time, b.number)));
        recorded.conversations = by_conversation(lines);
        let is_opened = |said: &Said| {
            let bears = said.message.protocol.as_ref();
            let found = bears.and_then(|name| library.get(name));
            found.is_some_and(|found| Arc::ptr_eq(found, protocol))
        };
        recorded
            .conversations
            .retain(|conversation| id.is_some() || conversation.first().is_some_and(is_opened));
        Ok(recorded)
    }

    /// The message of a line; a log has lines of other things, and letters that nobody can read.
    fn line(&mut self, value: &Value) -> Result<Option<Line>, String> {
        let event = value.get("event").and_then(Value::as_str);
        let message = value.get("message");
        if let Some(event) = event {
            self.is_log = true;
            if event == "lost" {
                self.lost += value.get("count").and_then(Value::as_u64).unwrap_or(0);
            }
            if event != "letter" || message.is_none() {
                return Ok(None);
            }
        }
        let time = value.get("time").and_then(Value::as_str);
        let message = message_from_json(message.unwrap_or(value));
        Ok(Some(Line {
            time: time.unwrap_or_default().to_owned(),
            number: value.get("number").and_then(Value::as_u64).unwrap_or(0),
            message: message.map_err(|error| error.to_string())?,
        }))
    }
}

/// The conversations, in the order in which they begin, without messages that belong to none.
fn by_conversation(lines: Vec<Line>) -> Vec<Vec<Said>> {
    let mut conversations: Vec<Vec<Said>> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    for line in lines {
        let Some(id) = id_of(&line.message) else {
            continue;
        };
        let next = conversations.len();
        let at = *places.entry(id.to_owned()).or_insert(next);
        if at == next {
            conversations.push(Vec::new());
        }
        conversations[at].push(Said {
            now: sniffed::now(&line.time),
            message: line.message,
        });
    }
    conversations
}

/// The conversation of a message; an id that is more than a text has no name here.
pub(super) fn id_of(message: &Message) -> Option<&str> {
    message
        .conversation_id
        .as_ref()
        .and_then(Expression::as_str)
}
