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
    at: usize,
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
        Reader {
            bytes,
            input: bytes.get(..end).unwrap_or_default(),
            at: 0,
            limits,
            items_left: limits.max_items,
            pass,
        }
    }

    /// Octets read so far.
    pub(super) fn position(&self) -> usize {
        self.at
    }

    pub(super) fn is_glued(&self) -> bool {
        self.pass == Pass::Glued
    }

    /// The octet with which the next token begins.
    #[inline]
    pub(super) fn next(&mut self) -> Result<u8, DecodeError> {
        while let Some(octet) = self.input.get(self.at) {
            if !scan::is_blank(*octet) {
                return Ok(*octet);
            }
            self.at += 1;
        }
        Err(self.ends("it ends too soon"))
    }

    /// Whether there is more behind what may be read.
    pub(super) fn is_cut_off(&self) -> bool {
        self.input.len() < self.bytes.len()
    }

    /// Steps over the octet that [`next`](Self::next) gave.
    pub(super) fn step(&mut self) {
        self.at = self.input.len().min(self.at + 1);
    }

    /// Steps over these octets if they are the next ones.
    pub(super) fn skip(&mut self, octets: &[u8]) {
        if self.rest().starts_with(octets) {
            self.at += octets.len();
        }
    }

    /// What was read since this position, as it stands there.
    pub(super) fn since(&self, start: usize) -> Span {
        Span {
            octets: start..self.at,
            escaped: false,
        }
    }

    /// The next octets, which must be there.
    pub(super) fn take(&mut self, len: usize) -> Span {
        let octets = self.at..self.at + len;
        self.at += len;
        Span {
            octets,
            escaped: false,
        }
    }

    /// The next octets, which must be there in quotes.
    pub(super) fn take_quoted(&mut self, len: usize, escaped: bool) -> Span {
        let octets = self.at + 1..self.at + 1 + len;
        self.at += len + 2;
        Span { octets, escaped }
    }

    /// The octets as they stand in the input.
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

    /// The text, shared with the input if it is UTF-8 and there is nothing to unescape.
    #[inline]
    pub(super) fn text_of(&self, span: Span) -> Text {
        if span.escaped {
            return Text::from_utf8_lossy(self.bytes_of(span));
        }
        let octets = self.bytes.slice(span.octets.clone());
        Text::from_utf8(octets)
            .unwrap_or_else(|_| Text::from_utf8_lossy(self.bytes.slice(span.octets)))
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
        self.error_at(self.at, fault, what)
    }

    /// Where the input is cut off within a token, nobody knows what is wrong with it.
    #[cold]
    pub(super) fn error_at(&self, offset: usize, fault: Fault, what: &'static str) -> DecodeError {
        let rest = self.rest();
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
            offset: self.at,
            fault,
            what,
        }
    }

    /// The octets not yet read.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.input.get(self.at..).unwrap_or_default()
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
