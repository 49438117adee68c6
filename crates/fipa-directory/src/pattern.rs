use regex::{Regex, RegexBuilder};

use crate::Record;

/// A regular expression that must match all of a field. Its time grows with the length of what it
/// is matched against, whatever the pattern, and its compiled size is bounded.
#[derive(Clone, Debug)]
pub struct Pattern(Regex);

/// Octets of the longest pattern.
const MAX_PATTERN: usize = 4096;

/// The text is no regular expression, is too long, or its compiled form is too large.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PatternError(String);

/// The field of an entry that a search looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Field {
    /// The agent's name.
    #[default]
    Name,
    /// The service type.
    Type,
    /// The description.
    Description,
    /// The address of any location.
    Location,
}

/// Octets of a compiled pattern; enough for any alternation of names that fits a message line.
const MAX_COMPILED: usize = 1 << 20;

impl Pattern {
    /// Compiles a pattern; it is anchored at both ends.
    pub fn new(text: &str) -> Result<Pattern, PatternError> {
        let compile = |pattern: &str| {
            RegexBuilder::new(pattern)
                .size_limit(MAX_COMPILED)
                .dfa_size_limit(MAX_COMPILED)
                .build()
                .map_err(|error| PatternError(describe(text, &error)))
        };
        if text.len() > MAX_PATTERN {
            let reason = format!("a pattern has {MAX_PATTERN} octets at most");
            return Err(PatternError(reason));
        }
        // It must be a whole by itself: `a)|(b` would break out of the anchors.
        compile(text)?;
        compile(&format!("^(?:{text})$")).map(Pattern)
    }

    /// Whether all of the text matches.
    pub fn matches(&self, text: &str) -> bool {
        self.0.is_match(text)
    }

    /// Whether the field of the record matches.
    pub fn matches_field(&self, record: &Record, field: Field) -> bool {
        let entry = &record.entry;
        match field {
            Field::Name => self.matches(&entry.name),
            Field::Type => self.matches(&entry.kind),
            Field::Description => self.matches(&entry.description),
            Field::Location => entry.locations.iter().any(|l| self.matches(&l.address)),
        }
    }
}

/// One line; the crate's own syntax errors draw a picture over several.
fn describe(text: &str, error: &regex::Error) -> String {
    match error {
        regex::Error::CompiledTooBig(_) => format!("the pattern {text:?} is too large"),
        error => {
            let shown = error.to_string();
            let last = shown.lines().last().unwrap_or_default();
            let why = last.trim_start_matches("error: ");
            format!("{text:?} is no regular expression: {why}")
        }
    }
}
