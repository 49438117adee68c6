use serde_json::{Value, json};

use crate::{MESSAGE, MESSAGE_JSON, NOW, decode, encode, failure};

const ENVELOPE: [&str; 2] = ["--envelope", "bit-efficient"];

fn decoded(options: &[&str], octets: &[u8]) -> Value {
    let (line, result) = decode(options, octets);
    assert_eq!(result, Ok(()));
    serde_json::from_str(&line).unwrap()
}

fn encoded_letter(json: &Value) -> Vec<u8> {
    let (octets, result) = encode(&ENVELOPE, &json.to_string());
    assert_eq!(result, Ok(()));
    octets
}

#[test]
fn values_are_encoded_one_after_the_other_however_they_are_laid_out() {
    let value: Value = serde_json::from_str(MESSAGE_JSON).unwrap();
    let pretty = serde_json::to_string_pretty(&value).unwrap();
    for input in [
        format!("{MESSAGE_JSON}\n{MESSAGE_JSON}\n"),
        format!("{MESSAGE_JSON}{MESSAGE_JSON}"),
        format!("\n{pretty}\n\n{pretty}"),
    ] {
        let (octets, result) = encode(&[], &input);
        assert_eq!(result, Ok(()));
        assert_eq!(octets, [MESSAGE, MESSAGE].concat());
    }
    assert_eq!(encode(&[], " \n"), (Vec::new(), Ok(())));
}

#[test]
fn what_is_wrong_has_its_place_and_what_came_before_is_written() {
    for (second, line) in [
        ("{\"performative\":inform}", "2:17: expected value"),
        ("{\"performative\":", "2:16: EOF while parsing a value"),
        ("  {}", "2:3: performative: missing"),
        (
            r#"{"performative":"inform","receiver":[{"nam":"x"}]}"#,
            "2:1: receiver[0].nam: unknown key",
        ),
        (r#"[{"performative":"inform"}]"#, "2:1: expected an object"),
        (
            r#"{"envelope":{},"message":{}}"#,
            "2:1: a letter is written with --envelope",
        ),
    ] {
        let (octets, result) = encode(&[], &format!("{MESSAGE_JSON}\n{second}"));
        assert_eq!(octets, MESSAGE);
        assert_eq!(failure(result), (2, line.into()));
    }
}

#[test]
fn what_the_representation_cannot_hold_is_malformed() {
    let (octets, result) = encode(&[], r#"{"performative":"inform","protocol":"two words"}"#);
    assert_eq!(octets, b"");
    let (code, line) = failure(result);
    assert_eq!(code, 2);
    assert!(line.starts_with("1:1: protocol: "), "{line}");
}

#[test]
fn a_bare_message_gets_an_envelope() {
    let (octets, result) = encode(&ENVELOPE, MESSAGE_JSON);
    assert_eq!(result, Ok(()));
    let message: Value = serde_json::from_str(MESSAGE_JSON).unwrap();
    assert_eq!(
        decoded(&[], &octets),
        json!({
            "envelope": {
                "to": [{"name": "b@h"}],
                "from": {"name": "a@h"},
                "acl-representation": "fipa.acl.rep.bitefficient.std",
                "payload-length": MESSAGE.len(),
                "date": NOW,
                "intended-receiver": [{"name": "b@h"}],
            },
            "message": message,
        })
    );
}

#[test]
fn a_letter_keeps_its_envelope_but_for_what_follows_from_the_message() {
    let mut letter = json!({
        "envelope": {
            "to": [{"name": "b@h", "addresses": ["tcp://h:1"]}],
            "comments": "a letter",
            "acl-representation": "fipa.acl.rep.xml.std",
            "payload-length": 7,
            "date": NOW,
            "received": [
                {"by": "first", "date": NOW, "id": "1"},
                {"by": "second", "date": NOW, "via": "http"},
            ],
            "user-defined": {"X-K": "v"},
        },
        "message": {"performative": "inform"},
    });
    let octets = encoded_letter(&letter);
    letter["envelope"]["acl-representation"] = "fipa.acl.rep.bitefficient.std".into();
    letter["envelope"]["payload-length"] = 4.into();
    assert_eq!(decoded(&[], &octets), letter);
    // Each stamp is one overlay, and the newest is in front.
    let layers = &decoded(&["--raw"], &octets)["layers"];
    assert_eq!(layers.as_array().unwrap().len(), 3);
    assert_eq!(layers[0]["received"][0]["by"], "second");
    assert_eq!(
        layers[1],
        json!({"received": [letter["envelope"]["received"][0]]})
    );
    assert_eq!(layers[2]["comments"], "a letter");
}

#[test]
fn layers_are_written_as_given() {
    let raw = json!({
        "layers": [
            {"intended-receiver": [{"name": "c@h"}], "payload-length": 9,
             "received": [{"by": "second", "date": NOW}]},
            {"received": [{"by": "first", "date": NOW}]},
            {"to": [{"name": "b@h"}], "acl-representation": "com.example.rep", "date": NOW,
             "received": [{"by": "zeroth", "date": NOW}]},
        ],
        "payload": {"base64": "/wE="},
    });
    let octets = encoded_letter(&raw);
    let shown = decoded(&["--raw"], &octets);
    assert_eq!(shown["layers"], raw["layers"]);
    assert_eq!(shown["payload"], raw["payload"]);
    assert_eq!(shown["envelope"]["payload-length"], 9);
    assert_eq!(encoded_letter(&shown), octets);

    let with_message = json!({"layers": raw["layers"], "message": {"performative": "inform"}});
    let shown = decoded(&["--raw"], &encoded_letter(&with_message));
    assert_eq!(shown["layers"], raw["layers"]);
    assert_eq!(shown["payload"], json!({"base64": "+hAIAQ=="}));
}

#[test]
fn a_payload_that_came_encoded_keeps_the_name_of_its_representation() {
    let mut letter = json!({
        "envelope": {"acl-representation": "com.example.rep", "payload-length": 9, "date": NOW},
        "payload": {"base64": "aGk="},
    });
    let octets = encoded_letter(&letter);
    letter["envelope"]["payload-length"] = 2.into();
    assert_eq!(decoded(&[], &octets), letter);
}

#[test]
fn a_letter_with_a_wrong_envelope_is_malformed() {
    for (letter, line) in [
        (
            r#"{"envelope":{"form":{}},"message":{}}"#,
            "1:1: envelope.form: unknown key",
        ),
        (r#"{"layers":[{}]}"#, "1:1: message: missing"),
        (
            r#"{"envelope":{},"message":{"performative":"cfp"}}"#,
            "1:1: date: a base envelope cannot be without it",
        ),
    ] {
        let (octets, result) = encode(&ENVELOPE, letter);
        assert_eq!(octets, b"");
        assert_eq!(failure(result), (2, line.into()));
    }
}
