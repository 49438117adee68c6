//! Messages and agent identifiers in JSON: what is shown, what is read, which errors.

use fipa_acl::{AgentId, Expression, FipaTime, Message, Performative, Zone};
use fipa_json::{agent_id_from_json, agent_id_to_json, message_from_json, message_to_json};
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::strategies;

proptest! {
    #[test]
    fn a_shown_message_reads_back(message in strategies::message()) {
        let shown = message_to_json(&message).to_string();
        let value: Value = serde_json::from_str(&shown).unwrap();
        prop_assert_eq!(message_from_json(&value), Ok(message));
    }

    #[test]
    fn a_shown_agent_identifier_reads_back(agent in strategies::agent()) {
        prop_assert_eq!(agent_id_from_json(&agent_id_to_json(&agent)), Ok(agent));
    }
}

/// A message with every parameter, and its form.
fn everything() -> (Message, &'static str) {
    let message = Message::new(Performative::Request)
        .from_agent(
            AgentId::new("a@robot1")
                .address("tcp://127.0.0.1:9000")
                .resolver("r@x")
                .user_defined("KEY", "v"),
        )
        .to("b@robot2")
        .reply_to("c@robot1")
        .content("text")
        .language("fipa-sl0")
        .encoding("utf-8")
        .ontology("maps")
        .protocol("fipa-request")
        .conversation_id("c 1")
        .reply_with("(a \"b c\" (1))")
        .in_reply_to(Expression::Number("7".into()))
        .reply_by("2026-11-22T10:00:00.000Z".parse::<FipaTime>().unwrap())
        .user_defined("KEY", "value");
    let shown = concat!(
        r#"{"performative":"request","sender":{"name":"a@robot1","#,
        r#""addresses":["tcp://127.0.0.1:9000"],"resolvers":[{"name":"r@x"}],"#,
        r#""user-defined":{"X-KEY":"v"}},"receiver":[{"name":"b@robot2"}],"#,
        r#""reply-to":[{"name":"c@robot1"}],"content":"text","language":"fipa-sl0","#,
        r#""encoding":"utf-8","ontology":"maps","protocol":"fipa-request","#,
        r#""conversation-id":"c 1","reply-with":"(a \"b c\" (1))","in-reply-to":"7","#,
        r#""reply-by":"2026-11-22T10:00:00.000Z","user-defined":{"X-KEY":"value"}}"#,
    );
    (message, shown)
}

#[test]
fn every_parameter_has_its_key_and_its_place() {
    let (message, shown) = everything();
    assert_eq!(message_to_json(&message).to_string(), shown);
    let value: Value = serde_json::from_str(shown).unwrap();
    assert_eq!(message_from_json(&value), Ok(message));
}

#[test]
fn absent_parameters_and_empty_lists_are_absent_keys() {
    let bare = Message::new(Performative::Inform);
    assert_eq!(
        message_to_json(&bare).to_string(),
        r#"{"performative":"inform"}"#
    );
    let empty = json!({"performative": "inform", "receiver": [], "user-defined": {}});
    assert_eq!(message_from_json(&empty), Ok(bare));
}

#[test]
fn content_is_a_string_or_base64() {
    for (octets, shown, also) in [
        (&b"text"[..], json!("text"), json!({"base64": "dGV4dA=="})),
        (b"", json!(""), json!({"base64": ""})),
        (
            b"\0\x01\x02",
            json!("\0\u{1}\u{2}"),
            json!({"base64": "AAEC"}),
        ),
        (
            b"\xff\x01",
            json!({"base64": "/wE="}),
            json!({"base64": "/wE="}),
        ),
    ] {
        let message = Message::new(Performative::Inform).content(octets);
        assert_eq!(message_to_json(&message)["content"], shown);
        for given in [shown, also] {
            let value = json!({"performative": "inform", "content": given});
            assert_eq!(message_from_json(&value), Ok(message.clone()));
        }
    }
}

#[test]
fn dates_are_shown_in_utc_and_spans_with_their_sign() {
    let unzoned = FipaTime::Absolute {
        unix_millis: 1_795_341_600_000,
        zone: Zone::Unspecified,
    };
    for (time, shown) in [
        (unzoned, "2026-11-22T10:00:00.000Z"),
        ("+PT10S".parse().unwrap(), "+PT10S"),
        ("-P1DT0.5S".parse().unwrap(), "-P1DT0.5S"),
    ] {
        let message = Message::new(Performative::Cfp).reply_by(time);
        assert_eq!(message_to_json(&message)["reply-by"], json!(shown));
    }
}

#[test]
fn a_user_defined_name_is_shown_with_one_prefix_and_the_last_value() {
    let message = Message::new(Performative::Inform)
        .user_defined("X-x-A", "1")
        .user_defined("B", "2")
        .user_defined("A", "(3 4)");
    let shown = message_to_json(&message);
    assert_eq!(
        shown["user-defined"].to_string(),
        r#"{"X-A":"(3 4)","X-B":"2"}"#
    );
    let given = json!({"performative": "inform",
        "user-defined": {"X-A": "1", "B": "2", "x-A": "(3 4)"}});
    assert_eq!(
        message_to_json(&message_from_json(&given).unwrap()).to_string(),
        shown.to_string()
    );
}

#[test]
fn a_performative_outside_the_standard_is_kept_as_it_came() {
    for (given, shown) in [("Shout", "Shout"), ("QUERY-REF", "query-ref")] {
        let message = message_from_json(&json!({"performative": given})).unwrap();
        assert_eq!(message_to_json(&message)["performative"], json!(shown));
    }
}

#[test]
fn an_error_names_the_key_and_what_was_expected() {
    let with = |key: &str, value: Value| json!({"performative": "inform", key: value});
    for (given, error) in [
        (json!([]), "expected an object"),
        (json!({}), "performative: missing"),
        (
            json!({"performative": null}),
            "performative: expected a string",
        ),
        (with("recevier", json!([])), "recevier: unknown key"),
        (with("two\nlines", json!(1)), "two\\nlines: unknown key"),
        (with("sender", json!("a")), "sender: expected an object"),
        (with("sender", json!({})), "sender.name: missing"),
        (
            with("receiver", json!({"name": "b"})),
            "receiver: expected an array",
        ),
        (
            with("receiver", json!([{"name": "b"}, {"name": 7}])),
            "receiver[1].name: expected a string",
        ),
        (
            with("reply-to", json!([{"name": "b", "addresses": ["x", 1]}])),
            "reply-to[0].addresses[1]: expected a string",
        ),
        (
            with("sender", json!({"name": "b", "resolvers": [{"nam": 1}]})),
            "sender.resolvers[0].nam: unknown key",
        ),
        (
            with("content", json!(1)),
            "content: expected a string or an object with the key base64",
        ),
        (with("content", json!({})), "content.base64: missing"),
        (
            with("content", json!({"base64": "AAE", "x": 1})),
            "content.x: unknown key",
        ),
        (
            with("content", json!({"base64": "AAE"})),
            "content.base64: expected base64 with its padding",
        ),
        (with("language", json!(1)), "language: expected a string"),
        (
            with("reply-by", json!("tomorrow")),
            "reply-by: a date is like 2026-11-22T10:00:00.000Z",
        ),
        (
            with("user-defined", json!([])),
            "user-defined: expected an object",
        ),
        (
            with("user-defined", json!({"X-A": 1})),
            "user-defined.X-A: expected a string",
        ),
    ] {
        assert_eq!(message_from_json(&given).unwrap_err().to_string(), error);
    }
}
