//! A chart for each conversation.

use fipa::FipaTime;

use super::{Entry, Inside, Letter, What};
use crate::chart::{Arrow, Chart, Step, shortened};

/// Letters of content and of a title that are shown.
const CONTENT: usize = 32;
const TITLE: usize = 80;

/// Charts of what passed, in the order in which they begin: one a conversation, one for the letters
/// without conversation, and one a protocol of devices. What was lost is noted in each that has
/// begun.
pub(crate) fn charts(mut entries: Vec<Entry>) -> Vec<Chart> {
    entries.sort_by(|a, b| a.order().cmp(&b.order()));
    let mut charts: Vec<Begun> = Vec::new();
    for entry in &entries {
        let at = unix_millis(&entry.time);
        match &entry.what {
            What::Lost(count) => charts.iter_mut().for_each(|begun| {
                let note = format!("{count} not shown: they came too fast");
                begun.chart.steps.push(Step::Note(note));
            }),
            What::Letter(letter) => {
                let key = match &letter.conversation {
                    Some(conversation) => format!("conversation {conversation}"),
                    None => "letters without a conversation".to_owned(),
                };
                let title = match (&letter.conversation, &letter.protocol) {
                    (Some(_), Some(protocol)) => format!("{key}, {protocol}"),
                    _ => key.clone(),
                };
                let begun = begin(&mut charts, key, &title, at);
                let since = begun.since(at);
                begun.chart.steps.extend(arrows(letter, &since));
            }
            What::Inside(inside) => {
                let key = format!("devices, {}", inside.protocol);
                let begun = begin(&mut charts, key.clone(), &key, at);
                let step = Step::Arrow(device_arrow(inside, begun.since(at)));
                begun.chart.steps.push(step);
            }
        }
    }
    charts.into_iter().map(|begun| begun.chart).collect()
}

struct Begun {
    key: String,
    start: Option<i64>,
    chart: Chart,
}

impl Begun {
    /// Seconds since the chart began.
    fn since(&self, at: Option<i64>) -> String {
        match (at, self.start) {
            (Some(at), Some(start)) => format!("{:.3}", (at - start) as f64 / 1000.0),
            _ => String::new(),
        }
    }
}

fn begin<'a>(
    charts: &'a mut Vec<Begun>,
    key: String,
    title: &str,
    start: Option<i64>,
) -> &'a mut Begun {
    let at = charts.iter().position(|begun| begun.key == key);
    let at = at.unwrap_or_else(|| {
        let chart = Chart {
            title: shortened(title, TITLE),
            steps: Vec::new(),
        };
        charts.push(Begun { key, start, chart });
        charts.len() - 1
    });
    &mut charts[at]
}

/// Since 1970-01-01T00:00:00Z.
fn unix_millis(time: &str) -> Option<i64> {
    match time.parse() {
        Ok(FipaTime::Absolute { unix_millis, .. }) => Some(unix_millis),
        _ => None,
    }
}

fn arrows(letter: &Letter, at: &str) -> Vec<Step> {
    let label = label(&letter.performative, &letter.content);
    let arrow = |to: &str, failure: Option<String>| {
        Step::Arrow(Arrow {
            at: at.to_owned(),
            from: letter.from.clone(),
            to: to.to_owned(),
            label: label.clone(),
            failure,
            annotation: None,
        })
    };
    if letter.receivers.is_empty() {
        return vec![arrow("?", None)];
    }
    let steps = letter.receivers.iter().map(|to| {
        let failure =
            to.outcome
                .as_ref()
                .and_then(|(word, reason)| match (word.as_str(), reason.as_str()) {
                    ("delivered" | "sent", _) => None,
                    (word, "") => Some(word.to_owned()),
                    (word, reason) => Some(format!("{word}: {reason}")),
                });
        arrow(&to.name, failure)
    });
    steps.collect()
}

fn device_arrow(inside: &Inside, at: String) -> Arrow {
    Arrow {
        at,
        from: inside.from.clone(),
        to: inside.to.clone(),
        label: label(&inside.kind, &inside.text),
        failure: None,
        annotation: None,
    }
}

fn label(act: &str, content: &str) -> String {
    match shortened(content, CONTENT).as_str() {
        "" => act.to_owned(),
        content if content.starts_with('(') => format!("{act} {content}"),
        content => format!("{act} ({content})"),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn entry(number: u64, millis: u64, conversation: &str, content: &str) -> Entry {
        let line = json!({
            "time": format!("2026-11-22T10:00:00.{millis:03}Z"), "event": "letter",
            "number": number, "octets": 9, "envelope": {},
            "message": {
                "performative": "inform", "sender": {"name": "a"}, "content": content,
                "conversation-id": conversation,
            },
            "outcomes": [{"to": "b", "outcome": "refused", "via": null, "reason": "full"}],
        });
        Entry::read(&line).unwrap()
    }

    #[test]
    fn each_conversation_has_a_chart_in_the_order_of_its_letters() {
        let lost = json!({"time": "2026-11-22T10:00:00.008Z", "event": "lost", "count": 2});
        let charts = charts(vec![
            entry(3, 7, "one", "(done)"),
            entry(2, 5, "one", "second"),
            entry(1, 5, "one", "first"),
            entry(4, 9, "two", ""),
            Entry::read(&lost).unwrap(),
        ]);
        let titles: Vec<&str> = charts.iter().map(|chart| chart.title.as_str()).collect();
        assert_eq!(titles, ["conversation one", "conversation two"]);
        let arrow = |at: &str, label: &str| {
            Step::Arrow(Arrow {
                at: at.into(),
                from: "a".into(),
                to: "b".into(),
                label: label.into(),
                failure: Some("refused: full".into()),
                annotation: None,
            })
        };
        assert_eq!(
            charts[0].steps,
            [
                arrow("0.000", "inform (first)"),
                arrow("0.000", "inform (second)"),
                arrow("0.002", "inform (done)"),
                Step::Note("2 not shown: they came too fast".into()),
            ]
        );
        assert_eq!(charts[1].steps, [arrow("0.000", "inform")]);
    }
}
