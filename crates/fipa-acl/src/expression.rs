use std::fmt;
use std::hash::{Hash, Hasher};

use crate::Text;
use crate::text::is_word;

/// An expression of FIPA SC00070I: a word, string or number, or a list of expressions.
///
/// Peers choose freely between word and string for the same value, so two expressions are equal
/// when they have the same structure and the same text.
///
/// ```
/// use fipa_acl::Expression;
///
/// let tag = Expression::from("(a \"b c\" (1))");
/// assert!(matches!(&tag, Expression::List(items) if items.len() == 3));
/// assert_eq!(tag.to_string(), "(a \"b c\" (1))");
/// assert_eq!(Expression::Word("a".into()), Expression::String("a".into()));
/// ```
#[derive(Clone, Debug)]
pub enum Expression {
    /// A word: no blank, no parenthesis; not beginning with `#`, `-`, `@` or a digit.
    Word(Text),
    /// A string: any text.
    String(Text),
    /// A number as its text, such as `42` or `-1.5E3`.
    Number(Text),
    /// `( … )`.
    List(Vec<Expression>),
}

/// The text is not one parenthesised expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not one parenthesised expression")]
pub struct ParseExpressionError;

/// Lists within lists that [`Expression::parse_list`] follows; what is deeper is a string.
const MAX_DEPTH: usize = 64;

impl Expression {
    /// The text of a word, string or number; `None` for a list.
    pub fn as_str(&self) -> Option<&str> {
        match self {
            Expression::Word(text) | Expression::String(text) | Expression::Number(text) => {
                Some(text)
            }
            Expression::List(_) => None,
        }
    }

    /// Reads one parenthesised expression in string notation; all of the text must belong to it.
    pub fn parse_list(text: &str) -> Result<Expression, ParseExpressionError> {
        let mut parser = Parser {
            rest: text.as_bytes(),
        };
        if !text.starts_with('(') {
            return Err(ParseExpressionError);
        }
        let list = parser.expression(0)?;
        match parser.rest {
            [] => Ok(list),
            _ => Err(ParseExpressionError),
        }
    }

    fn fmt_nested(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Expression::Word(text) | Expression::Number(text) => f.write_str(text),
            Expression::String(text) => fmt_string(text, f),
            Expression::List(items) => {
                f.write_str("(")?;
                for (i, item) in items.iter().enumerate() {
                    if i > 0 {
                        f.write_str(" ")?;
                    }
                    item.fmt_nested(f)?;
                }
                f.write_str(")")
            }
        }
    }
}

/// A string literal, or `#n"…` where a literal cannot hold the text (a trailing backslash, or one
/// in front of a quote).
fn fmt_string(text: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    if text.ends_with('\\') || text.contains("\\\"") {
        write!(f, "#{}\"{}", text.len(), text)
    } else {
        write!(f, "\"{}\"", text.replace('"', "\\\""))
    }
}

impl PartialEq for Expression {
    fn eq(&self, other: &Expression) -> bool {
        match (self, other) {
            (Expression::List(a), Expression::List(b)) => a == b,
            (a, b) => a.as_str().is_some() && a.as_str() == b.as_str(),
        }
    }
}

impl Eq for Expression {}

impl Hash for Expression {
    fn hash<H: Hasher>(&self, state: &mut H) {
        match self {
            Expression::List(items) => items.hash(state),
            other => other.as_str().hash(state),
        }
    }
}

impl fmt::Display for Expression {
    /// A word, string or number as its bare text; a list in string notation.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.as_str() {
            Some(text) => f.pad(text),
            None => self.fmt_nested(f),
        }
    }
}

impl From<Text> for Expression {
    /// The expression that this text stands for: a list if all of it is one parenthesised
    /// expression, else a word if it is a legal one, else a string.
    fn from(text: Text) -> Expression {
        if let Ok(list) = Expression::parse_list(&text) {
            list
        } else if text.is_word() {
            Expression::Word(text)
        } else {
            Expression::String(text)
        }
    }
}

impl From<&str> for Expression {
    fn from(text: &str) -> Expression {
        Expression::from(Text::from(text))
    }
}

impl From<String> for Expression {
    fn from(text: String) -> Expression {
        Expression::from(Text::from(text))
    }
}

struct Parser<'a> {
    rest: &'a [u8],
}

impl Parser<'_> {
    fn expression(&mut self, depth: usize) -> Result<Expression, ParseExpressionError> {
        match self.rest.first() {
            Some(b'(') if depth < MAX_DEPTH => {
                self.rest = &self.rest[1..];
                self.list(depth)
            }
            Some(b'"') => self.literal(),
            Some(b'#') => self.byte_length_string(),
            _ => self.token(),
        }
    }

    fn list(&mut self, depth: usize) -> Result<Expression, ParseExpressionError> {
        let mut items = Vec::new();
        loop {
            self.rest = self.rest.trim_ascii_start();
            match self.rest.first() {
                None => return Err(ParseExpressionError),
                Some(b')') => {
                    self.rest = &self.rest[1..];
                    return Ok(Expression::List(items));
                }
                Some(_) => items.push(self.expression(depth + 1)?),
            }
        }
    }

    fn literal(&mut self) -> Result<Expression, ParseExpressionError> {
        let mut text = Vec::new();
        let mut at = 1;
        loop {
            match self.rest.get(at..).unwrap_or_default() {
                [] => return Err(ParseExpressionError),
                [b'\\', b'"', ..] => {
                    text.push(b'"');
                    at += 2;
                }
                [b'"', ..] => {
                    self.rest = &self.rest[at + 1..];
                    return string(text);
                }
                [octet, ..] => {
                    text.push(*octet);
                    at += 1;
                }
            }
        }
    }

    fn byte_length_string(&mut self) -> Result<Expression, ParseExpressionError> {
        let digits = self.rest[1..].iter().take_while(|b| b.is_ascii_digit());
        let digits = digits.count();
        let count: usize = std::str::from_utf8(&self.rest[1..=digits])
            .ok()
            .and_then(|text| text.parse().ok())
            .ok_or(ParseExpressionError)?;
        let body = self.rest[1 + digits..]
            .strip_prefix(b"\"")
            .ok_or(ParseExpressionError)?;
        let text = body.get(..count).ok_or(ParseExpressionError)?.to_vec();
        self.rest = &body[count..];
        string(text)
    }

    fn token(&mut self) -> Result<Expression, ParseExpressionError> {
        let end = self
            .rest
            .iter()
            .position(|b| b.is_ascii_whitespace() || matches!(b, b'(' | b')'))
            .unwrap_or(self.rest.len());
        let (token, rest) = self.rest.split_at(end);
        self.rest = rest;
        // Words and numbers are ASCII.
        let text = || Text::from(String::from_utf8_lossy(token).into_owned());
        if is_number(token) {
            Ok(Expression::Number(text()))
        } else if is_word(token) {
            Ok(Expression::Word(text()))
        } else {
            Err(ParseExpressionError)
        }
    }
}

fn string(octets: Vec<u8>) -> Result<Expression, ParseExpressionError> {
    String::from_utf8(octets)
        .map(|text| Expression::String(text.into()))
        .map_err(|_| ParseExpressionError)
}

/// Number of SC00070I: `[+-] digits [. digits] [e [+-] digits]`, with a digit on one side of the
/// point at least.
fn is_number(token: &[u8]) -> bool {
    fn unsigned(text: &[u8]) -> &[u8] {
        text.strip_prefix(b"-")
            .or(text.strip_prefix(b"+"))
            .unwrap_or(text)
    }
    let digits = |text: &[u8]| text.iter().all(u8::is_ascii_digit);
    let mut parts = unsigned(token).splitn(2, |b| matches!(b, b'e' | b'E'));
    let mantissa = parts.next().unwrap_or_default();
    let mantissa_ok = match mantissa.iter().position(|b| *b == b'.') {
        Some(point) => {
            mantissa.len() > 1 && digits(&mantissa[..point]) && digits(&mantissa[point + 1..])
        }
        None => !mantissa.is_empty() && digits(mantissa),
    };
    mantissa_ok
        && parts
            .next()
            .map(unsigned)
            .is_none_or(|exponent| !exponent.is_empty() && digits(exponent))
}
