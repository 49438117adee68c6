use std::fmt;

/// A JSON value that is not of the form it should have: where, and what was expected there.
///
/// ```
/// let json = serde_json::json!({"performative": "inform", "receiver": [{"name": 7}]});
/// let error = fipa_json::message_from_json(&json).unwrap_err();
/// assert_eq!(error.to_string(), "receiver[0].name: expected a string");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct JsonError {
    path: String,
    problem: String,
}

impl JsonError {
    /// The path of keys to the value, such as `receiver[0].name`; empty for the whole value.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// What was expected there, or what is wrong.
    pub fn problem(&self) -> &str {
        &self.problem
    }

    pub(crate) fn new(problem: impl Into<String>) -> JsonError {
        JsonError {
            path: String::new(),
            problem: problem.into(),
        }
    }

    pub(crate) fn expected(what: &str) -> JsonError {
        JsonError::new(format!("expected {what}"))
    }

    /// The same problem, seen from the object that holds the value under `key`.
    pub(crate) fn under(mut self, key: &str) -> JsonError {
        // Keys come from outside, and the error must stay on one line.
        self.prefix(&key.escape_debug().to_string());
        self
    }

    /// The same problem, seen from the array that holds the value at `index`.
    pub(crate) fn at(mut self, index: usize) -> JsonError {
        self.prefix(&format!("[{index}]"));
        self
    }

    fn prefix(&mut self, step: &str) {
        let dot = match self.path.as_bytes().first() {
            None | Some(b'[') => "",
            Some(_) => ".",
        };
        self.path = format!("{step}{dot}{}", self.path);
    }
}

impl fmt::Display for JsonError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.path.is_empty() {
            f.write_str(&self.problem)
        } else {
            write!(f, "{}: {}", self.path, self.problem)
        }
    }
}
