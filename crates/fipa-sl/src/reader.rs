use bytes::Bytes;
use fipa_acl::Text;

use crate::scan::{Token, ends_token, is_blank};
use crate::{Arguments, Functional, Limits, ParseError, ParseErrorKind, Term};

/// Characters of what was found that an error shows.
const SHOWN: usize = 24;

/// Reads SL from octets; every step forward is over octets that are there.
pub(crate) struct Reader<'a> {
    octets: &'a Bytes,
    at: usize,
    limits: &'a Limits,
    terms: usize,
}

/// An error without its line and column, which are only counted once.
pub(crate) struct Wrong {
    offset: usize,
    kind: ParseErrorKind,
}

impl<'a> Reader<'a> {
    /// Reads what fills all of the octets, white space around it aside.
    pub(crate) fn whole<T>(
        octets: &'a Bytes,
        limits: &'a Limits,
        read: impl FnOnce(&mut Reader<'a>) -> Result<T, Wrong>,
    ) -> Result<T, ParseError> {
        let mut reader = Reader {
            octets,
            at: 0,
            limits,
            terms: 0,
        };
        let value = reader.check_len().and_then(|()| read(&mut reader));
        let value = value.and_then(|value| match reader.next() {
            None => Ok(value),
            Some(_) => Err(reader.expected("the end")),
        });
        value.map_err(|wrong| wrong.located(octets))
    }

    fn check_len(&self) -> Result<(), Wrong> {
        if self.octets.len() > self.limits.max_octets {
            return Err(self.beyond("the content is too long"));
        }
        Ok(())
    }

    /// Content of SC00008I.
    pub(crate) fn content(&mut self) -> Result<(Term, Vec<Term>), Wrong> {
        if self.next() != Some(b'(') {
            return Err(self.expected("the parenthesis that begins a content"));
        }
        self.at += 1;
        let first = match self.next() {
            Some(b')') => return Err(self.expected("an action or a proposition")),
            _ => self.term(2)?,
        };
        Ok((first, self.terms_to_end(2)?))
    }

    /// The terms up to and with the closing parenthesis.
    fn terms_to_end(&mut self, depth: usize) -> Result<Vec<Term>, Wrong> {
        let mut terms = Vec::new();
        while !self.closes()? {
            terms.push(self.term(depth)?);
        }
        Ok(terms)
    }

    /// A term, formula or action; the depth counts the parentheses that it may open.
    pub(crate) fn term(&mut self, depth: usize) -> Result<Term, Wrong> {
        self.terms += 1;
        if self.terms > self.limits.max_terms {
            return Err(self.beyond("too many terms"));
        }
        match self.next() {
            Some(b'(') => self.functional(depth),
            Some(b'"') => self.literal().map(Term::Text),
            Some(b'#') => self.counted().map(Term::Octets),
            Some(b'?') => {
                self.at += 1;
                self.name("the name of a variable").map(Term::Variable)
            }
            Some(octet) if !ends_token(octet) && octet != b':' => self.token(),
            _ => Err(self.expected("a term")),
        }
    }

    fn functional(&mut self, depth: usize) -> Result<Term, Wrong> {
        if depth > self.limits.max_depth.min(Limits::DEEPEST) {
            return Err(self.beyond("parentheses are nested too deep"));
        }
        self.at += 1;
        let symbol = self.symbol()?;
        let arguments = match self.next() {
            Some(b':') => Arguments::Named(self.parameters(depth)?),
            _ => Arguments::Positional(self.terms_to_end(depth + 1)?),
        };
        Ok(Term::Functional(Functional { symbol, arguments }))
    }

    fn parameters(&mut self, depth: usize) -> Result<Vec<(Text, Term)>, Wrong> {
        let mut parameters = Vec::new();
        while !self.closes()? {
            if self.next() != Some(b':') {
                return Err(self.expected("a parameter such as :name, or a closing parenthesis"));
            }
            self.at += 1;
            let name = self.name("the name of a parameter")?;
            parameters.push((name, self.term(depth + 1)?));
        }
        Ok(parameters)
    }

    /// The symbol behind an opening parenthesis.
    fn symbol(&mut self) -> Result<Text, Wrong> {
        const SYMBOL: &str = "a symbol such as action or set";
        match self.next() {
            Some(b'"') => self.literal(),
            Some(b'#') => self.counted_text(),
            _ => {
                let start = self.at;
                let token = self.bare();
                match Token::of(&token) {
                    Token::Word | Token::Truth(_) => self.text_at(start, token),
                    _ => Err(self.expected_at(start, SYMBOL)),
                }
            }
        }
    }

    /// A name behind its mark, `:` or `?`, without white space between them.
    fn name(&mut self, expected: &'static str) -> Result<Text, Wrong> {
        match self.octets.get(self.at) {
            Some(b'"') => self.literal(),
            Some(b'#') => self.counted_text(),
            Some(octet) if !ends_token(*octet) => {
                let start = self.at;
                let token = self.bare();
                self.text_at(start, token)
            }
            _ => Err(self.expected(expected)),
        }
    }

    /// A word, a number or a date.
    fn token(&mut self) -> Result<Term, Wrong> {
        let start = self.at;
        let token = self.bare();
        match Token::of(&token) {
            Token::Word => self.text_at(start, token).map(Term::Text),
            Token::Number => self.text_at(start, token).map(Term::Number),
            Token::Truth(truth) => Ok(Term::Truth(truth)),
            Token::Time(time) => Ok(Term::Time(time)),
            Token::NoSuchDate => Err(self.expected_at(start, "a date that the calendar has")),
            Token::Illegal => Err(self.expected_at(start, "a number, a date, or text in quotes")),
        }
    }

    fn bare(&mut self) -> Bytes {
        let start = self.at;
        let end = self.rest().iter().position(|octet| ends_token(*octet));
        self.at = end.map_or(self.octets.len(), |len| start + len);
        self.octets.slice(start..self.at)
    }

    /// StringLiteral of SC00008I: `\"` is a quote, and no other backslash means anything.
    ///
    /// A text that ends in a backslash cannot be written so, and is: the literal then ends at the
    /// last quote that there is.
    fn literal(&mut self) -> Result<Text, Wrong> {
        let start = self.at + 1;
        let mut escaped = Vec::new();
        let mut behind_backslash = false;
        let body = self.octets.get(start..).unwrap_or_default();
        for (i, octet) in body.iter().enumerate() {
            match octet {
                b'"' if behind_backslash => escaped.push(start + i),
                b'"' => return self.literal_to(start, start + i, &escaped),
                _ => {}
            }
            behind_backslash = *octet == b'\\';
        }
        match escaped.pop() {
            Some(end) => self.literal_to(start, end, &escaped),
            None => Err(self.expected("a literal that ends with a quote")),
        }
    }

    /// The literal between two places, of whose quotes those are escaped.
    fn literal_to(&mut self, start: usize, end: usize, escaped: &[usize]) -> Result<Text, Wrong> {
        self.at = end + 1;
        if escaped.is_empty() {
            return self.text_at(start, self.octets.slice(start..end));
        }
        let mut octets = Vec::with_capacity(end - start);
        let mut from = start;
        for quote in escaped {
            octets.extend_from_slice(self.octets.get(from..quote - 1).unwrap_or_default());
            from = *quote;
        }
        octets.extend_from_slice(self.octets.get(from..end).unwrap_or_default());
        self.text_at(start, Bytes::from(octets))
    }

    /// ByteLengthEncodedString of SC00008I.
    fn counted(&mut self) -> Result<Bytes, Wrong> {
        const SHAPE: &str = "a number of octets and a quote behind #";
        let rest = self.rest();
        let digits = rest.iter().skip(1).take_while(|b| b.is_ascii_digit());
        let digits = digits.count();
        if digits == 0 || rest.get(digits + 1) != Some(&b'"') {
            return Err(self.expected(SHAPE));
        }
        let text = rest.get(1..=digits).unwrap_or_default();
        let count = std::str::from_utf8(text)
            .ok()
            .and_then(|text| text.parse::<usize>().ok())
            .unwrap_or(usize::MAX);
        let start = self.at + digits + 2;
        let end = start.saturating_add(count);
        if end > self.octets.len() {
            return Err(self.expected("as many octets as # announces"));
        }
        self.at = end;
        Ok(self.octets.slice(start..end))
    }

    fn counted_text(&mut self) -> Result<Text, Wrong> {
        let start = self.at;
        let octets = self.counted()?;
        self.text_at(start, octets)
    }

    fn text_at(&self, start: usize, octets: Bytes) -> Result<Text, Wrong> {
        Text::from_utf8(octets).map_err(|error| Wrong {
            offset: start + error.valid_up_to,
            kind: ParseErrorKind::NotUtf8,
        })
    }

    /// Whether a closing parenthesis is next; then it is stepped over.
    fn closes(&mut self) -> Result<bool, Wrong> {
        match self.next() {
            Some(b')') => {
                self.at += 1;
                Ok(true)
            }
            Some(_) => Ok(false),
            None => Err(self.expected("a closing parenthesis")),
        }
    }

    /// The next octet that is no white space.
    fn next(&mut self) -> Option<u8> {
        let blanks = self.rest().iter().take_while(|octet| is_blank(**octet));
        self.at += blanks.count();
        self.rest().first().copied()
    }

    fn rest(&self) -> &[u8] {
        self.octets.get(self.at..).unwrap_or_default()
    }

    fn expected(&self, expected: &'static str) -> Wrong {
        self.expected_at(self.at, expected)
    }

    fn expected_at(&self, offset: usize, expected: &'static str) -> Wrong {
        let found = found(self.octets.get(offset..).unwrap_or_default());
        Wrong {
            offset,
            kind: ParseErrorKind::Expected { expected, found },
        }
    }

    fn beyond(&self, limit: &'static str) -> Wrong {
        Wrong {
            offset: self.at,
            kind: ParseErrorKind::Limit(limit),
        }
    }
}

/// The token at the beginning of what is left, for people.
fn found(rest: &[u8]) -> String {
    let len = rest.iter().skip(1).take_while(|octet| !ends_token(**octet));
    let len = 1 + len.take(4 * SHOWN).count();
    match rest.get(..len) {
        None => "the end".to_owned(),
        Some(token) if rest.first().is_some_and(|first| ends_token(*first)) => {
            format!("{:?}", char::from(token.first().copied().unwrap_or(b' ')))
        }
        Some(token) => {
            let text = String::from_utf8_lossy(token);
            format!("{:?}", text.chars().take(SHOWN).collect::<String>())
        }
    }
}

impl Wrong {
    fn located(self, octets: &[u8]) -> ParseError {
        let before = octets.get(..self.offset).unwrap_or(octets);
        let line_start = before
            .iter()
            .rposition(|b| *b == b'\n')
            .map_or(0, |n| n + 1);
        let line = before.iter().filter(|b| **b == b'\n').count() + 1;
        let in_line = before.get(line_start..).unwrap_or_default();
        ParseError {
            offset: self.offset,
            line,
            column: String::from_utf8_lossy(in_line).chars().count() + 1,
            kind: self.kind,
        }
    }
}
