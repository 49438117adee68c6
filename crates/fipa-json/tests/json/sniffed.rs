//! What passes a daemon, in JSON.

use fipa_acl::{AgentId, Envelope, Letter, Message, Performative, Slots};
use fipa_json::sniffed_to_json;
use fipa_link::{Inside, Outcome, Parts, Passed, ReceiverOutcome, Sniffed};
use serde_json::{Value, json};

fn sniffed(lost: u64, passed: Passed) -> Sniffed {
    Sniffed {
        number: 7,
        unix_millis: 1_795_341_600_123,
        lost,
        passed,
    }
}

fn letter(outcomes: Vec<ReceiverOutcome>) -> Sniffed {
    let from = "robot2".into();
    let via = "tcp".into();
    let parts = Parts::from(bytes::Bytes::from_static(b"octets"));
    sniffed(
        0,
        Passed::Letter {
            from,
            via,
            outcomes,
            parts,
        },
    )
}

fn opened(_: &Parts) -> Result<(Letter, Result<Message, String>), String> {
    let envelope = Envelope::new(Slots {
        to: vec![AgentId::new("b"), AgentId::new("c")],
        ..Slots::default()
    });
    let payload = "pay".into();
    let message = Message::new(Performative::Inform).content("hi");
    Ok((Letter { envelope, payload }, Ok(message)))
}

fn outcome(to: &str, outcome: Outcome) -> ReceiverOutcome {
    ReceiverOutcome {
        to: to.into(),
        outcome,
        via: None,
        reason: "why".into(),
    }
}

fn only(lines: Vec<Value>) -> Value {
    let [line] = <[Value; 1]>::try_from(lines).unwrap();
    line
}

#[test]
fn a_letter_is_shown_with_what_became_of_it() {
    let one = letter(vec![outcome("b", Outcome::Timeout)]);
    let shown = only(sniffed_to_json(&one, opened));
    assert_eq!(
        shown.to_string(),
        r#"{"time":"2026-11-22T10:00:00.123Z","event":"letter","number":7,"octets":6,"#.to_owned()
            + r#""from":"robot2","via":"tcp","envelope":{"to":[{"name":"b"},{"name":"c"}]},"#
            + r#""message":{"performative":"inform","content":"hi"},"#
            + r#""outcomes":[{"to":"b","outcome":"timeout","via":null,"reason":"why"}]}"#
    );
}

#[test]
fn an_outcome_of_the_whole_letter_is_that_of_each_receiver() {
    let one = letter(vec![outcome("", Outcome::Expired)]);
    let shown = only(sniffed_to_json(&one, opened));
    let told = |n: usize| {
        (
            &shown["outcomes"][n]["to"],
            &shown["outcomes"][n]["outcome"],
        )
    };
    assert_eq!(told(0), (&json!("b"), &json!("expired")));
    assert_eq!(told(1), (&json!("c"), &json!("expired")));
}

#[test]
fn what_cannot_be_read_is_shown_as_far_as_it_can() {
    let unread = |parts: &Parts| {
        let (letter, _) = opened(parts)?;
        Ok((letter, Err("no message".to_owned())))
    };
    let shown = only(sniffed_to_json(&letter(Vec::new()), unread));
    assert_eq!(shown["payload"], json!({"base64": "cGF5"}));
    assert!(shown.get("message").is_none());
    let shown = only(sniffed_to_json(&letter(Vec::new()), |_| Err("bad".into())));
    assert_eq!(shown["error"], "bad");
    assert_eq!(shown["outcomes"], json!([]));
}

#[test]
fn what_was_lost_stands_before_what_came_next() {
    let inside = Inside {
        protocol: "text".into(),
        incoming: false,
        place: "udp://127.0.0.1:5000".into(),
        form: r#"{"origin":"a","question":"b"}"#.into(),
    };
    let lines = sniffed_to_json(&sniffed(3, Passed::Inside(inside)), opened);
    assert_eq!(
        lines,
        [
            json!({"time": "2026-11-22T10:00:00.123Z", "event": "lost", "count": 3}),
            json!({
                "time": "2026-11-22T10:00:00.123Z",
                "event": "text",
                "number": 7,
                "direction": "out",
                "place": "udp://127.0.0.1:5000",
                "text": {"origin": "a", "question": "b"},
            }),
        ]
    );
    assert_eq!(
        sniffed_to_json(&sniffed(0, Passed::End), opened),
        [] as [Value; 0]
    );
}
