//! Letters in JSON: flattened and raw, what is read, which errors.

use bytes::Bytes;
use fipa_acl::{Envelope, FipaTime, Letter, Message, Performative, Received, Representation};
use fipa_acl::{Slots, Text};
use fipa_json::{Body, EnvelopeForm, envelope_for};
use fipa_json::{letter_from_json, letter_to_json, raw_letter_to_json};
use proptest::collection::vec;
use proptest::option::of;
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::strategies;

proptest! {
    #[test]
    fn a_shown_letter_reads_back(
        base in slots(), stamps in vec(stamp(), 0..3), body in body(),
    ) {
        let overlays = stamps.into_iter().map(stamped).collect();
        let envelope = Envelope { base, overlays };
        let form = letter_from_json(&letter_to_json(&envelope, &body)).unwrap();
        prop_assert_eq!(form.envelope, EnvelopeForm::Flattened(Box::new(envelope)));
        prop_assert_eq!(form.body, body);
    }

    #[test]
    fn a_raw_letter_reads_back_layer_by_layer(
        base in slots(), overlays in vec((slots(), of(stamp())), 0..3),
        payload in strategies::octets(),
    ) {
        let overlays = overlays
            .into_iter()
            .map(|(slots, received)| Slots { received, ..slots })
            .collect();
        let letter = Letter { envelope: Envelope { base, overlays }, payload };
        let form = letter_from_json(&raw_letter_to_json(&letter, letter.envelope.layers())).unwrap();
        let layers: Vec<_> = letter.envelope.layers().cloned().collect();
        let EnvelopeForm::Layers { layers: read, flattened } = form.envelope else {
            panic!("no layers");
        };
        prop_assert_eq!(read, layers);
        let stamps = flattened.as_ref().map(|envelope| envelope.stamps().count());
        prop_assert_eq!(stamps, Some(letter.envelope.stamps().count()));
        prop_assert_eq!(form.body, Body::Payload(letter.payload));
    }
}

fn body() -> impl Strategy<Value = Body> {
    prop_oneof![
        strategies::message().prop_map(|message| Body::Message(Box::new(message))),
        strategies::octets().prop_map(Body::Payload),
    ]
}

fn slots() -> impl Strategy<Value = Slots> {
    let agents = || vec(strategies::agent(), 0..2);
    let text = || of(strategies::text());
    (
        (agents(), of(strategies::agent()), text(), text()),
        (of(any::<u64>()), text(), of(strategies::time()), agents()),
        (of(strategies::octets()), strategies::parameters()),
    )
        .prop_map(|(addressing, payload, rest)| Slots {
            to: addressing.0,
            from: addressing.1,
            comments: addressing.2,
            acl_representation: addressing.3.map(Representation::from),
            payload_length: payload.0,
            payload_encoding: payload.1,
            date: payload.2,
            intended_receiver: payload.3,
            received: None,
            transport_behaviour: rest.0,
            user_defined: rest.1,
        })
}

fn stamp() -> impl Strategy<Value = Received> {
    let text = || of(strategies::text());
    let by = "\\PC{1,8}".prop_map(Text::from);
    (
        by,
        text(),
        strategies::time(),
        text(),
        text(),
        strategies::parameters(),
    )
        .prop_map(|(by, from, date, id, via, user_defined)| Received {
            by,
            from,
            date,
            id,
            via,
            user_defined,
        })
}

fn stamped(received: Received) -> Slots {
    Slots {
        received: Some(received),
        ..Slots::default()
    }
}

fn time(text: &str) -> FipaTime {
    text.parse().unwrap()
}

fn simple_stamp(by: &str) -> Received {
    Received {
        by: by.into(),
        from: None,
        date: time("2026-01-02T03:04:05.700Z"),
        id: None,
        via: None,
        user_defined: Vec::new(),
    }
}

/// A letter in which an overlay changed values, with a stamp in the base and an empty one.
fn travelled() -> Envelope {
    Envelope {
        base: Slots {
            to: vec!["b@h".into()],
            from: Some("a@h".into()),
            acl_representation: Some(Representation::BitEfficient),
            payload_length: Some(4),
            date: Some(time("2026-01-02T03:04:05.678Z")),
            received: Some(simple_stamp("first")),
            transport_behaviour: Some(Bytes::from_static(b"\xff")),
            user_defined: vec![("K".into(), "old".into()), ("L".into(), "l".into())],
            ..Slots::default()
        },
        overlays: vec![
            Slots {
                received: Some(simple_stamp("")),
                user_defined: vec![("K".into(), "1".into()), ("K".into(), "new".into())],
                ..Slots::default()
            },
            Slots {
                intended_receiver: vec!["c@h".into()],
                received: Some(Received {
                    from: Some("tcp://h:1".into()),
                    id: Some("7".into()),
                    via: Some("http".into()),
                    user_defined: vec![("V".into(), "v".into())],
                    ..simple_stamp("second")
                }),
                ..Slots::default()
            },
        ],
    }
}

const FLATTENED: &str = concat!(
    r#"{"to":[{"name":"b@h"}],"from":{"name":"a@h"},"#,
    r#""acl-representation":"fipa.acl.rep.bitefficient.std","payload-length":4,"#,
    r#""date":"2026-01-02T03:04:05.678Z","intended-receiver":[{"name":"c@h"}],"#,
    r#""received":[{"by":"first","date":"2026-01-02T03:04:05.700Z"},"#,
    r#"{"by":"second","from":"tcp://h:1","date":"2026-01-02T03:04:05.700Z","id":"7","#,
    r#""via":"http","user-defined":{"X-V":"v"}}],"#,
    r#""transport-behaviour":{"base64":"/w=="},"user-defined":{"X-K":"new","X-L":"l"}}"#,
);

#[test]
fn a_letter_is_shown_flattened_with_its_stamps_in_order_of_travel() {
    let body = Body::Message(Box::new(Message::new(Performative::Inform)));
    assert_eq!(
        letter_to_json(&travelled(), &body).to_string(),
        format!(r#"{{"envelope":{FLATTENED},"message":{{"performative":"inform"}}}}"#)
    );
    let unopened = Body::Payload(Bytes::from_static(b"text"));
    assert_eq!(
        letter_to_json(&travelled(), &unopened).to_string(),
        format!(r#"{{"envelope":{FLATTENED},"payload":{{"base64":"dGV4dA=="}}}}"#)
    );
}

#[test]
fn the_raw_form_adds_the_layers_as_they_stand_and_the_payload() {
    let letter = Letter {
        envelope: travelled(),
        payload: Bytes::from_static(b"text"),
    };
    let raw = raw_letter_to_json(&letter, letter.envelope.layers());
    let keys: Vec<&String> = raw.as_object().unwrap().keys().collect();
    assert_eq!(keys, ["envelope", "layers", "payload"]);
    assert_eq!(raw["envelope"].to_string(), FLATTENED);
    assert_eq!(raw["payload"], json!({"base64": "dGV4dA=="}));
    let layers = raw["layers"].as_array().unwrap();
    assert_eq!(layers.len(), 3);
    assert_eq!(layers[0]["received"][0]["by"], json!("second"));
    assert_eq!(layers[1].to_string(), r#"{"user-defined":{"X-K":"new"}}"#);
    assert_eq!(layers[2]["received"][0]["by"], json!("first"));
    assert_eq!(layers[2]["user-defined"], json!({"X-K": "old", "X-L": "l"}));
}

#[test]
fn layers_win_over_the_flattened_envelope_and_may_hold_a_message() {
    let given = json!({"envelope": {"comments": "flat"},
        "layers": [{"comments": "new"}, {"comments": "base"}],
        "message": {"performative": "inform"}});
    let form = letter_from_json(&given).unwrap();
    let EnvelopeForm::Layers { layers, .. } = form.envelope else {
        panic!("not layers");
    };
    let comments: Vec<_> = layers.iter().map(|layer| layer.comments.clone()).collect();
    assert_eq!(comments, [Some("new".into()), Some("base".into())]);
    assert!(matches!(form.body, Body::Message(_)));
}

#[test]
fn the_envelope_for_a_message_goes_to_its_receivers() {
    let now = time("2026-01-02T03:04:05.678Z");
    let message = Message::new(Performative::Inform)
        .from_agent("a@h")
        .to("b@h")
        .to("c@h");
    let envelope = envelope_for(&message, now);
    assert_eq!(envelope.to(), message.receiver);
    assert_eq!(envelope.base.intended_receiver, message.receiver);
    assert_eq!(envelope.from(), message.sender.as_ref());
    assert_eq!(envelope.date(), Some(now));
}

#[test]
fn an_error_names_the_key_and_what_was_expected() {
    let with = |key: &str, value: Value| json!({"envelope": {key: value}, "payload": ""});
    for (given, error) in [
        (json!("x"), "expected an object"),
        (json!({"payload": ""}), "envelope: missing"),
        (json!({"envelope": {}}), "message: missing"),
        (
            json!({"envelope": {}, "message": {}}),
            "message.performative: missing",
        ),
        (
            json!({"envelope": {}, "payload": "", "message": {"performative": "cfp"}}),
            "payload: not beside message",
        ),
        (json!({"envelop": {}}), "envelop: unknown key"),
        (
            json!({"layers": [], "payload": ""}),
            "layers: expected one envelope at least",
        ),
        (
            json!({"layers": [{}, {"to": [{}]}], "payload": ""}),
            "layers[1].to[0].name: missing",
        ),
        (
            with("receiver", json!([])),
            "envelope.receiver: unknown key",
        ),
        (
            with("payload-length", json!(-1)),
            "envelope.payload-length: expected a whole number",
        ),
        (
            with("date", json!("now")),
            "envelope.date: a date is like 2026-11-22T10:00:00.000Z",
        ),
        (
            with("received", json!([{"by": "x"}])),
            "envelope.received[0].date: missing",
        ),
        (
            with("received", json!([{"date": "+PT1S"}])),
            "envelope.received[0].by: missing",
        ),
        (
            with("user-defined", json!({"X-A": {}})),
            "envelope.user-defined.X-A: expected a string",
        ),
    ] {
        assert_eq!(letter_from_json(&given).unwrap_err().to_string(), error);
    }
    let stamp = json!({"by": "x", "date": "+PT1S"});
    let twice = json!({"layers": [{"received": [stamp, stamp]}], "payload": ""});
    assert_eq!(
        letter_from_json(&twice).unwrap_err().to_string(),
        "layers[0].received: expected one stamp at most in one layer"
    );
}
