//! Recorded messages of the distributed locks of C++ robots follow the protocols.

use std::path::Path;
use std::sync::Arc;

use fipa_acl::Message;
use fipa_conversation::{Config, Monitor, Verdict};
use fipa_directory::Now;
use fipa_protocol::Library;

/// `file, scene, act, a -> b,c, protocol=…, conv=…, lang=…, content=…`, separated by tabs.
fn message(line: &str) -> (&str, Message) {
    let fields: Vec<&str> = line.split('\t').collect();
    let [_, scene, act, way, protocol, id, ..] = fields[..] else {
        panic!("{line}");
    };
    let (from, to) = way.split_once(" -> ").unwrap();
    let message = Message::new(act)
        .from_agent(from)
        .protocol(protocol.strip_prefix("protocol=").unwrap())
        .conversation_id(id.strip_prefix("conv=").unwrap());
    let message = to.split(',').fold(message, |message, to| message.to(to));
    (scene, message)
}

#[test]
fn every_recorded_message_is_accepted() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/vectors/dlm/messages.tsv");
    let text = std::fs::read_to_string(file).unwrap();
    let library = Arc::new(Library::builtin());
    for own in [None, Some("agent1"), Some("agent2"), Some("agent3")] {
        let mut monitor = Monitor::new(Arc::clone(&library), None, Config::default());
        let (mut last, mut seen, mut ended) = (String::new(), 0, 0);
        // What agents say of their own state is indented.
        for line in text.lines().filter(|line| line.starts_with("dlm_")) {
            let (scene, message) = message(line);
            let algorithm = scene.split('/').next().unwrap();
            if algorithm != last {
                // Each algorithm is recorded with agents that were started anew.
                monitor =
                    Monitor::new(Arc::clone(&library), own.map(Into::into), Config::default());
                last = algorithm.to_owned();
            }
            let names = message.sender.iter().chain(&message.receiver);
            let concerns = own.is_none_or(|own| names.clone().any(|agent| agent.name == *own));
            if !concerns {
                continue;
            }
            let verdict = monitor.observe(Now::default(), &message);
            assert!(
                matches!(verdict, Verdict::Accepted { .. }),
                "{own:?}: {line}: {verdict:?}"
            );
            seen += 1;
            let conversation = monitor.conversation(message.conversation_id.as_ref().unwrap());
            ended += usize::from(conversation.is_some_and(|c| c.is_complete()));
        }
        assert!(seen > 30 && ended > 10, "{own:?}: {seen}, {ended}");
    }
}

#[test]
fn an_owner_may_answer_a_confirmation_with_a_number() {
    let library = Arc::new(Library::builtin());
    let mut monitor = Monitor::new(library, None, Config::default());
    for (act, from, to) in [
        ("request", "arm", "locks"),
        ("agree", "locks", "arm"),
        ("confirm", "arm", "locks"),
        ("confirm", "arm", "locks"),
        ("inform", "locks", "arm"),
        ("disconfirm", "arm", "locks"),
    ] {
        let message = Message::new(act).from_agent(from).to(to);
        let message = message
            .protocol("ricart_agrawala_extended")
            .conversation_id("arm_1");
        let verdict = monitor.observe(Now::default(), &message);
        let accepted = matches!(verdict, Verdict::Accepted { .. });
        assert!(accepted, "{act}: {verdict:?}");
    }
    let conversation = monitor.conversation(&"arm_1".into());
    assert!(conversation.is_some_and(|c| c.is_complete()));
}
