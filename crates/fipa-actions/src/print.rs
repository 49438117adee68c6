//! Contents as text, in the form that the parser takes.

use std::fmt::{Display, Formatter, Result, Write};

use crate::content::{Action, Content, Name, Number, Signature, Task, Value};

impl Display for Content {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Content::Do(action) => write!(f, "do {action}"),
            Content::AskActions(None) => f.write_str("actions?"),
            Content::AskActions(Some(name)) => write!(f, "actions? {name}"),
            Content::AskStatus(None) => f.write_str("status?"),
            Content::AskStatus(Some(number)) => write!(f, "status? {number}"),
            Content::Actions(signatures) => {
                f.write_str("actions")?;
                signatures.iter().try_for_each(|one| write!(f, "\n  {one}"))
            }
            Content::Status(tasks) => {
                f.write_str("status")?;
                tasks.iter().try_for_each(|one| write!(f, "\n  {one}"))
            }
        }
    }
}

impl Display for Action {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        call(f, &self.name, &self.arguments)
    }
}

impl Display for Signature {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        call(f, &self.name, &self.parameters)?;
        if self.description.is_empty() {
            return Ok(());
        }
        f.write_char(' ')?;
        string(f, &self.description)
    }
}

impl Display for Task {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "{} {} ", self.number, self.state)?;
        if let Some(percent) = self.percent {
            write!(f, "{percent}% ")?;
        }
        self.action.fmt(f)
    }
}

impl Display for Value {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Value::Number(number) => number.fmt(f),
            Value::Truth(truth) => write!(f, "{truth}"),
            Value::Text(text) if is_bare(text) => f.write_str(text),
            Value::Text(text) => string(f, text),
        }
    }
}

impl Display for Number {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        // Without an exponent, and exact.
        write!(f, "{}", self.get())
    }
}

/// Whether a text can stand without quotes.
fn is_bare(text: &str) -> bool {
    !matches!(text, "true" | "false") && Name::new(text).is_ok()
}

fn call<T: Display>(f: &mut Formatter<'_>, name: &Name, parts: &[(Name, T)]) -> Result {
    write!(f, "{name}(")?;
    for (place, (name, part)) in parts.iter().enumerate() {
        let before = if place > 0 { ", " } else { "" };
        write!(f, "{before}{name}: {part}")?;
    }
    f.write_char(')')
}

fn string(f: &mut Formatter<'_>, text: &str) -> Result {
    f.write_char('"')?;
    for c in text.chars() {
        match c {
            '"' => f.write_str("\\\"")?,
            '\\' => f.write_str("\\\\")?,
            '\n' => f.write_str("\\n")?,
            c => f.write_char(c)?,
        }
    }
    f.write_char('"')
}
