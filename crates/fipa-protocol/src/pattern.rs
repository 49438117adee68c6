use regex::{Regex, RegexBuilder};

/// A regular expression that must match all of a text. Its time grows with the length of the text,
/// whatever the expression, and its compiled size is bounded.
#[derive(Clone, Debug)]
pub struct Pattern(Regex);

/// The text is no regular expression, or its compiled form is too large.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PatternError(String);

impl Pattern {
    /// Compiles an expression; at most so many octets of it.
    ///
    /// # Errors
    /// It is none, uses what takes more than linear time, or is too large.
    pub fn new(text: &str, max_octets: usize) -> Result<Pattern, PatternError> {
        let compile = |pattern: &str| {
            RegexBuilder::new(pattern)
                .size_limit(max_octets)
                .dfa_size_limit(max_octets)
                .build()
                .map_err(|error| PatternError(describe(text, &error)))
        };
        // It must be a whole by itself: `a)|(b` would break out of the anchors.
        compile(text)?;
        compile(&format!("^(?:{text})$")).map(Pattern)
    }

    /// Whether all of the text matches.
    pub fn matches(&self, text: &str) -> bool {
        self.0.is_match(text)
    }

    /// Whether the text is more than a name: names hold dots, and few other signs of expressions.
    pub fn is_meant(text: &str) -> bool {
        text.contains(['*', '+', '|', '[', '\\', '^', '$', '{'])
    }
}

/// One line; the crate's own syntax errors draw a picture over several.
fn describe(text: &str, error: &regex::Error) -> String {
    match error {
        regex::Error::CompiledTooBig(_) => format!("the expression {text:?} is too large"),
        error => {
            let shown = error.to_string();
            let last = shown.lines().last().unwrap_or_default();
            let why = last.trim_start_matches("error: ");
            format!("{text:?} is no regular expression: {why}")
        }
    }
}
