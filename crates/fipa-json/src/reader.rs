use serde_json::{Map, Value};

use crate::JsonError;

/// A JSON object of which only known keys are read.
pub(crate) struct Fields<'a>(&'a Map<String, Value>);

impl<'a> Fields<'a> {
    /// The object that `value` is; an error if it is none or holds a key that is not `known`.
    pub(crate) fn new(value: &'a Value, known: &[&str]) -> Result<Fields<'a>, JsonError> {
        let object = object(value)?;
        match object.keys().find(|key| !known.contains(&key.as_str())) {
            Some(key) => Err(JsonError::new("unknown key").under(key)),
            None => Ok(Fields(object)),
        }
    }

    /// Whether the key is there.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.0.contains_key(key)
    }

    /// What is read from the value under `key`, if the key is there.
    pub(crate) fn optional<T>(
        &self,
        key: &str,
        read: impl FnOnce(&'a Value) -> Result<T, JsonError>,
    ) -> Result<Option<T>, JsonError> {
        self.0
            .get(key)
            .map(|value| read(value).map_err(|error| error.under(key)))
            .transpose()
    }

    /// What is read from the value under `key`, which must be there.
    pub(crate) fn required<T>(
        &self,
        key: &str,
        read: impl FnOnce(&'a Value) -> Result<T, JsonError>,
    ) -> Result<T, JsonError> {
        self.optional(key, read)?
            .ok_or_else(|| JsonError::new("missing").under(key))
    }

    /// What is read from the elements of the array under `key`; nothing if the key is absent.
    pub(crate) fn list<T>(
        &self,
        key: &str,
        read: impl Fn(&'a Value) -> Result<T, JsonError>,
    ) -> Result<Vec<T>, JsonError> {
        let elements = self.optional(key, |value| {
            value
                .as_array()
                .ok_or_else(|| JsonError::expected("an array"))
        })?;
        elements
            .into_iter()
            .flatten()
            .enumerate()
            .map(|(index, value)| read(value).map_err(|error| error.at(index).under(key)))
            .collect()
    }
}

/// The object that `value` is.
pub(crate) fn object(value: &Value) -> Result<&Map<String, Value>, JsonError> {
    value
        .as_object()
        .ok_or_else(|| JsonError::expected("an object"))
}
