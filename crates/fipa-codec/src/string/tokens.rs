use super::keywords::{self, Keyword, Parameter, Parameters, glued_name_len, glued_word_len};
use super::reader::{Reader, Span};
use super::scan::{byte_length, ends_word, find_quote, word_len};
use crate::{DecodeError, Fault};

impl Reader<'_> {
    /// Steps over an opening parenthesis.
    pub(super) fn open(&mut self, what: &'static str) -> Result<(), DecodeError> {
        if self.next()? != b'(' {
            return Err(self.error(Fault::Malformed, what));
        }
        self.step();
        Ok(())
    }

    /// Steps over a closing parenthesis if it is next.
    pub(super) fn closes(&mut self) -> Result<bool, DecodeError> {
        let closes = self.next()? == b')';
        if closes {
            self.step();
        }
        Ok(closes)
    }

    /// Steps over this keyword if it is next, in any case.
    #[inline]
    pub(super) fn keyword(&mut self, keyword: &Keyword) -> Result<bool, DecodeError> {
        self.next()?;
        let found =
            keyword.begins(keywords::window(self.rest())) && self.may_end_behind(keyword.len);
        if found {
            self.take(keyword.len);
        }
        Ok(found)
    }

    /// Whether a keyword of this length is one, and not the beginning of a longer word.
    #[inline]
    fn may_end_behind(&self, len: usize) -> bool {
        let behind = self.rest().get(len);
        self.is_glued() || behind.is_none_or(|octet| ends_word(*octet))
    }

    /// Steps over the name of a parameter with its colon, if it is one of those known.
    #[inline]
    pub(super) fn known_name(&mut self, known: &Parameters) -> Option<Parameter> {
        self.skip_blanks();
        let [b':', text @ ..] = self.rest() else {
            return None;
        };
        let (parameter, len) = keywords::begins_with_name(known, text)?;
        let found = self.may_end_behind(1 + len);
        if found {
            self.take(1 + len);
        }
        found.then_some(parameter)
    }

    /// The name of a parameter that is not known, with its colon.
    #[inline(never)]
    pub(super) fn other_name(&mut self) -> Result<Span, DecodeError> {
        if self.next()? != b':' {
            return Err(self.error(Fault::Malformed, "a parameter begins with a colon"));
        }
        let text = self.rest().get(1..).unwrap_or_default();
        let len = if self.is_glued() {
            glued_name_len(text)
        } else {
            word_len(text)
        };
        let name = text.get(..len).unwrap_or_default();
        if name.is_empty() {
            return Err(self.error(Fault::Malformed, "a parameter without a name"));
        }
        if !self.is_glued() && memchr::memchr3(b'#', b'"', b':', name).is_some() {
            return Err(self.error(Fault::Malformed, "a name runs into its value"));
        }
        self.step();
        Ok(self.take(len))
    }

    /// The name of a parameter without its colon, up to its value, which must be a counted string.
    pub(super) fn name_in_front_of_count(&mut self) -> Result<Span, DecodeError> {
        let len = glued_name_len(self.rest());
        match self.rest().get(len) {
            Some(b'#') if len > 0 => Ok(self.take(len)),
            _ => Err(self.error(Fault::Malformed, "a parameter begins with a colon")),
        }
    }

    /// A word, a string literal or a counted string.
    #[inline]
    pub(super) fn text(&mut self) -> Result<Span, DecodeError> {
        match self.next()? {
            b'"' => self.literal(),
            b'#' => self.counted(),
            _ => self.word(),
        }
    }

    /// Octets up to white space, a parenthesis or what else ends a word in this pass.
    #[inline]
    pub(super) fn word(&mut self) -> Result<Span, DecodeError> {
        if self.is_glued() {
            return self.word_of(glued_word_len(self.rest()));
        }
        self.spaced_word()
    }

    /// Octets up to white space or a parenthesis.
    #[inline]
    pub(super) fn spaced_word(&mut self) -> Result<Span, DecodeError> {
        self.word_of(word_len(self.rest()))
    }

    #[inline]
    fn word_of(&mut self, len: usize) -> Result<Span, DecodeError> {
        if len == 0 {
            return Err(self.error(Fault::Malformed, "a value is missing"));
        }
        Ok(self.take(len))
    }

    /// StringLiteral of SC00070I.
    ///
    /// A quote behind a backslash does not end it, unless it is the last quote of the input: so
    /// reads the peer whose literals can end in a backslash.
    #[inline]
    pub(super) fn literal(&mut self) -> Result<Span, DecodeError> {
        let body = self.rest().get(1..).unwrap_or_default();
        match find_quote(body) {
            Some(quote) if !is_escaped(body, quote) => Ok(self.take_quoted(quote, false)),
            _ => self.escaped_literal(body),
        }
    }

    fn escaped_literal(&mut self, body: &[u8]) -> Result<Span, DecodeError> {
        let mut escapes = 0;
        let mut last = None;
        for quote in memchr::memchr_iter(b'"', body) {
            if !is_escaped(body, quote) {
                return Ok(self.take_quoted(quote, true));
            }
            escapes += 1;
            last = Some(quote);
        }
        match last {
            // What is cut off could hold another quote.
            Some(quote) if !self.is_cut_off() => Ok(self.take_quoted(quote, escapes > 1)),
            _ => Err(self.ends("a string literal without its closing quote")),
        }
    }

    /// ByteLengthEncodedString of SC00070I: `#n"` and n octets, whatever they are.
    pub(super) fn counted(&mut self) -> Result<Span, DecodeError> {
        let Some((count, prefix)) = byte_length(self.rest()) else {
            return Err(self.error(Fault::Malformed, "a counted string begins like #1\""));
        };
        if count > self.rest().len().saturating_sub(prefix) {
            return Err(self.ends("it ends too soon"));
        }
        self.take(prefix);
        Ok(self.take(count))
    }
}

fn is_escaped(body: &[u8], quote: usize) -> bool {
    let before = quote.checked_sub(1).and_then(|at| body.get(at));
    before == Some(&b'\\')
}
