use std::ops::Range;

use bytes::Bytes;
use fipa_acl::Text;

use super::scan;
use crate::{DecodeError, Fault, Limits};

const TOO_LONG: (Fault, &str) = (Fault::Limit, "too long");

/// How tokens are told apart.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Pass {
    /// By white space and parentheses.
    Spaced,
    /// By keywords too: one encoder writes no white space.
    Glued,
}

/// Where the text is read: a cursor that never goes beyond its end.
pub(super) struct Reader<'a> {
    bytes: &'a Bytes,
    /// As many of the bytes as the limit allows for one input.
    input: &'a [u8],
    /// The octets of the input that are not yet read.
    rest: &'a [u8],
    limits: &'a Limits,
    items_left: usize,
    pass: Pass,
}

/// Octets of the input that make up a text.
pub(super) struct Span {
    octets: Range<usize>,
    /// Whether there are `\"` in it that stand for `"`.
    escaped: bool,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a Bytes, limits: &'a Limits, pass: Pass) -> Reader<'a> {
        let end = bytes.len().min(limits.max_octets);
        let input = bytes.get(..end).unwrap_or_default();
        Reader {
            bytes,
            input,
            rest: input,
            limits,
            items_left: limits.max_items,
            pass,
        }
    }

    /// Octets read so far.
    #[inline]
    pub(super) fn position(&self) -> usize {
        self.input.len() - self.rest.len()
    }

    pub(super) fn is_glued(&self) -> bool {
        self.pass == Pass::Glued
    }

    /// The octet with which the next token begins.
    #[inline]
    pub(super) fn next(&mut self) -> Result<u8, DecodeError> {
        self.skip_blanks()
            .ok_or_else(|| self.ends("it ends too soon"))
    }

    /// The octet with which the next token begins, if there is one.
    #[inline]
    pub(super) fn skip_blanks(&mut self) -> Option<u8> {
        let mut rest = self.rest;
        let next = loop {
            match rest {
                [octet, behind @ ..] if scan::is_blank(*octet) => rest = behind,
                [octet, ..] => break Some(*octet),
                [] => break None,
            }
        };
        self.rest = rest;
        next
    }

    /// Whether there is more behind what may be read.
    pub(super) fn is_cut_off(&self) -> bool {
        self.input.len() < self.bytes.len()
    }

    /// Steps over the octet that [`next`](Self::next) gave.
    #[inline]
    pub(super) fn step(&mut self) {
        self.go_on(1);
    }

    #[inline]
    fn go_on(&mut self, octets: usize) {
        self.rest = self.rest.get(octets..).unwrap_or_default();
    }

    /// Steps over these octets if they are the next ones.
    pub(super) fn skip(&mut self, octets: &[u8]) {
        if self.rest.starts_with(octets) {
            self.go_on(octets.len());
        }
    }

    /// What was read since this position, as it stands there.
    pub(super) fn since(&self, start: usize) -> Span {
        Span {
            octets: start..self.position(),
            escaped: false,
        }
    }

    /// The next octets, which must be there.
    #[inline]
    pub(super) fn take(&mut self, len: usize) -> Span {
        let start = self.position();
        self.go_on(len);
        Span {
            octets: start..start + len,
            escaped: false,
        }
    }

    /// The next octets, which must be there in quotes.
    #[inline]
    pub(super) fn take_quoted(&mut self, len: usize, escaped: bool) -> Span {
        let start = self.position() + 1;
        self.go_on(len + 2);
        Span {
            octets: start..start + len,
            escaped,
        }
    }

    /// The octets as they stand in the input.
    #[inline]
    pub(super) fn raw(&self, span: &Span) -> &'a [u8] {
        self.input.get(span.octets.clone()).unwrap_or_default()
    }

    /// The octets, shared with the input unless there is something to unescape.
    #[inline]
    pub(super) fn bytes_of(&self, span: Span) -> Bytes {
        if span.escaped {
            Bytes::from(unescape(self.raw(&span)))
        } else {
            self.bytes.slice(span.octets)
        }
    }

    /// The text; a long one shares the input if it is UTF-8 and there is nothing to unescape.
    #[inline]
    pub(super) fn text_of(&self, span: Span) -> Text {
        if !span.escaped
            && let Some(text) = Text::short(self.raw(&span))
        {
            return text;
        }
        self.long_text_of(span)
    }

    #[inline(never)]
    fn long_text_of(&self, span: Span) -> Text {
        if !span.escaped
            && let Ok(text) = Text::from_utf8(self.bytes.slice(span.octets.clone()))
        {
            return text;
        }
        Text::from_utf8_lossy(self.bytes_of(span))
    }

    /// Counts one more entry of a list.
    #[inline]
    pub(super) fn count_item(&mut self) -> Result<(), DecodeError> {
        match self.items_left.checked_sub(1) {
            Some(left) => {
                self.items_left = left;
                Ok(())
            }
            None => Err(self.error(Fault::Limit, "too many entries in lists")),
        }
    }

    /// Whether one may nest this deep.
    pub(super) fn check_depth(&self, depth: usize) -> Result<(), DecodeError> {
        if depth > self.limits.max_depth {
            return Err(self.error(Fault::Limit, "nested too deeply"));
        }
        Ok(())
    }

    #[cold]
    pub(super) fn error(&self, fault: Fault, what: &'static str) -> DecodeError {
        self.error_at(self.position(), fault, what)
    }

    /// Where the input is cut off within a token, nobody knows what is wrong with it.
    #[cold]
    pub(super) fn error_at(&self, offset: usize, fault: Fault, what: &'static str) -> DecodeError {
        let rest = self.rest;
        let (fault, what) = match self.is_cut_off() && scan::word_len(rest) == rest.len() {
            true => TOO_LONG,
            false => (fault, what),
        };
        DecodeError {
            offset,
            fault,
            what,
        }
    }

    /// Where it ends, something is missing.
    #[cold]
    pub(super) fn ends(&self, what: &'static str) -> DecodeError {
        let (fault, what) = match self.is_cut_off() {
            true => TOO_LONG,
            false => (Fault::Malformed, what),
        };
        DecodeError {
            offset: self.position(),
            fault,
            what,
        }
    }

    /// The octets not yet read.
    #[inline]
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

/// The text of a literal; each quote in it has a backslash in front.
fn unescape(literal: &[u8]) -> Vec<u8> {
    let mut text = Vec::with_capacity(literal.len());
    let mut from = 0;
    for quote in memchr::memchr_iter(b'"', literal) {
        let before = literal.get(from..quote.saturating_sub(1));
        text.extend_from_slice(before.unwrap_or_default());
        from = quote;
    }
    text.extend_from_slice(literal.get(from..).unwrap_or_default());
    text
}
