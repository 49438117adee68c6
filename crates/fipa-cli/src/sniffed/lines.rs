//! A line for each receiver of a letter.

use super::{Entry, What};
use crate::chart::shortened;

/// Letters of content that are shown.
const CONTENT: usize = 40;

/// What an entry looks like in lines.
pub(crate) fn lines(entry: &Entry) -> Vec<String> {
    let time = &entry.time;
    match &entry.what {
        What::Lost(count) => vec![format!("{time}  {count} not shown: they came too fast")],
        What::Inside(inside) => {
            let said = shortened(&inside.text, CONTENT);
            vec![format!(
                "{time}  {} -> {}  {} {}  {} {}  {said}",
                inside.from,
                inside.to,
                inside.protocol,
                inside.kind,
                inside.direction,
                inside.place,
            )]
        }
        What::Letter(letter) => {
            let or_dash =
                |text: &Option<String>| shortened(text.as_deref().unwrap_or("-"), CONTENT);
            let (protocol, conversation) =
                (or_dash(&letter.protocol), or_dash(&letter.conversation));
            let octets = match letter.octets {
                Some(octets) => format!("{octets} B"),
                None => "-".to_owned(),
            };
            let line = |to: &str, outcome: &str| {
                format!(
                    "{time}  {} -> {to}  {}  {protocol}  {conversation}  {octets}  {outcome}",
                    letter.from, letter.performative
                )
            };
            if letter.receivers.is_empty() {
                return vec![line("?", "-")];
            }
            let lines = letter.receivers.iter().map(|to| match &to.outcome {
                None => line(&to.name, "-"),
                Some((word, reason)) if reason.is_empty() => line(&to.name, word),
                Some((word, reason)) => line(&to.name, &format!("{word} ({reason})")),
            });
            lines.collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn shown(line: &Value) -> Vec<String> {
        lines(&Entry::read(line).unwrap())
    }

    #[test]
    fn a_letter_has_a_line_a_receiver() {
        let line = json!({
            "time": "2026-11-22T10:00:00.123Z", "event": "letter", "number": 1, "octets": 99,
            "envelope": {"to": [{"name": ".*"}], "from": {"name": "a"}},
            "message": {
                "performative": "cfp", "sender": {"name": "a"}, "protocol": "p",
                "conversation-id": "c", "content": "x",
            },
            "outcomes": [
                {"to": "b", "outcome": "delivered", "via": "local", "reason": null},
                {"to": "c", "outcome": "timeout", "via": null, "reason": "late"},
            ],
        });
        assert_eq!(
            shown(&line),
            [
                "2026-11-22T10:00:00.123Z  a -> b  cfp  p  c  99 B  delivered",
                "2026-11-22T10:00:00.123Z  a -> c  cfp  p  c  99 B  timeout (late)",
            ]
        );
    }

    #[test]
    fn what_is_not_known_is_a_dash() {
        let line = json!({
            "time": "t", "event": "letter", "octets": 9,
            "envelope": {"to": [{"name": "b"}]}, "payload": {"base64": ""}, "outcomes": [],
        });
        assert_eq!(shown(&line), ["t  ? -> b  ?  -  -  9 B  -"]);
        let error = json!({"time": "t", "event": "letter", "error": "bad", "outcomes": []});
        assert_eq!(shown(&error), ["t  ? -> ?  ?  -  -  -  -"]);
    }

    #[test]
    fn devices_are_shown_with_their_place() {
        let text = json!({
            "time": "t", "event": "text", "direction": "out", "place": "udp://127.0.0.1:5000",
            "text": {"origin": "m", "destination": "drive", "question": "where"},
        });
        assert_eq!(
            shown(&text),
            ["t  m -> drive  text question  out udp://127.0.0.1:5000  where"]
        );
        let packet = json!({
            "time": "t", "event": "hiac", "direction": "in", "place": "tcp://127.0.0.1:7",
            "hiac": {"type": "MSG", "source": "20:C4:D2:00", "data": "0301"},
        });
        assert_eq!(
            shown(&packet),
            ["t  20:C4:D2:00 -> daemon  hiac MSG  in tcp://127.0.0.1:7  0301"]
        );
        let lost = json!({"time": "t", "event": "lost", "count": 3});
        assert_eq!(shown(&lost), ["t  3 not shown: they came too fast"]);
    }

    #[test]
    fn other_lines_are_none() {
        for line in [json!({}), json!({"event": "text"}), json!(1)] {
            assert!(Entry::read(&line).is_err(), "{line}");
        }
    }
}
