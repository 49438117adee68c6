//! Sequence charts: who says what to whom, from top to bottom.
//!
//! **Knows** lifelines, arrows and notes, and how they are laid out as text and as SVG. **Never
//! knows** where they come from: a log, a protocol or a test.

mod svg;
mod text;

pub use svg::to_svg;
pub use text::to_text;

/// A sequence chart. Its lifelines stand in the order in which they appear.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Chart {
    /// What it shows, in one line.
    pub title: String,
    /// What happens, the earliest first.
    pub steps: Vec<Step>,
}

/// Something in a chart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// A message.
    Arrow(Arrow),
    /// A remark across all lifelines.
    Note(String),
}

/// A message from one lifeline to another, or to itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Arrow {
    /// When, in few letters; may be empty.
    pub at: String,
    /// Whose it is.
    pub from: String,
    /// Whom it is for.
    pub to: String,
    /// What it says, in one line.
    pub label: String,
    /// Why it did not arrive.
    pub failure: Option<String>,
    /// What else there is to say about it.
    pub annotation: Option<Annotation>,
}

/// What a protocol has to say about a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Annotation {
    /// The state that is reached, or the rule that is violated.
    pub text: String,
    /// Whether the message is against the rules.
    pub violation: bool,
}

impl Chart {
    /// The names of the lifelines.
    fn lifelines(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for arrow in self.arrows() {
            for name in [arrow.from.as_str(), arrow.to.as_str()] {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
        }
        names
    }

    pub(crate) fn arrows(&self) -> impl Iterator<Item = &Arrow> {
        self.steps.iter().filter_map(|step| match step {
            Step::Arrow(arrow) => Some(arrow),
            Step::Note(_) => None,
        })
    }
}

impl Arrow {
    /// Whether it did not arrive or is against the rules.
    pub(crate) fn is_bad(&self) -> bool {
        self.failure.is_some() || self.annotation.as_ref().is_some_and(|a| a.violation)
    }

    /// What stands below it, broken into lines, and whether that is bad.
    fn remarks(&self, width: usize) -> Vec<(String, bool)> {
        let failure = self.failure.as_ref().map(|why| (format!("✗ {why}"), true));
        let annotation = self.annotation.as_ref().map(|annotation| {
            let mark = if annotation.violation { "✗" } else { "·" };
            (format!("{mark} {}", annotation.text), annotation.violation)
        });
        let both = failure.into_iter().chain(annotation);
        both.flat_map(|(text, bad)| wrapped(&text, width).into_iter().map(move |l| (l, bad)))
            .collect()
    }
}

/// How many letters a text has.
fn width(text: &str) -> usize {
    text.chars().count()
}

/// The beginning of a text, in one line of visible letters.
pub(crate) fn shortened(text: &str, width: usize) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let line = words.join(" ").replace(char::is_control, "?");
    match line.char_indices().nth(width) {
        None => line,
        Some(_) => {
            let kept: String = line.chars().take(width.saturating_sub(1)).collect();
            kept + "…"
        }
    }
}

/// A text in lines of so many letters at most.
fn wrapped(text: &str, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let word = shortened(word, most);
        match lines.last_mut() {
            Some(line) if width(line) + 1 + width(&word) <= most => {
                line.push(' ');
                line.push_str(&word);
            }
            _ => lines.push(word),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_shortened_to_letters_that_can_be_seen() {
        assert_eq!(shortened("go to\n  the\u{7} dock", 40), "go to the? dock");
        assert_eq!(shortened("größer", 6), "größer");
        assert_eq!(shortened("größere", 6), "größe…");
        assert_eq!(shortened("", 6), "");
    }

    #[test]
    fn a_text_is_broken_between_words() {
        assert_eq!(wrapped("one two three", 7), ["one two", "three"]);
        assert_eq!(wrapped("a verylongword b", 5), ["a", "very…", "b"]);
        assert_eq!(wrapped("", 5), [""; 0]);
    }
}
