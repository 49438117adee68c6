//! The parts of a text: names, numbers, strings and signs, each with its place.

use crate::content::is_of_name;
use crate::parser::ParseError;

/// A part of the text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Token<'a> {
    Name(&'a str),
    Number(&'a str),
    Text(String),
    Sign(char),
    End,
}

/// Reads one part after the other.
pub(crate) struct Scanner<'a> {
    rest: &'a str,
    line: usize,
    column: usize,
}

impl<'a> Scanner<'a> {
    pub(crate) fn new(text: &'a str) -> Scanner<'a> {
        Scanner {
            rest: text,
            line: 1,
            column: 1,
        }
    }

    /// The next part, and where it begins.
    pub(crate) fn next(&mut self) -> Result<(Token<'a>, usize, usize), ParseError> {
        self.skip(|c| matches!(c, ' ' | '\t' | '\r' | '\n'));
        let (line, column) = (self.line, self.column);
        let token = match self.rest.chars().next() {
            None => Token::End,
            Some('"') => Token::Text(self.string()?),
            Some(c) if c.is_ascii_alphabetic() => Token::Name(self.skip(is_of_name)),
            Some(c) if c.is_ascii_digit() || c == '-' => {
                Token::Number(self.skip(|c| c.is_ascii_digit() || matches!(c, '-' | '.')))
            }
            Some(c) => {
                self.take();
                Token::Sign(c)
            }
        };
        Ok((token, line, column))
    }

    /// The text between quotes.
    fn string(&mut self) -> Result<String, ParseError> {
        let unended = ParseError::new(self.line, self.column, "this text has no closing quote");
        self.take();
        let mut text = String::new();
        loop {
            let (line, column) = (self.line, self.column);
            match self.take() {
                None => return Err(unended),
                Some('"') => return Ok(text),
                Some('\\') => text.push(match self.take() {
                    Some(c @ ('"' | '\\')) => c,
                    Some('n') => '\n',
                    _ => {
                        let what = "after \\ there must be \", \\ or n";
                        return Err(ParseError::new(line, column, what));
                    }
                }),
                Some(c) => text.push(c),
            }
        }
    }

    fn take(&mut self) -> Option<char> {
        let mut chars = self.rest.chars();
        let c = chars.next()?;
        self.rest = chars.as_str();
        match c {
            '\n' => (self.line, self.column) = (self.line + 1, 1),
            _ => self.column += 1,
        }
        Some(c)
    }

    fn skip(&mut self, is_part: impl Fn(char) -> bool) -> &'a str {
        let start = self.rest;
        while self.rest.starts_with(&is_part) {
            self.take();
        }
        start.strip_suffix(self.rest).unwrap_or_default()
    }
}
