//! From text to content.

use crate::content::{Action, Content, Kind, Name, Number, Signature, Task, TaskState, Value};
use crate::scanner::{Scanner, Token};

/// How much is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Octets of the text.
    pub max_octets: usize,
    /// Actions or tasks in a list, and arguments of an action.
    pub max_items: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            max_octets: 1 << 16,
            max_items: 1_000,
        }
    }
}

/// Where a text is wrong, and how. Whoever wrote it must mend it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{line}:{column}: {what}")]
pub struct ParseError {
    /// The line, from 1.
    pub line: usize,
    /// The character in the line, from 1.
    pub column: usize,
    /// What is wrong.
    pub what: String,
}

impl ParseError {
    pub(crate) fn new(line: usize, column: usize, what: impl Into<String>) -> ParseError {
        let what = what.into();
        ParseError { line, column, what }
    }
}

/// Reads a content.
///
/// # Errors
/// The text is not of this language, or exceeds the limits.
pub fn parse(text: &str, limits: &Limits) -> Result<Content, ParseError> {
    if text.len() > limits.max_octets {
        let what = format!("the content is longer than {} octets", limits.max_octets);
        return Err(ParseError::new(1, 1, what));
    }
    let mut parser = Parser::new(text, limits.max_items)?;
    let content = parser.content()?;
    match parser.token {
        Token::End => Ok(content),
        _ => Err(parser.expected("the end")),
    }
}

struct Parser<'a> {
    scanner: Scanner<'a>,
    max_items: usize,
    /// What is looked at, and where it begins.
    token: Token<'a>,
    line: usize,
    column: usize,
}

impl<'a> Parser<'a> {
    fn new(text: &'a str, max_items: usize) -> Result<Parser<'a>, ParseError> {
        let mut scanner = Scanner::new(text);
        let (token, line, column) = scanner.next()?;
        Ok(Parser {
            scanner,
            max_items,
            token,
            line,
            column,
        })
    }

    fn content(&mut self) -> Result<Content, ParseError> {
        const FIRST: &str = "do, actions or status";
        let Token::Name(first) = self.token else {
            return Err(self.expected(FIRST));
        };
        if !matches!(first, "do" | "actions" | "status") {
            return Err(self.expected(FIRST));
        }
        self.advance()?;
        if first == "do" {
            return Ok(Content::Do(self.action()?));
        }
        let asks = self.token == Token::Sign('?');
        if asks {
            self.advance()?;
        }
        match (first, asks, self.token == Token::End) {
            ("actions", true, true) => Ok(Content::AskActions(None)),
            ("actions", true, false) => Ok(Content::AskActions(Some(self.name()?))),
            ("actions", false, _) => Ok(Content::Actions(self.list(Parser::signature)?)),
            (_, true, true) => Ok(Content::AskStatus(None)),
            (_, true, false) => Ok(Content::AskStatus(Some(
                self.whole("the number of a task")?,
            ))),
            (_, false, _) => Ok(Content::Status(self.list(Parser::task)?)),
        }
    }

    fn action(&mut self) -> Result<Action, ParseError> {
        let (name, arguments) = self.call(Parser::value)?;
        Ok(Action { name, arguments })
    }

    fn signature(&mut self) -> Result<Signature, ParseError> {
        let (name, parameters) = self.call(Parser::kind)?;
        let mut description = String::new();
        if let Token::Text(text) = &mut self.token {
            description = std::mem::take(text);
            self.advance()?;
        }
        Ok(Signature {
            name,
            parameters,
            description,
        })
    }

    fn task(&mut self) -> Result<Task, ParseError> {
        let number = self.whole("the number of a task")?;
        let state = self.word(&TaskState::ALL.map(|state| (state.as_str(), state)))?;
        let mut percent = None;
        if let Token::Number(_) = self.token {
            let number = self.expected("0 to 100");
            let whole: u8 = self.whole("0 to 100")?;
            percent = Some(whole).filter(|percent| *percent <= 100);
            if percent.is_none() {
                return Err(number);
            }
            self.sign('%')?;
        }
        let action = self.action()?;
        Ok(Task {
            number,
            state,
            percent,
            action,
        })
    }

    fn list<T>(
        &mut self,
        one: impl Fn(&mut Parser<'a>) -> Result<T, ParseError>,
    ) -> Result<Vec<T>, ParseError> {
        let mut list = Vec::new();
        while self.token != Token::End {
            self.make_room(list.len())?;
            list.push(one(self)?);
        }
        Ok(list)
    }

    /// A name, and pairs of a name and a part in parentheses.
    fn call<T>(
        &mut self,
        part: impl Fn(&mut Parser<'a>) -> Result<T, ParseError>,
    ) -> Result<(Name, Vec<(Name, T)>), ParseError> {
        let called = self.name()?;
        self.sign('(')?;
        let mut parts: Vec<(Name, T)> = Vec::new();
        while self.token != Token::Sign(')') {
            if !parts.is_empty() {
                self.sign(',')?;
            }
            self.make_room(parts.len())?;
            let (line, column) = (self.line, self.column);
            let name = self.name()?;
            if parts.iter().any(|(known, _)| *known == name) {
                let what = format!("{name} stands twice");
                return Err(ParseError::new(line, column, what));
            }
            self.sign(':')?;
            parts.push((name, part(self)?));
        }
        self.advance()?;
        Ok((called, parts))
    }

    fn value(&mut self) -> Result<Value, ParseError> {
        let value = match &mut self.token {
            Token::Name("true") => Value::Truth(true),
            Token::Name("false") => Value::Truth(false),
            Token::Name(name) => Value::Text((*name).to_owned()),
            Token::Text(text) => Value::Text(std::mem::take(text)),
            Token::Number(digits) => match number(digits) {
                Some(number) => Value::Number(number),
                None => return Err(self.expected("a number such as -0.5")),
            },
            Token::Sign(_) | Token::End => return Err(self.expected("a value")),
        };
        self.advance()?;
        Ok(value)
    }

    fn kind(&mut self) -> Result<Kind, ParseError> {
        self.word(&Kind::ALL.map(|kind| (kind.as_str(), kind)))
    }

    fn name(&mut self) -> Result<Name, ParseError> {
        let Token::Name(name) = self.token else {
            return Err(self.expected("a name"));
        };
        let name = Name::new(name).map_err(|_| self.expected("a name"))?;
        self.advance()?;
        Ok(name)
    }

    /// One of these words.
    fn word<T: Copy>(&mut self, words: &[(&str, T)]) -> Result<T, ParseError> {
        let found = words
            .iter()
            .find(|(word, _)| self.token == Token::Name(word));
        let Some((_, meaning)) = found else {
            let words: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
            return Err(self.expected(&words.join(" or ")));
        };
        self.advance()?;
        Ok(*meaning)
    }

    fn whole<T: std::str::FromStr>(&mut self, what: &str) -> Result<T, ParseError> {
        let Token::Number(digits) = self.token else {
            return Err(self.expected(what));
        };
        let number = digits.parse().map_err(|_| self.expected(what))?;
        self.advance()?;
        Ok(number)
    }

    fn sign(&mut self, sign: char) -> Result<(), ParseError> {
        if self.token != Token::Sign(sign) {
            return Err(self.expected(&format!("\"{sign}\"")));
        }
        self.advance()
    }

    fn make_room(&self, taken: usize) -> Result<(), ParseError> {
        if taken < self.max_items {
            return Ok(());
        }
        let what = format!("there are more than {}", self.max_items);
        Err(ParseError::new(self.line, self.column, what))
    }

    fn advance(&mut self) -> Result<(), ParseError> {
        (self.token, self.line, self.column) = self.scanner.next()?;
        Ok(())
    }

    fn expected(&self, what: &str) -> ParseError {
        let found = match &self.token {
            Token::Name(text) | Token::Number(text) => format!("{text:?}"),
            Token::Text(_) => "a text in quotes".to_owned(),
            Token::Sign(sign) => format!("{:?}", sign.to_string()),
            Token::End => "the end".to_owned(),
        };
        let what = format!("expected {what}, found {found}");
        ParseError::new(self.line, self.column, what)
    }
}

fn number(digits: &str) -> Option<Number> {
    let unsigned = digits.strip_prefix('-').unwrap_or(digits);
    let (whole, fraction) = unsigned.split_once('.').unwrap_or((unsigned, "0"));
    let is_digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    if !is_digits(whole) || !is_digits(fraction) {
        return None;
    }
    Number::new(digits.parse().ok()?).ok()
}
