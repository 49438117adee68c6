use regex::{Regex, RegexBuilder};
use regex_syntax::hir::{Class, Hir, HirKind};

use crate::Record;

/// A regular expression that must match all of a field. Its time grows with the length of what it
/// is matched against, whatever the pattern, and the work of compiling it is bounded.
#[derive(Clone, Debug)]
pub struct Pattern {
    regex: Regex,
    cost: u32,
}

/// Octets of the longest pattern.
const MAX_PATTERN: usize = 4096;

/// The text is no regular expression, is too long, or its compiled form is too large.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct PatternError {
    reason: String,
    cost: u32,
}

impl PatternError {
    /// What it has cost to find that out, as [`Pattern::cost`] counts.
    pub fn cost(&self) -> u32 {
        self.cost
    }
}

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

/// The highest cost of a pattern: some milliseconds.
const MAX_COST: u32 = 16 << 10;

impl Pattern {
    /// Compiles a pattern; it is anchored at both ends.
    pub fn new(text: &str) -> Result<Pattern, PatternError> {
        if text.len() > MAX_PATTERN {
            let reason = format!("a pattern has {MAX_PATTERN} octets at most");
            return Err(PatternError { reason, cost: 1 });
        }
        let cost = text.len() as u32;
        let too_large = |cost| PatternError {
            reason: format!("the pattern {text:?} is too large"),
            cost,
        };
        let none = |why: &dyn std::fmt::Display| PatternError {
            reason: format!("{text:?} is no regular expression: {why}"),
            cost,
        };
        // It must be a whole by itself: `a)|(b` would break out of the anchors. What is too large is
        // found here, before it has been work.
        let read = regex_syntax::parse(text).map_err(|error| match error {
            regex_syntax::Error::Parse(error) => none(error.kind()),
            regex_syntax::Error::Translate(error) => none(error.kind()),
            error => none(&error),
        })?;
        let real = cost_of(&read).max(cost);
        if real > MAX_COST {
            return Err(too_large(cost));
        }
        let regex = RegexBuilder::new(&format!("^(?:{text})$"))
            .size_limit(MAX_COMPILED)
            .dfa_size_limit(MAX_COMPILED)
            .build()
            .map_err(|error| match error {
                regex::Error::CompiledTooBig(_) => too_large(real),
                // A comment that it ends with goes on behind it.
                _ => none(&"it has no end"),
            })?;
        Ok(Pattern { regex, cost: real })
    }

    /// What compiling it has cost, in the work that one character to match costs, or one range of
    /// characters: less than half a microsecond on a laptop. It is not less than the pattern is long.
    pub fn cost(&self) -> u32 {
        self.cost
    }

    /// Whether all of the text matches.
    pub fn matches(&self, text: &str) -> bool {
        self.regex.is_match(text)
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

/// What it costs to compile an expression: repetitions are written out.
fn cost_of(read: &Hir) -> u32 {
    let all = |subs: &[Hir]| subs.iter().map(cost_of).fold(1, u32::saturating_add);
    match read.kind() {
        HirKind::Empty | HirKind::Look(_) => 1,
        HirKind::Literal(literal) => literal.0.len() as u32,
        HirKind::Class(Class::Unicode(class)) => {
            let ranges = class.ranges().iter();
            // One over several lengths of UTF-8 becomes a range for each octet of each.
            let cost = ranges.map(|r| 1 + 6 * (r.end().len_utf8() - r.start().len_utf8()) as u32);
            cost.sum()
        }
        HirKind::Class(Class::Bytes(class)) => class.ranges().len() as u32,
        HirKind::Repetition(repetition) => {
            let times = repetition.max.unwrap_or(repetition.min).max(1);
            cost_of(&repetition.sub).saturating_mul(times)
        }
        HirKind::Capture(capture) => cost_of(&capture.sub).saturating_add(1),
        HirKind::Concat(subs) | HirKind::Alternation(subs) => all(subs),
    }
}
