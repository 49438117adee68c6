//! The forms of single values: text, octets, dates, user-defined parameters.

use std::collections::HashMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bytes::Bytes;
use fipa_acl::{Expression, FipaTime, Text, canonical_user_name};
use serde_json::{Map, Value, json};

use crate::JsonError;
use crate::reader::{Fields, object};

/// Octets as a string when they are UTF-8, else in base64.
pub(crate) fn octets_to_json(octets: &[u8]) -> Value {
    match std::str::from_utf8(octets) {
        Ok(text) => text.into(),
        Err(_) => base64_to_json(octets),
    }
}

/// Octets in base64.
pub(crate) fn base64_to_json(octets: &[u8]) -> Value {
    json!({"base64": STANDARD.encode(octets)})
}

/// Two lower-case digits for each octet.
pub(crate) fn hexadecimal(octets: &[u8]) -> String {
    let digit = |value: u8| char::from(b"0123456789abcdef"[usize::from(value)]);
    let digits = |octet: &u8| [digit(octet >> 4), digit(octet & 15)];
    octets.iter().flat_map(digits).collect()
}

/// User-defined parameters as an object; of a name that is there twice the last value is shown.
pub(crate) fn user_defined_to_json<V: ToString>(
    parameters: impl IntoIterator<Item = (impl AsRef<str>, V)>,
) -> Map<String, Value> {
    parameters
        .into_iter()
        .map(|(name, value)| (format!("X-{}", name.as_ref()), value.to_string().into()))
        .collect()
}

/// A string.
pub(crate) fn text(value: &Value) -> Result<Text, JsonError> {
    value
        .as_str()
        .map(Text::from)
        .ok_or_else(|| JsonError::expected("a string"))
}

/// An expression, from its text.
pub(crate) fn expression(value: &Value) -> Result<Expression, JsonError> {
    text(value).map(Expression::from)
}

/// A date or a span.
pub(crate) fn time(value: &Value) -> Result<FipaTime, JsonError> {
    FipaTime::parse(&text(value)?).map_err(|error| JsonError::new(error.to_string()))
}

/// A count.
pub(crate) fn whole_number(value: &Value) -> Result<u64, JsonError> {
    value
        .as_u64()
        .ok_or_else(|| JsonError::expected("a whole number"))
}

/// True or false.
pub(crate) fn truth(value: &Value) -> Result<bool, JsonError> {
    value
        .as_bool()
        .ok_or_else(|| JsonError::expected("true or false"))
}

/// Octets of two digits each.
pub(crate) fn octets_of_hexadecimal(value: &Value) -> Result<Vec<u8>, JsonError> {
    let digits = text(value)?;
    let digit = |digit: &u8| char::from(*digit).to_digit(16);
    digits
        .as_bytes()
        .chunks(2)
        .map(|pair| match pair {
            [high, low] => Some((digit(high)? << 4 | digit(low)?) as u8),
            _ => None,
        })
        .collect::<Option<_>>()
        .ok_or_else(|| JsonError::expected("two hexadecimal digits for each octet"))
}

/// Octets in either form.
pub(crate) fn octets(value: &Value) -> Result<Bytes, JsonError> {
    match value {
        Value::String(text) => Ok(Bytes::copy_from_slice(text.as_bytes())),
        Value::Object(_) => Fields::new(value, &["base64"])?.required("base64", base64),
        _ => Err(JsonError::expected(
            "a string or an object with the key base64",
        )),
    }
}

fn base64(value: &Value) -> Result<Bytes, JsonError> {
    STANDARD
        .decode(text(value)?.as_str())
        .map(Bytes::from)
        .map_err(|_| JsonError::expected("base64 with its padding"))
}

/// User-defined parameters: names without `X-`, each once, with their last value.
pub(crate) fn user_defined(value: &Value) -> Result<Vec<(Text, Text)>, JsonError> {
    let mut parameters: Vec<(Text, Text)> = Vec::new();
    // `X-a` and `x-a` are two keys in JSON and one name in FIPA.
    let mut places: HashMap<Text, usize> = HashMap::new();
    for (key, value) in object(value)? {
        let name = canonical_user_name(key.into());
        let value = text(value).map_err(|error| error.under(key))?;
        match places.get(&name) {
            Some(place) => parameters[*place].1 = value,
            None => {
                places.insert(name.clone(), parameters.len());
                parameters.push((name, value));
            }
        }
    }
    Ok(parameters)
}
