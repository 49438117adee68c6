//! All forms of messages and envelopes, in any combination and one after the other.

use serde_json::{Value, json};

use crate::without_payload_slots;
use crate::{MESSAGE, MESSAGE_JSON, NOW, decode, decoded, encode_as, encoded, failure};

const REPS: [&str; 3] = ["bit-efficient", "xml", "string"];
const ENVELOPE_REPS: [&str; 2] = ["bit-efficient", "xml"];

fn message() -> Value {
    json!({
        "performative": "request",
        "sender": {"name": "a@h", "addresses": ["tcp://h:1", "http://h:2/acc"],
            "resolvers": [{"name": "r@h"}], "user-defined": {"X-KEY": "v w"}},
        "receiver": [{"name": "b@h"}, {"name": "c@h"}],
        "reply-to": [{"name": "d@h"}],
        "content": "say \"hi\" & <so> \\ on, grüß",
        "language": "fipa-sl",
        "encoding": "(a \"b c\" (1))",
        "ontology": "two words",
        "protocol": "fipa-request",
        "conversation-id": "c-1",
        "reply-with": "1.5",
        "in-reply-to": ":colon",
        "reply-by": NOW,
        "user-defined": {"X-a": "1", "X-b": "grüß"},
    })
}

fn letter() -> Value {
    json!({
        "envelope": {
            "to": [{"name": "b@h", "addresses": ["tcp://h:3"]}, {"name": "c@h"}],
            "from": {"name": "a@h"},
            "comments": "<a> & \"b\"",
            "date": NOW,
            "intended-receiver": [{"name": "b@h"}],
            "received": [
                {"by": "first", "from": "http://h:2/acc", "date": NOW, "id": "1", "via": "http"},
                {"by": "second", "date": NOW, "user-defined": {"X-s": "t"}},
            ],
            "user-defined": {"X-K": "v"},
        },
        "message": message(),
    })
}

#[test]
fn every_form_of_a_message_is_found_out() {
    for rep in REPS {
        let octets = encoded(rep, &[], &message());
        for options in [&[][..], &["--as", rep], &["--raw"]] {
            assert_eq!(decoded(options, &octets), [message()], "{rep}");
        }
    }
}

#[test]
fn every_form_of_a_message_goes_with_every_form_of_an_envelope() {
    for rep in REPS {
        for envelope_rep in ENVELOPE_REPS {
            let octets = encoded(rep, &["--envelope", envelope_rep], &letter());
            for options in [&[][..], &["--envelope"], &["--as", rep, "--envelope"]] {
                let again = &decoded(options, &octets)[0];
                assert_eq!(
                    without_payload_slots(again),
                    letter(),
                    "{rep} {envelope_rep}"
                );
                let name = format!("fipa.acl.rep.{}.std", rep.replace('-', ""));
                assert_eq!(again["envelope"]["acl-representation"], *name);
            }
        }
    }
}

#[test]
fn payload_length_is_that_of_the_payload() {
    for rep in REPS {
        let message = encoded(rep, &[], &message());
        for envelope_rep in ENVELOPE_REPS {
            let octets = encoded(rep, &["--envelope", envelope_rep], &letter());
            let length = &decoded(&[], &octets)[0]["envelope"]["payload-length"];
            assert_eq!(*length, message.len());
            assert!(octets.ends_with(&message));
        }
    }
}

#[test]
fn a_bare_message_gets_an_envelope_in_either_form() {
    for envelope_rep in ENVELOPE_REPS {
        let (octets, result) = encode_as("string", &["--envelope", envelope_rep], MESSAGE_JSON);
        assert_eq!(result, Ok(()));
        let expected = json!({
            "envelope": {
                "to": [{"name": "b@h"}],
                "from": {"name": "a@h"},
                "acl-representation": "fipa.acl.rep.string.std",
                "payload-length": 104,
                "date": NOW,
                "intended-receiver": [{"name": "b@h"}],
            },
            "message": serde_json::from_str::<Value>(MESSAGE_JSON).unwrap(),
        });
        assert_eq!(decoded(&[], &octets), [expected]);
    }
}

/// Each form of a message and of a letter once, and what they are in JSON.
fn one_of_each() -> Vec<(Vec<u8>, Value)> {
    let mut all = Vec::new();
    for rep in REPS {
        all.push((encoded(rep, &[], &message()), message()));
        for envelope_rep in ENVELOPE_REPS {
            let octets = encoded(rep, &["--envelope", envelope_rep], &letter());
            let json = decoded(&[], &octets).remove(0);
            all.push((octets, json));
        }
    }
    all
}

#[test]
fn all_forms_may_follow_each_other_with_white_space_or_without() {
    let (mut octets, json): (Vec<_>, Vec<_>) = one_of_each().into_iter().unzip();
    octets.reverse();
    let json: Vec<Value> = json.into_iter().rev().collect();
    for between in [&b""[..], b"\n", b"\r\n \t"] {
        assert_eq!(decoded(&[], &octets.join(between)), json);
    }
}

#[test]
fn several_of_one_form_may_follow_each_other() {
    for (octets, json) in one_of_each() {
        let (one, two) = (json.clone(), json);
        assert_eq!(decoded(&[], &octets.repeat(2)), [one, two]);
    }
}

#[test]
fn what_follows_any_form_must_be_a_message_or_a_letter() {
    for (octets, _) in one_of_each() {
        let (lines, result) = decode(&[], &[&octets, &b"\nx"[..]].concat());
        assert_eq!(lines.lines().count(), 1);
        let place = octets.len() + 1;
        let line = format!("octet {place}: neither a message nor a letter begins here (malformed)");
        assert_eq!(failure(result), (2, line));
    }
}

#[test]
fn what_is_cut_short_is_malformed_and_says_where() {
    for (octets, _) in one_of_each() {
        // A letter without its last octets announces more of them.
        let cut = &octets[..octets.len() - 1];
        let (lines, result) = decode(&[], &[b"(inform)\n", cut].concat());
        assert_eq!(lines, "{\"performative\":\"inform\"}\n");
        let (code, line) = failure(result);
        assert_eq!(code, 2);
        let place = format!("octet {}: ", 9 + cut.len());
        assert!(line.starts_with(&place), "{line}");
    }
}

#[test]
fn a_representation_that_is_insisted_on_is_the_only_one() {
    for rep in REPS {
        for other in REPS.into_iter().filter(|other| *other != rep) {
            let octets = encoded(rep, &[], &message());
            let (lines, result) = decode(&["--as", other], &octets);
            assert_eq!(
                (lines.as_str(), failure(result).0),
                ("", 2),
                "{rep} as {other}"
            );
            let octets = encoded(rep, &["--envelope", "xml"], &letter());
            let (lines, result) = decode(&["--as", other], &octets);
            assert_eq!(
                (lines.as_str(), failure(result).0),
                ("", 2),
                "{rep} as {other}"
            );
        }
    }
}

#[test]
fn envelope_insists_on_a_letter_in_any_form() {
    for rep in REPS {
        let (_, result) = decode(&["--envelope"], &encoded(rep, &[], &message()));
        let line = "octet 0: no letter begins here (malformed)";
        assert_eq!(failure(result), (2, line.into()));
    }
}

/// Hours beyond those of a day are carried into days as long as these have two digits.
#[test]
fn a_span_that_is_shown_can_be_encoded() {
    for (fields, shown) in [
        ("00000097T480000000", "+P99D"),
        ("00000098T480000000", "+P98DT48H"),
        ("00009999T999999999", "+P99M99DT99H99M99.999S"),
    ] {
        let octets = format!("(inform :reply-by +{fields})");
        let message = &decoded(&[], octets.as_bytes())[0];
        assert_eq!(message["reply-by"], shown);
        for rep in REPS {
            let again = &decoded(&[], &encoded(rep, &[], message))[0];
            assert_eq!(again, message, "{rep}");
        }
    }
}

#[test]
fn layers_stand_in_the_order_of_the_wire() {
    let shown = |envelope_rep| {
        let octets = encoded("string", &["--envelope", envelope_rep], &letter());
        let raw = decoded(&["--raw"], &octets).remove(0);
        // They are written as they are shown.
        let again = encoded("string", &["--envelope", envelope_rep], &raw);
        assert_eq!(again, octets);
        let layers = raw["layers"].as_array().unwrap().iter();
        let stamps = layers.map(|layer| layer["received"][0]["by"].clone());
        stamps.collect::<Vec<_>>()
    };
    let (first, second) = (json!("first"), json!("second"));
    assert_eq!(
        shown("bit-efficient"),
        [second.clone(), first.clone(), Value::Null]
    );
    assert_eq!(shown("xml"), [Value::Null, first, second]);
}

#[test]
fn numbers_of_layers_decide_about_their_order() {
    let layer =
        |index: u8| format!("<params index=\"{index}\"><comments>{index}</comments></params>");
    let octets = format!(
        "<envelope>{}{}{}</envelope>(inform)",
        layer(10),
        layer(9),
        layer(2)
    );
    let raw = &decoded(&["--raw"], octets.as_bytes())[0];
    let comments: Vec<_> = raw["layers"].as_array().unwrap().iter().collect();
    assert_eq!(
        comments,
        [
            &json!({"comments": "2"}),
            &json!({"comments": "9"}),
            &json!({"comments": "10"})
        ]
    );
    assert_eq!(raw["envelope"], json!({"comments": "10"}));
}

#[test]
fn a_letter_that_does_not_name_its_representation_is_read_as_what_it_looks_like() {
    for rep in REPS {
        let payload = encoded(rep, &[], &message());
        let octets = [
            b"<envelope><params index=\"1\"/></envelope>\n",
            &payload[..],
        ]
        .concat();
        if rep == "bit-efficient" {
            // White space is not skipped in front of it.
            assert_eq!(decoded(&[], &octets)[0].get("message"), None);
            continue;
        }
        assert_eq!(decoded(&[], &octets)[0]["message"], message(), "{rep}");
    }
}

#[test]
fn a_letter_without_a_length_takes_the_rest_of_the_input() {
    let envelope = "<envelope><params index=\"1\"/></envelope>";
    let alone = format!("{envelope}(inform)\r\n");
    assert_eq!(
        decoded(&[], alone.as_bytes())[0]["message"],
        json!({"performative": "inform"})
    );
    let (_, result) = decode(&[], format!("{alone}(inform)").as_bytes());
    let line = format!(
        "octet {}: something follows the message (malformed)",
        alone.len()
    );
    assert_eq!(failure(result), (2, line));
}

#[test]
fn an_envelope_alone_has_an_empty_payload() {
    let octets = b"<envelope><params index=\"1\"/></envelope>\n";
    let json = json!({"envelope": {}, "payload": {"base64": ""}});
    assert_eq!(decoded(&[], octets.trim_ascii_end()), [json]);
    let (_, result) = decode(&["--as", "xml"], octets);
    assert_eq!(failure(result).0, 2);
}

#[test]
fn what_a_representation_cannot_hold_says_where() {
    for (rep, parameter, value) in [
        ("string", "performative", "my-act"),
        ("xml", "performative", "my-act"),
        ("xml", "language", "\u{1}"),
        ("string", "protocol", "two words"),
    ] {
        let mut message = json!({"performative": "inform"});
        message[parameter] = value.into();
        let (octets, result) = encode_as(rep, &[], &format!("\n {message}"));
        assert_eq!(octets, b"");
        let (code, line) = failure(result);
        assert_eq!(code, 2);
        assert!(line.starts_with(&format!("2:2: {parameter}: ")), "{line}");
    }
}

#[test]
fn utf_16_is_read_as_xml() {
    let text = String::from_utf8(encoded("xml", &[], &message())).unwrap();
    let wide = |text: &str| -> Vec<u8> {
        let units = std::iter::once(0xfeff).chain(text.encode_utf16());
        units.flat_map(u16::to_be_bytes).collect()
    };
    let two = [wide(&format!("{text}\r\n")), MESSAGE.to_vec()].concat();
    let bare: Value = serde_json::from_str(MESSAGE_JSON).unwrap();
    assert_eq!(decoded(&[], &two), [message(), bare]);
}
