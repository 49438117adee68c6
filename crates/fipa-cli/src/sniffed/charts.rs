//! A chart for each conversation.

use std::collections::HashMap;
use std::sync::Arc;

use fipa::Pattern;
use fipa_conversation::{Config, Monitor, Verdict};
use fipa_protocol::Library;

use super::{Entry, Inside, Letter, What, now, unix_millis};
use crate::chart::{Annotation, Arrow, Chart, Step, shortened};

/// Letters of content and of a title that are shown.
const CONTENT: usize = 32;
const TITLE: usize = 80;

/// Charts of what passed, in the order in which they begin: one a conversation, one for the letters
/// without conversation, and one a protocol of devices. What was lost is noted in each that has
/// begun.
///
/// Each message of a conversation is judged by its protocol, if that is known; `agent` chooses what is
/// drawn, not what is judged.
pub(crate) fn charts(mut entries: Vec<Entry>, agent: Option<&Pattern>) -> Vec<Chart> {
    entries.sort_by(|a, b| a.order().cmp(&b.order()));
    let library = Arc::new(Library::builtin());
    let mut monitor = Monitor::new(library, None, Config::default());
    let mut charts: Vec<Begun> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    for entry in &entries {
        let (key, title) = match &entry.what {
            What::Lost(count) => {
                charts.iter_mut().for_each(|begun| begun.lose(*count));
                continue;
            }
            What::Letter(letter) => titles(letter),
            What::Inside(inside) => {
                let key = format!("devices, {}", inside.protocol);
                (key.clone(), key)
            }
        };
        let at = *places.entry(key).or_insert_with(|| {
            charts.push(Begun::new(&title));
            charts.len() - 1
        });
        charts[at].add(&mut monitor, entry, agent);
    }
    let drawn = charts.into_iter().map(|begun| begun.chart);
    drawn.filter(|chart| !chart.steps.is_empty()).collect()
}

/// By what the letters of a chart are known, and what stands above it.
fn titles(letter: &Letter) -> (String, String) {
    let key = match &letter.conversation {
        Some(conversation) => format!("conversation {conversation}"),
        None => "letters without a conversation".to_owned(),
    };
    let title = match (&letter.conversation, &letter.protocol) {
        (Some(_), Some(protocol)) => format!("{key}, {protocol}"),
        _ => key.clone(),
    };
    (key, title)
}

struct Begun {
    start: Option<i64>,
    chart: Chart,
    watch: Watch,
}

/// What is known of a conversation that others hold.
enum Watch {
    /// No message has begun it.
    Before {
        /// That one did not is marked once.
        told: bool,
    },
    Judged,
    /// Some of it was not seen.
    Lost,
}

impl Begun {
    fn new(title: &str) -> Begun {
        let title = shortened(title, TITLE);
        Begun {
            start: None,
            chart: Chart {
                title,
                steps: Vec::new(),
            },
            watch: Watch::Before { told: false },
        }
    }

    fn add(&mut self, monitor: &mut Monitor, entry: &Entry, agent: Option<&Pattern>) {
        let annotation = match &entry.what {
            What::Letter(letter) => self.watch.judge(monitor, entry, letter),
            What::Inside(_) | What::Lost(_) => None,
        };
        if agent.is_some_and(|agent| !entry.concerns(agent)) {
            return;
        }
        let at = unix_millis(&entry.time);
        self.start = self.start.or(at);
        let since = match (at, self.start) {
            (Some(at), Some(start)) => format!("{:.3}", (at - start) as f64 / 1000.0),
            _ => String::new(),
        };
        let steps = &mut self.chart.steps;
        match &entry.what {
            What::Letter(letter) => {
                steps.extend(arrows(letter, &since).map(Step::Arrow));
                if let Some(Step::Arrow(last)) = steps.last_mut() {
                    last.annotation = annotation;
                }
            }
            What::Inside(inside) => steps.push(Step::Arrow(device_arrow(inside, since))),
            What::Lost(_) => {}
        }
    }

    /// So much was not seen.
    fn lose(&mut self, count: u64) {
        let mut note = format!("{count} not shown: they came too fast");
        if matches!(self.watch, Watch::Judged) {
            note.push_str("; what follows is not judged");
        }
        self.watch = Watch::Lost;
        if !self.chart.steps.is_empty() {
            self.chart.steps.push(Step::Note(note));
        }
    }
}

impl Watch {
    /// What the protocol of the conversation says of a letter.
    fn judge(
        &mut self,
        monitor: &mut Monitor,
        entry: &Entry,
        letter: &Letter,
    ) -> Option<Annotation> {
        let message = letter.message.as_deref()?;
        if matches!(self, Watch::Lost) {
            return None;
        }
        let now = now(&entry.time);
        monitor.handle_timeout(now);
        let verdict = monitor.observe(now, message);
        while monitor.poll_event().is_some() {}
        if let Watch::Before { told } = self {
            match &verdict {
                Verdict::Accepted { .. } => *self = Watch::Judged,
                Verdict::Violation(_) if *told => return None,
                Verdict::Violation(_) => *told = true,
                Verdict::NotMonitored => {}
            }
        }
        match verdict {
            Verdict::Accepted { state } => Some(Annotation {
                text: state.to_string(),
                violation: false,
            }),
            Verdict::Violation(violation) => Some(Annotation {
                text: format!("violation [{}]: {violation}", violation.rule),
                violation: true,
            }),
            Verdict::NotMonitored => None,
        }
    }
}

/// An arrow to each receiver; one at least.
fn arrows(letter: &Letter, at: &str) -> impl Iterator<Item = Arrow> {
    let label = label(&letter.performative, &letter.content);
    let arrow = move |to: &str, failure: Option<String>| Arrow {
        at: at.to_owned(),
        from: letter.from.clone(),
        to: to.to_owned(),
        label: label.clone(),
        failure,
        annotation: None,
    };
    let nobody = letter.receivers.is_empty().then(|| arrow("?", None));
    let arrows = letter.receivers.iter().map(move |to| {
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
    nobody.into_iter().chain(arrows)
}

/// A packet stands between the ends of its link: its addresses may be of stations behind them, and in
/// a subnetwork of each link they are numbers that others have as well.
fn device_arrow(inside: &Inside, at: String) -> Arrow {
    let (from, to) = (inside.from.clone(), inside.to.clone());
    let (kind, from, to) = match inside.protocol.as_str() {
        "hiac" => {
            let ends = ("daemon".to_owned(), inside.place.clone());
            let (from_end, to_end) = match inside.direction.as_str() {
                "out" => ends,
                _ => (ends.1, ends.0),
            };
            let kind = match inside.is_addressed {
                true => format!("{} {from}>{to}", inside.kind),
                false => inside.kind.clone(),
            };
            (kind, from_end, to_end)
        }
        _ => (inside.kind.clone(), from, to),
    };
    Arrow {
        at,
        from,
        to,
        label: label(&kind, &inside.text),
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
    use serde_json::{Value, json};

    use super::*;

    fn line(number: u64, millis: u64, outcome: Value, message: Value) -> Entry {
        let line = json!({
            "time": format!("2026-11-22T10:00:00.{millis:03}Z"), "event": "letter",
            "number": number, "octets": 9, "envelope": {}, "message": message,
            "outcomes": [outcome],
        });
        Entry::read(&line).unwrap().with_message(&line)
    }

    fn entry(number: u64, millis: u64, conversation: &str, content: &str) -> Entry {
        let outcome = json!({"to": "b", "outcome": "refused", "via": null, "reason": "full"});
        let message = json!({
            "performative": "inform", "sender": {"name": "a"}, "content": content,
            "conversation-id": conversation,
        });
        line(number, millis, outcome, message)
    }

    fn lost(millis: u64) -> Entry {
        let time = format!("2026-11-22T10:00:00.{millis:03}Z");
        Entry::read(&json!({"time": time, "event": "lost", "count": 2})).unwrap()
    }

    /// `a>b act` a millisecond, by the request protocol.
    fn said(from: u64, said: &str) -> Vec<Entry> {
        let entry = |(at, said): (u64, &str)| {
            let (way, act) = said.split_once(' ').unwrap();
            let (from, to) = way.split_once('>').unwrap();
            let message = json!({
                "performative": act, "sender": {"name": from}, "receiver": [{"name": to}],
                "conversation-id": "c", "protocol": "fipa-request", "content": "x",
            });
            line(at, at, json!({"to": to, "outcome": "delivered"}), message)
        };
        (from..).zip(said.split(", ")).map(entry).collect()
    }

    /// What stands at each arrow, and the notes.
    fn remarks(charts: &[Chart]) -> Vec<&str> {
        let steps = charts.iter().flat_map(|chart| &chart.steps);
        steps.map(remark).collect()
    }

    fn remark(step: &Step) -> &str {
        match step {
            Step::Note(note) => note,
            Step::Arrow(arrow) => arrow.annotation.as_ref().map_or("", |a| &a.text),
        }
    }

    #[test]
    fn each_conversation_has_a_chart_in_the_order_of_its_letters() {
        let entries = vec![
            entry(3, 7, "one", "(done)"),
            entry(2, 5, "one", "second"),
            entry(1, 5, "one", "first"),
            entry(4, 9, "two", ""),
            lost(8),
        ];
        let charts = charts(entries, None);
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

    #[test]
    fn the_state_stands_at_each_message_and_a_violation_is_marked() {
        let charts = charts(
            said(0, "a>b request, b>a propose, b>a agree, b>a inform"),
            None,
        );
        assert_eq!(
            remarks(&charts),
            [
                "requested",
                "violation [performative]: b may not send propose in the state requested of \
                 fipa-request; expected: refuse, agree, inform or failure from participant (b) \
                 to initiator (a)",
                "agreed",
                "done",
            ]
        );
        let violations: Vec<bool> = charts[0].arrows().map(Arrow::is_bad).collect();
        assert_eq!(violations, [false, true, false, false]);
    }

    #[test]
    fn what_is_not_drawn_is_judged_all_the_same() {
        let entries = said(0, "a>b cfp, a>b request, b>x agree, b>a agree");
        let agent = Pattern::new("x").unwrap();
        let charts = charts(entries, Some(&agent));
        let [only] = &remarks(&charts)[..] else {
            panic!("{charts:?}");
        };
        assert!(only.starts_with("violation [receiver]: "), "{only}");
    }

    #[test]
    fn a_beginning_that_was_not_seen_is_told_once() {
        let charts = charts(said(0, "b>a agree, b>a inform, a>b request"), None);
        let opening = "violation [opening]: agree begins no conversation of fipa-request; \
                       expected: request from initiator to participant";
        assert_eq!(remarks(&charts), [opening, "", "requested"]);
    }

    #[test]
    fn an_id_may_be_used_again_once_its_conversation_is_forgotten() {
        let mut entries = said(0, "a>b request, b>a inform, a>b request");
        for (entry, time) in entries.iter_mut().zip(["00", "01", "59"]) {
            entry.time = format!("2026-11-22T10:00:{time}.000Z");
        }
        let mut later = said(3, "a>b request");
        later[0].time = "2026-11-22T10:05:00.000Z".to_owned();
        entries.append(&mut later);
        let charts = charts(entries, None);
        let ended = "violation [ended]: request of a came after the end in the state done of \
                     fipa-request; expected: nothing more";
        assert_eq!(remarks(&charts), ["requested", "done", ended, "requested"]);
    }

    #[test]
    fn nothing_is_judged_after_a_loss() {
        let mut entries = said(0, "a>b request");
        entries.push(lost(1));
        entries.extend(said(2, "b>a inform, b>a agree"));
        let note = "2 not shown: they came too fast; what follows is not judged";
        assert_eq!(remarks(&charts(entries, None)), ["requested", note, "", ""]);
    }
}
