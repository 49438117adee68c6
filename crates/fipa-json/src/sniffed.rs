use bytes::Bytes;
use fipa_acl::{FipaTime, Letter, Message};
use fipa_link::{Parts, Passed, ReceiverOutcome, Sniffed};
use serde_json::{Map, Value, json};

use crate::directory::outcome_to_json;
use crate::letter::{Body, letter_to_json};

/// What passed a daemon as the lines of its log; those who did not keep up have lost something,
/// which is a line of its own.
///
/// ```text
/// {"time":"…","event":"letter","number":7,"octets":123,"from":"robot2"|null,"via":"tcp"|null,
///  "envelope":{…},"message":{…},"outcomes":[{"to":"…","outcome":"…","via":"…","reason":"…"}]}
/// {"time":"…","event":"text","number":8,"direction":"in"|"out","place":"udp://…","text":{…}}
/// {"time":"…","event":"hiac","number":9,"direction":"in"|"out","place":"tcp://…","hiac":{…}}
/// {"time":"…","event":"lost","count":3}
/// ```
///
/// A letter is as it came, its time is when it was taken in; the outcomes are empty where the watch
/// ended before they were known. A payload that cannot be read stands as `payload` instead of
/// `message`; a letter whose envelope cannot be read has neither, and an `error`. The key of the
/// message of a device is its protocol, `text` or `hiac`, as is the event.
///
/// `open` reads the octets of a letter.
pub fn sniffed_to_json(
    sniffed: &Sniffed,
    open: impl FnOnce(&Parts) -> Result<(Letter, Result<Message, String>), String>,
) -> Vec<Value> {
    let time = FipaTime::from_unix_millis(sniffed.unix_millis).to_string();
    let mut lines = Vec::new();
    if sniffed.lost > 0 {
        lines.push(json!({"time": time, "event": "lost", "count": sniffed.lost}));
    }
    match &sniffed.passed {
        Passed::Begin | Passed::End => {}
        Passed::Letter {
            from,
            via,
            outcomes,
            parts,
        } => {
            let given = |text: &str| match text {
                "" => Value::Null,
                text => text.into(),
            };
            let mut line = Map::new();
            line.insert("time".into(), time.into());
            line.insert("event".into(), "letter".into());
            line.insert("number".into(), sniffed.number.into());
            line.insert("octets".into(), parts.octets().into());
            line.insert("from".into(), given(from));
            line.insert("via".into(), given(via));
            put_letter(&mut line, open(parts), outcomes);
            lines.push(line.into());
        }
        Passed::Inside(inside) => {
            let direction = if inside.incoming { "in" } else { "out" };
            // What is no JSON is shown as it is.
            let form: Result<Value, _> = serde_json::from_str(&inside.form);
            let form = form.unwrap_or_else(|_| inside.form.as_str().into());
            lines.push(json!({
                "time": time,
                "event": inside.protocol.as_str(),
                "number": sniffed.number,
                "direction": direction,
                "place": inside.place.as_str(),
                inside.protocol.as_str(): form,
            }));
        }
    }
    lines
}

fn put_letter(
    line: &mut Map<String, Value>,
    letter: Result<(Letter, Result<Message, String>), String>,
    outcomes: &[ReceiverOutcome],
) {
    let mut receivers = Vec::new();
    match letter {
        Ok((letter, message)) => {
            let body = match message {
                Ok(message) => Body::Message(Box::new(message)),
                Err(_) => Body::Payload(Bytes::clone(&letter.payload)),
            };
            let Value::Object(shown) = letter_to_json(&letter.envelope, &body) else {
                return;
            };
            line.extend(shown);
            receivers.extend(letter.envelope.intended_receiver().iter().cloned());
        }
        Err(error) => {
            line.insert("error".into(), error.into());
        }
    }
    // An outcome that holds for the whole letter names no receiver: it holds for each.
    let outcomes: Value = match outcomes {
        [only] if only.to.is_empty() && !receivers.is_empty() => receivers
            .into_iter()
            .map(|receiver| {
                outcome_to_json(&ReceiverOutcome {
                    to: receiver.name,
                    ..only.clone()
                })
            })
            .collect(),
        outcomes => outcomes.iter().map(outcome_to_json).collect(),
    };
    line.insert("outcomes".into(), outcomes);
}
