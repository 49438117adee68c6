//! What holds for any messages in any order.

use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{FipaTime, Message, Performative, Text};
use fipa_conversation::{
    Config, Conversation, Expected, Monitor, Participant, Rule, Verdict, Violation,
};
use fipa_directory::Now;
use fipa_protocol::{Library, Limits, load};
use proptest::prelude::*;

const AGENTS: [&str; 5] = ["a", "b", "c", "b.*", "broker"];

/// The protocols of FIPA, and one with the rules of fipa_acl.
fn library() -> Arc<Library> {
    let mut library = Library::builtin();
    let text = r#"<scxml initial="1" xmlns:f="urn:x-fipa:protocol:1" f:rules="fipa-acl">
      <state id="1"><transition performative="request" from="A" to="B" target="2"/></state>
      <state id="2"><transition performative="agree" from="B" to="A" target="2"/>
        <transition performative="inform" from="B" to=".*" target="3"/>
        <subprotocol name=".*" from="B" proxied_to="A"/></state>
      <state id="3" final="yes"/></scxml>"#;
    library.add(
        load("acl", text.as_bytes(), &Limits::default())
            .unwrap()
            .protocol
            .unwrap(),
    );
    Arc::new(library)
}

fn protocols(library: &Library) -> Vec<String> {
    library
        .protocols()
        .iter()
        .map(|protocol| protocol.name().to_string())
        .collect()
}

#[derive(Clone, Debug)]
struct Line {
    act: usize,
    from: usize,
    to: Vec<usize>,
    /// Another protocol than that of the conversation.
    protocol: Option<usize>,
    reply_by: bool,
    /// Seconds later.
    later: u64,
    gone: bool,
}

fn line() -> impl Strategy<Value = Line> {
    let to = proptest::collection::vec(0..AGENTS.len(), 1..3);
    let protocol = proptest::option::weighted(0.1, 0_usize..21);
    (
        0_usize..22,
        0..AGENTS.len(),
        to,
        protocol,
        any::<bool>(),
        0_u64..3,
        proptest::bool::weighted(0.03),
    )
        .prop_map(|(act, from, to, protocol, reply_by, later, gone)| Line {
            act,
            from,
            to,
            protocol,
            reply_by,
            later,
            gone,
        })
}

fn message(line: &Line, protocol: &str, names: &[String]) -> Message {
    let protocol = line.protocol.map_or(protocol, |other| &names[other]);
    let mut message = Message::new(Performative::STANDARD[line.act].clone())
        .from_agent(AGENTS[line.from])
        .protocol(protocol)
        .conversation_id("c");
    for to in &line.to {
        message = message.to(AGENTS[*to]);
    }
    if line.reply_by {
        message = message.reply_by("+PT2S".parse::<FipaTime>().unwrap());
    }
    message
}

/// A message that was said to be expected, between the initiator and the only participant.
fn legal(
    conversation: &Conversation,
    violation: &Violation,
    expected: &Expected,
    protocol: &str,
) -> Option<Message> {
    let [participant] = &conversation.participants()[..] else {
        return None;
    };
    let [agent] = &participant.agents[..] else {
        return None;
    };
    if participant.state != violation.state || !["a", "b", "c", "broker"].contains(&agent.as_str())
    {
        return None;
    }
    let player = |role: &Text| match role.as_str() {
        "initiator" => conversation.initiator().cloned(),
        "participant" | "broker" | "recruiter" | "agent" => Some(agent.clone()),
        _ => None,
    };
    let act = Some(expected.performative.as_str()).filter(|act| *act != ".*");
    let message = Message::new(act.unwrap_or("inform"));
    let message = message
        .from_agent(player(&expected.from)?)
        .to(player(&expected.to)?);
    Some(message.protocol(protocol).conversation_id("c"))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Judging tells what observing does, a violation changes nothing, and what is said to be
    /// expected is accepted.
    #[test]
    fn judgements_hold(protocol in 0_usize..21, lines in proptest::collection::vec(line(), 1..40)) {
        let library = library();
        let names = protocols(&library);
        let name = &names[protocol];
        let mut conversation = Conversation::new(Arc::clone(library.get(name).unwrap()), None);
        let mut now = Now::default();
        for line in lines {
            now = now.plus(Duration::from_secs(line.later));
            conversation.handle_timeout(now);
            if line.gone {
                conversation.agent_gone(AGENTS[line.from]);
            }
            let message = message(&line, name, &names);
            let before = format!("{conversation:?}");
            let judged = conversation.judge(&library, now, &message);
            prop_assert_eq!(&before, &format!("{conversation:?}"));
            let verdict = conversation.observe(&library, now, &message);
            prop_assert_eq!(&judged, &verdict);
            match verdict {
                Verdict::Accepted { state } => {
                    let of = |p: &Participant| p.state == state || p.state == "cancelling";
                    let participants = conversation.participants();
                    // Those whom an expression means beside the ones that answered are not listed.
                    let is_wide = message.receiver.iter().any(|r| r.name == "b.*");
                    prop_assert!(
                        state.contains('/') || is_wide || participants.iter().any(of),
                        "{state}: {participants:?}"
                    );
                }
                Verdict::Violation(violation) => {
                    prop_assert_eq!(&before, &format!("{conversation:?}"));
                    for expected in violation.expected.iter().filter(|_| violation.rule == Rule::Performative) {
                        if let Some(legal) = legal(&conversation, &violation, expected, name) {
                            let verdict = conversation.judge(&library, now, &legal);
                            prop_assert!(matches!(verdict, Verdict::Accepted { .. }), "{legal:?}: {verdict:?}");
                        }
                    }
                }
                Verdict::NotMonitored => {}
            }
            prop_assert!(!conversation.is_closed() || conversation.is_complete());
        }
    }

    /// A monitor that is asked when it wants to be called comes to rest, and forgets everything.
    #[test]
    fn monitors_come_to_rest(lines in proptest::collection::vec((0_usize..21, line()), 1..40)) {
        let library = library();
        let names = protocols(&library);
        let mut monitor = Monitor::new(Arc::clone(&library), Some("a".into()), Config::default());
        let mut now = Now::default();
        for (protocol, line) in &lines {
            now = now.plus(Duration::from_secs(line.later));
            let message = message(line, &names[*protocol], &names).conversation_id(format!("c-{protocol}"));
            let judged = monitor.judge_outgoing(now, &message);
            prop_assert_eq!(judged, monitor.observe(now, &message));
            if line.gone {
                monitor.agent_gone(now, AGENTS[line.from]);
            }
        }
        let mut rounds = 0;
        while let Some(due) = monitor.poll_timeout() {
            now = Now { mono: due.max(now.mono), ..now };
            monitor.handle_timeout(now);
            rounds += 1;
            prop_assert!(rounds < 1000);
        }
        prop_assert!(monitor.is_empty());
    }
}
