//! Conversations written down: what is said, and what the monitor makes of it.
//!
//! In `sequences/*.txt`, a line at the margin is done, and the indented line behind it is what must
//! come of it:
//!
//! ```text
//! == a title                     a new monitor and conversation
//! protocol NAME                  which the messages bear
//! self AGENT                     whose monitor it is; else everybody's messages are seen
//! A -> B, C: ACT key=value       a message; keys: id, protocol, language, ontology, with, re, by, reply-to
//! at SECONDS                     the time
//! gone AGENT, announce NUMBER    what the directory, and the agent, say
//! ```
//!
//! The indented line is the state, with the outcome if the conversation may end there and `.` if
//! nothing can follow, or `! rule: text`.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{Expression, FipaTime, Message, Performative, Text};
use fipa_conversation::{Config, Monitor, Verdict};
use fipa_directory::Now;
use fipa_protocol::{Library, Limits, load};

const ID: &str = "c-1";

/// The protocols of FIPA, and those of `dialect/` under their own names.
fn library() -> Arc<Library> {
    let mut library = Library::builtin();
    for (path, text) in files("dialect") {
        let loaded = load(&path, text.as_bytes(), &Limits::default()).unwrap();
        library.add(
            loaded
                .protocol
                .unwrap_or_else(|| panic!("{path}: {:?}", loaded.diagnostics)),
        );
    }
    Arc::new(library)
}

fn files(folder: &str) -> BTreeMap<String, String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests")
        .join(folder);
    let read = |entry: std::io::Result<std::fs::DirEntry>| {
        let path = entry.unwrap().path();
        (
            path.display().to_string(),
            std::fs::read_to_string(&path).unwrap(),
        )
    };
    std::fs::read_dir(folder).unwrap().map(read).collect()
}

struct Scene {
    library: Arc<Library>,
    protocol: Text,
    monitor: Monitor,
    now: Now,
}

impl Scene {
    fn new(library: &Arc<Library>) -> Scene {
        Scene {
            library: Arc::clone(library),
            protocol: Text::default(),
            monitor: Monitor::new(Arc::clone(library), None, Config::default()),
            now: Now {
                mono: Duration::ZERO,
                unix_millis: 1_795_341_600_000,
            },
        }
    }

    /// Does what a line says, and tells what came of it.
    fn line(&mut self, line: &str) -> Option<String> {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        match word {
            "==" => *self = Scene::new(&self.library),
            "protocol" => self.protocol = rest.into(),
            "self" => {
                self.monitor = Monitor::new(
                    Arc::clone(&self.library),
                    Some(rest.into()),
                    Config::default(),
                )
            }
            "announce" => {
                let known = self
                    .monitor
                    .announce_sub_conversations(&Expression::from(ID), rest.parse().unwrap());
                assert!(known, "{line}");
            }
            "gone" => {
                self.monitor.agent_gone(self.now, rest);
                return Some(self.state(None));
            }
            "at" => {
                let seconds: u64 = rest.parse().unwrap();
                let passed = Duration::from_secs(seconds) - self.now.mono;
                self.now = self.now.plus(passed);
                self.monitor.handle_timeout(self.now);
                return Some(self.state(None));
            }
            _ if line.contains(" -> ") => {
                let message = self.message(line);
                let judged = self.monitor.judge_outgoing(self.now, &message);
                let verdict = self.monitor.observe(self.now, &message);
                assert_eq!(judged, verdict, "{line}");
                return Some(match verdict {
                    Verdict::Accepted { state } => self.state(Some(state)),
                    Verdict::Violation(violation) => {
                        format!("! {}: {}", violation.rule, violation.text)
                    }
                    Verdict::NotMonitored => "not monitored".to_owned(),
                });
            }
            _ => panic!("{line}"),
        }
        None
    }

    fn message(&self, line: &str) -> Message {
        let (sender, rest) = line.split_once(" -> ").unwrap();
        let (receivers, rest) = rest.split_once(": ").unwrap();
        let mut words = rest.split(' ');
        let mut message =
            Message::new(Performative::from(words.next().unwrap())).conversation_id(ID);
        if !self.protocol.is_empty() {
            message = message.protocol(self.protocol.clone());
        }
        if sender != "-" {
            message = message.from_agent(sender);
        }
        for receiver in receivers.split(", ").filter(|receiver| *receiver != "-") {
            message = message.to(receiver);
        }
        for word in words {
            let (key, value) = word.split_once('=').unwrap();
            message = match key {
                "id" => message.conversation_id(value),
                "protocol" => Message {
                    protocol: Some(value).filter(|v| !v.is_empty()).map(Text::from),
                    ..message
                },
                "language" => message.language(value),
                "ontology" => message.ontology(value),
                "with" => message.reply_with(value),
                "re" => message.in_reply_to(value),
                "by" => message.reply_by(FipaTime::parse(value).unwrap()),
                "reply-to" => message.reply_to(value),
                _ => panic!("{line}"),
            };
        }
        message
    }

    /// The state given, else those of all participants.
    fn state(&self, state: Option<Text>) -> String {
        let Some(conversation) = self.monitor.conversation(&Expression::from(ID)) else {
            return "forgotten".to_owned();
        };
        let participants = conversation.participants();
        let mut shown = match state {
            Some(state) => state.to_string(),
            None => {
                let states: Vec<String> = participants
                    .iter()
                    .map(|p| format!("{}: {}", p.agents.join(", "), p.state))
                    .collect();
                states.join("; ")
            }
        };
        assert_eq!(conversation.is_complete(), conversation.outcome().is_some());
        if let Some(outcome) = conversation.outcome() {
            write!(shown, " ({outcome})").unwrap();
        }
        if conversation.is_closed() {
            shown.push('.');
        }
        shown
    }
}

#[test]
fn every_conversation_goes_as_it_is_written() {
    let library = library();
    let mut used: Vec<Text> = Vec::new();
    let mut violated: Vec<Text> = Vec::new();
    for (path, text) in files("sequences") {
        let mut scene = Scene::new(&library);
        let mut played = String::new();
        for line in text.lines() {
            if line.starts_with("    ") {
                continue;
            }
            writeln!(played, "{line}").unwrap();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            if let Some(result) = scene.line(line) {
                if result.starts_with("! ")
                    && let Some(protocol) = library.get(&scene.protocol)
                {
                    violated.push(protocol.name().clone());
                }
                writeln!(played, "    {result}").unwrap();
            }
            if let Some(protocol) = line.strip_prefix("protocol ") {
                used.push(library.get(protocol).unwrap().name().clone());
            }
        }
        assert!(played == text, "{path} goes like this:\n{played}");
    }
    for protocol in library.protocols() {
        let name = protocol.name();
        assert!(used.contains(name), "{name} is not played");
    }
    for protocol in Library::builtin().protocols() {
        let name = protocol.name();
        assert!(violated.contains(name), "{name} is not violated");
    }
}
