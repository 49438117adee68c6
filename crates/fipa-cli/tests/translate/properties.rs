//! What holds for all messages.

use fipa_acl::{FipaTime, Performative};
use fipa_codec::arbitrary;
use fipa_json::{message_from_json, message_to_json};
use proptest::prelude::*;
use serde_json::{Map, Value, json};

use crate::{decoded, encoded};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_message_is_the_same_in_every_form(mut message in arbitrary::message()) {
        // In JSON, hours are carried over into days, of which there can be 99.
        if let Some(FipaTime::Relative(span)) = &mut message.reply_by {
            span.days = span.days.min(95);
        }
        let json = message_to_json(&message);
        for rep in ["bit-efficient", "xml", "string"] {
            let expected = normal(&expressible(normal(&json), rep));
            let octets = encoded(rep, &[], &expected);
            let shown = decoded(&[], &octets);
            prop_assert_eq!(shown.len(), 1);
            // As messages: within lists, a form may write as a string what was a word.
            prop_assert_eq!(
                message_from_json(&shown[0]).unwrap(),
                message_from_json(&expected).unwrap(),
                "{}", rep
            );
            let again = encoded(rep, &[], &shown[0]);
            prop_assert_eq!(again, octets, "{}", rep);
        }
    }
}

/// The message as it is shown: what stands for the same in JSON is read as the same, whichever way
/// it is written.
fn normal(message: &Value) -> Value {
    message_to_json(&message_from_json(message).unwrap())
}

/// The message without what the representation cannot express:
///
/// * only the bit-efficient form has acts outside the standard;
/// * in string form no name of a parameter has a character that begins a value;
/// * XML has no control characters but in contents, and no empty values but in user-defined
///   parameters.
fn expressible(mut message: Value, rep: &str) -> Value {
    if rep == "bit-efficient" {
        return message;
    }
    let act = message["performative"].as_str().unwrap();
    if Performative::standard(act).is_none() {
        message["performative"] = "inform".into();
    }
    if rep == "string" {
        rename(&mut message);
    } else {
        legalise(&mut message);
    }
    message
}

/// Gives the user-defined parameters of a message and its agents names for the string form.
fn rename(value: &mut Value) {
    match value {
        Value::Array(values) => values.iter_mut().for_each(rename),
        Value::Object(fields) => {
            for (key, value) in fields.iter_mut() {
                match (key.as_str(), value) {
                    ("user-defined", Value::Object(named)) => *named = renamed(named),
                    (_, value) => rename(value),
                }
            }
        }
        _ => {}
    }
}

fn renamed(parameters: &Map<String, Value>) -> Map<String, Value> {
    parameters
        .iter()
        .map(|(name, value)| (name.replace(['#', '"', ':'], "_"), value.clone()))
        .collect()
}

/// Takes out of a message and its agents what XML does not allow.
fn legalise(value: &mut Value) {
    match value {
        Value::String(text) => text.retain(is_legal),
        Value::Array(values) => values.iter_mut().for_each(legalise),
        Value::Object(fields) => {
            for (key, value) in fields.iter_mut() {
                if key != "content" {
                    legalise(value);
                }
            }
            fields.retain(|key, value| key.starts_with("X-") || *value != json!(""));
        }
        _ => {}
    }
}

fn is_legal(character: char) -> bool {
    !matches!(character, '\0'..='\u{1f}' | '\u{fffe}' | '\u{ffff}')
        || matches!(character, '\t' | '\r' | '\n')
}
