//! Many conversations at a time: their events, their ends, and what is remembered of them.

use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{Expression, Message, Performative};
use fipa_conversation::{
    Config, Conversation, Event, EventKind, Expected, Monitor, Rule, Verdict, Violation,
    not_understood_reply,
};
use fipa_directory::Now;
use fipa_protocol::{Library, Outcome, builtin};

fn monitor(config: Config) -> Monitor {
    Monitor::new(Arc::new(Library::builtin()), Some("arm".into()), config)
}

fn at(seconds: u64) -> Now {
    Now::default().plus(Duration::from_secs(seconds))
}

fn request(id: &str) -> Message {
    Message::new(Performative::Request)
        .from_agent("arm")
        .to("drive")
        .protocol("fipa-request")
        .conversation_id(id)
}

fn answer(id: &str, act: Performative) -> Message {
    request(id).reply(act).from_agent("drive")
}

fn accepted(verdict: Verdict) -> String {
    match verdict {
        Verdict::Accepted { state } => state.to_string(),
        other => panic!("{other:?}"),
    }
}

fn violation(verdict: Verdict) -> Violation {
    match verdict {
        Verdict::Violation(violation) => *violation,
        other => panic!("{other:?}"),
    }
}

fn kinds(monitor: &mut Monitor) -> Vec<EventKind> {
    std::iter::from_fn(|| monitor.poll_event())
        .map(|event| event.kind)
        .collect()
}

#[test]
fn observers_are_told_of_beginning_course_and_end() {
    let mut monitor = monitor(Config::default());
    monitor.observe(at(0), &request("c-1"));
    violation(monitor.observe(at(1), &answer("c-1", Performative::Propose)));
    monitor.observe(at(1), &answer("c-1", Performative::Agree));
    monitor.observe(at(2), &answer("c-1", Performative::Inform));
    let event = |kind| Event {
        conversation: "c-1".into(),
        kind,
    };
    let events: Vec<Event> = std::iter::from_fn(|| monitor.poll_event()).collect();
    assert_eq!(
        events,
        [
            event(EventKind::Started {
                protocol: "fipa-request".into(),
                initiator: "arm".into()
            }),
            event(EventKind::Updated {
                state: "agreed".into()
            }),
            event(EventKind::Updated {
                state: "done".into()
            }),
            event(EventKind::Ended {
                outcome: Outcome::Done
            }),
        ]
    );
}

#[test]
fn time_ends_what_is_not_answered() {
    let mut monitor = monitor(Config::default());
    let by = |id, span: &str| request(id).reply_by(span.parse::<fipa_acl::FipaTime>().unwrap());
    monitor.observe(at(0), &by("late", "+PT10S"));
    monitor.observe(at(0), &by("in-time", "+PT5S"));
    monitor.observe(at(0), &request("patient"));
    assert_eq!(monitor.poll_timeout(), Some(Duration::from_secs(5)));
    monitor.observe(at(4), &answer("in-time", Performative::Agree));
    kinds(&mut monitor);
    monitor.handle_timeout(at(5));
    assert_eq!(kinds(&mut monitor), []);
    assert_eq!(monitor.poll_timeout(), Some(Duration::from_secs(10)));
    monitor.handle_timeout(at(10));
    let ended = EventKind::Ended {
        outcome: Outcome::TimedOut,
    };
    assert_eq!(
        kinds(&mut monitor),
        [
            EventKind::Updated {
                state: "timed-out".into()
            },
            ended.clone()
        ]
    );

    // The others are over when nothing was heard of them for an hour.
    monitor.handle_timeout(at(3600));
    assert_eq!(kinds(&mut monitor).last(), Some(&ended));
    assert_eq!(
        monitor
            .conversation(&Expression::from("in-time"))
            .unwrap()
            .outcome(),
        None
    );
    monitor.handle_timeout(at(3604));
    assert_eq!(kinds(&mut monitor).last(), Some(&ended));
}

#[test]
fn a_timer_that_was_handled_is_not_asked_for_again_at_once() {
    let mut monitor = monitor(Config::default());
    let span: fipa_acl::FipaTime = "+PT1S".parse().unwrap();
    monitor.observe(at(0), &request("a").reply_by(span));
    let mut rounds = 0;
    while let Some(due) = monitor.poll_timeout() {
        monitor.handle_timeout(Now {
            mono: due,
            unix_millis: 0,
        });
        rounds += 1;
        assert!(rounds < 10);
    }
    assert!(monitor.is_empty());
}

#[test]
fn whoever_is_gone_is_not_waited_for() {
    let mut monitor = monitor(Config::default());
    monitor.observe(at(0), &request("c-1"));
    monitor.observe(at(0), &request("c-2"));
    monitor.observe(at(0), &answer("c-2", Performative::Refuse));
    kinds(&mut monitor);
    monitor.agent_gone(at(1), "lift");
    assert_eq!(kinds(&mut monitor), []);
    monitor.agent_gone(at(1), "drive");
    let lost = EventKind::Ended {
        outcome: Outcome::PeerLost,
    };
    assert_eq!(
        kinds(&mut monitor),
        [
            EventKind::Updated {
                state: "peer-lost".into()
            },
            lost
        ]
    );
    let late = violation(monitor.observe(at(2), &answer("c-1", Performative::Inform)));
    assert_eq!(late.rule, Rule::Ended);
}

#[test]
fn what_has_ended_is_kept_for_a_while_and_not_without_bound() {
    let config = Config {
        max_ended: 10,
        keep_ended: Duration::from_secs(60),
        ..Config::default()
    };
    let mut monitor = monitor(config);
    for n in 0..1000 {
        let id = format!("c-{n}");
        monitor.observe(at(0), &request(&id));
        monitor.observe(at(0), &answer(&id, Performative::Inform));
    }
    assert_eq!(monitor.len(), 10);
    let late = answer("c-999", Performative::Inform);
    assert_eq!(violation(monitor.observe(at(0), &late)).rule, Rule::Ended);
    monitor.handle_timeout(at(60));
    assert!(monitor.is_empty());
    // Then it looks like a conversation that nobody began.
    assert_eq!(
        violation(monitor.observe(at(60), &late)).rule,
        Rule::Opening
    );
}

#[test]
fn more_conversations_than_there_is_room_for_are_not_monitored() {
    let mut monitor = monitor(Config {
        max_conversations: 2,
        ..Config::default()
    });
    for id in ["a", "b"] {
        assert_eq!(accepted(monitor.observe(at(0), &request(id))), "requested");
    }
    assert_eq!(monitor.observe(at(0), &request("c")), Verdict::NotMonitored);
    assert_eq!(
        accepted(monitor.observe(at(0), &answer("a", Performative::Agree))),
        "agreed"
    );
}

#[test]
fn what_no_protocol_is_known_for_is_not_monitored() {
    let mut monitor = monitor(Config::default());
    let plain = Message {
        protocol: None,
        ..request("a")
    };
    let unnamed = Message {
        conversation_id: None,
        ..request("a")
    };
    for message in [plain, unnamed, request("a").protocol("our-own")] {
        assert_eq!(
            monitor.judge_outgoing(at(0), &message),
            Verdict::NotMonitored
        );
        assert_eq!(monitor.observe(at(0), &message), Verdict::NotMonitored);
    }
    assert!(monitor.is_empty());
}

#[test]
fn asking_changes_nothing() {
    let mut monitor = monitor(Config::default());
    assert_eq!(
        accepted(monitor.judge_outgoing(at(0), &request("a"))),
        "requested"
    );
    assert!(monitor.is_empty());
    monitor.observe(at(0), &request("a"));
    assert_eq!(
        accepted(monitor.judge_outgoing(at(0), &answer("a", Performative::Inform))),
        "done"
    );
    assert_eq!(
        accepted(monitor.observe(at(0), &answer("a", Performative::Agree))),
        "agreed"
    );
}

#[test]
fn a_violation_is_told_as_text_and_as_data() {
    let mut monitor = monitor(Config::default());
    let cfp = Message::new(Performative::Cfp)
        .from_agent("arm")
        .to("drive")
        .protocol("contractNet")
        .conversation_id("a");
    monitor.observe(at(0), &cfp);
    let found =
        violation(monitor.observe(at(0), &cfp.reply(Performative::Inform).from_agent("drive")));
    let expected = |act: &str| Expected {
        performative: act.into(),
        from: "participant".into(),
        to: "initiator".into(),
    };
    assert_eq!(
        found,
        Violation {
            rule: Rule::Performative,
            state: "called".into(),
            text: "drive may not send inform in the state called of fipa-contract-net; \
                   expected: propose or refuse from participant (drive) to initiator (arm)"
                .into(),
            expected: vec![expected("propose"), expected("refuse")],
        }
    );
}

#[test]
fn an_enforcing_agent_answers_a_violation_once() {
    let mut monitor = monitor(Config::default());
    monitor.observe(at(0), &request("a"));
    let wrong = answer("a", Performative::Propose)
        .reply_with("r-7")
        .language("own");
    let violation = violation(monitor.observe(at(0), &wrong));
    let reply = not_understood_reply(&wrong, &violation).unwrap();
    assert_eq!(reply.performative, Performative::NotUnderstood);
    assert_eq!(reply.receiver, [fipa_acl::AgentId::new("drive")]);
    assert_eq!(reply.in_reply_to, Some("r-7".into()));
    assert_eq!(
        (&reply.conversation_id, &reply.language),
        (&wrong.conversation_id, &None)
    );
    assert_eq!(
        reply.content_str().unwrap(),
        "((unexpected-act propose) \"drive may not send propose in the state requested of fipa-request; \
         expected: refuse, agree, inform or failure from participant (drive) to initiator (arm)\")"
    );
    // Two of them would go on for ever.
    assert_eq!(
        not_understood_reply(&reply.from_agent("arm"), &violation),
        None
    );
    let anonymous = Message {
        sender: None,
        ..wrong
    };
    assert_eq!(not_understood_reply(&anonymous, &violation), None);
}

#[test]
fn another_conversation_id_is_another_conversation() {
    let mut conversation = Conversation::new(builtin("request").unwrap(), None);
    let library = Library::builtin();
    assert_eq!(
        accepted(conversation.observe(&library, at(0), &request("a"))),
        "requested"
    );
    let other = violation(conversation.observe(&library, at(0), &answer("b", Performative::Agree)));
    assert_eq!(other.rule, Rule::ConversationId);
    assert_eq!(
        other.text,
        r#"the conversation-id is "b", that of this conversation is "a""#
    );
    let none = Message {
        conversation_id: None,
        ..answer("a", Performative::Agree)
    };
    assert_eq!(
        violation(conversation.observe(&library, at(0), &none)).text,
        r#"the conversation-id is none, that of this conversation is "a""#
    );
    assert_eq!(
        accepted(conversation.observe(&library, at(0), &answer("a", Performative::Agree))),
        "agreed"
    );
}

#[test]
fn a_participant_minds_its_own_part_only() {
    let mut monitor = Monitor::new(
        Arc::new(Library::builtin()),
        Some("s2".into()),
        Config::default(),
    );
    let cfp = (0..20).fold(Message::new(Performative::Cfp), |cfp, n| {
        cfp.to(format!("s{n}"))
    });
    let cfp = cfp
        .from_agent("buyer")
        .protocol("fipa-contract-net")
        .conversation_id("a");
    monitor.observe(at(0), &cfp);
    let participants = monitor.conversation(&"a".into()).unwrap().participants();
    assert_eq!(participants.len(), 1);
    assert_eq!(participants[0].agents, ["s2"]);
    let propose = cfp.reply(Performative::Refuse).from_agent("s2");
    monitor.observe(at(0), &propose);
    assert_eq!(
        kinds(&mut monitor).last(),
        Some(&EventKind::Ended {
            outcome: Outcome::Refused
        })
    );
}

#[test]
fn a_contract_net_of_20_bidders_is_one_conversation() {
    let mut monitor = Monitor::new(
        Arc::new(Library::builtin()),
        Some("buyer".into()),
        Config::default(),
    );
    let bidders = 0..20;
    let cfp = bidders
        .clone()
        .fold(Message::new(Performative::Cfp), |cfp, n| {
            cfp.to(format!("s{n}"))
        });
    let cfp = cfp
        .from_agent("buyer")
        .protocol("fipa-contract-net")
        .conversation_id("a");
    monitor.observe(at(0), &cfp);
    let say = |n: u32, act: Performative| cfp.reply(act).from_agent(format!("s{n}"));
    for n in bidders.clone().filter(|n| n % 3 > 0) {
        accepted(monitor.observe(at(1), &say(n, Performative::Propose)));
    }
    monitor.agent_gone(at(2), "s4");
    for n in bidders.clone().filter(|n| n % 3 == 0) {
        accepted(monitor.observe(at(2), &say(n, Performative::Refuse)));
    }
    let decide = |n: u32, act| {
        Message {
            receiver: vec![format!("s{n}").into()],
            ..cfp.clone()
        }
        .performative(act)
    };
    for n in bidders.clone().filter(|n| n % 3 > 0 && *n != 4) {
        let act = if n == 7 {
            Performative::AcceptProposal
        } else {
            Performative::RejectProposal
        };
        accepted(monitor.observe(at(3), &decide(n, act)));
    }
    assert_eq!(monitor.conversation(&"a".into()).unwrap().outcome(), None);
    accepted(monitor.observe(at(4), &say(7, Performative::Inform)));
    assert_eq!(
        kinds(&mut monitor).last(),
        Some(&EventKind::Ended {
            outcome: Outcome::Done
        })
    );
    assert_eq!(monitor.len(), 1);
    let outcomes = monitor.conversation(&"a".into()).unwrap().participants();
    let count = |outcome| {
        outcomes
            .iter()
            .filter(|p| p.outcome == Some(outcome))
            .count()
    };
    assert_eq!(
        (
            count(Outcome::Done),
            count(Outcome::PeerLost),
            count(Outcome::Refused)
        ),
        (1, 1, 18)
    );
}

#[test]
fn a_failure_from_outside_leaves_those_who_answered_where_they_are() {
    let mut monitor = monitor(Config::default());
    let message = |act| {
        Message::new(act)
            .protocol("fipa-request")
            .conversation_id("c-1")
    };
    let arms = "(arm|b)";
    monitor.observe(
        at(0),
        &message(Performative::Request).from_agent("arm").to(arms),
    );
    let answer = message(Performative::Refuse).from_agent("b").to("arm");
    assert_eq!(accepted(monitor.observe(at(0), &answer)), "refused");
    let outside = message(Performative::Failure)
        .from_agent("mts@r2")
        .to("arm");
    assert_eq!(accepted(monitor.observe(at(0), &outside)), "refused");
}

#[test]
fn expressions_for_receivers_are_not_compiled_without_bound() {
    let everybody = (0..20_000).fold(Message::new(Performative::Inform), |all, n| {
        all.to(format!("(a|b){{50}}{n}.*"))
    });
    let everybody = everybody
        .to("arm")
        .from_agent("drive")
        .protocol("fipa-inform")
        .conversation_id("a");
    let mut monitor = monitor(Config::default());
    assert_eq!(accepted(monitor.observe(at(0), &everybody)), "told");
    let participants = monitor.conversation(&"a".into()).unwrap().participants();
    assert_eq!(participants[0].agents, ["arm"]);
    let mut watcher = Monitor::new(Arc::new(Library::builtin()), None, Config::default());
    assert_eq!(accepted(watcher.observe(at(0), &everybody)), "told");
    assert_eq!(
        watcher
            .conversation(&"a".into())
            .unwrap()
            .participants()
            .len(),
        10_000
    );
}

/// The same message with another act.
trait WithAct {
    fn performative(self, act: Performative) -> Message;
}

impl WithAct for Message {
    fn performative(self, act: Performative) -> Message {
        Message {
            performative: act,
            ..self
        }
    }
}

#[test]
fn a_hundred_thousand_conversations_are_kept_apart() {
    let mut monitor = monitor(Config::default());
    const MANY: usize = 100_000;
    for n in 0..MANY {
        accepted(monitor.observe(at(0), &request(&format!("c-{n}"))));
    }
    assert_eq!(monitor.len(), MANY);
    for n in (0..MANY).step_by(1000) {
        let id = format!("c-{n}");
        assert_eq!(
            accepted(monitor.observe(at(1), &answer(&id, Performative::Agree))),
            "agreed"
        );
        violation(monitor.observe(at(1), &answer(&id, Performative::Agree)));
    }
    assert_eq!(
        monitor.conversation(&"c-1".into()).unwrap().state(),
        "requested"
    );
}
