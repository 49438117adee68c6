use std::ffi::CStr;
use std::ops::Range;

use bytes::Bytes;
use fipa_acl::Text;

use crate::{DecodeError, Fault, Limits};

/// Where the octets are read: a cursor that never goes beyond its end.
pub(super) struct Reader<'a> {
    bytes: &'a Bytes,
    at: usize,
    end: usize,
    limits: &'a Limits,
    items_left: usize,
}

/// Octets of the input that make up a text.
pub(super) struct Span {
    octets: Range<usize>,
    /// Whether there are `\"` in it that stand for `"`.
    escaped: bool,
}

impl<'a> Reader<'a> {
    /// Reads from the beginning, and never more than the limit allows for one input.
    pub(super) fn new(bytes: &'a Bytes, limits: &'a Limits) -> Reader<'a> {
        Reader {
            bytes,
            at: 0,
            end: bytes.len().min(limits.max_octets),
            limits,
            items_left: limits.max_items,
        }
    }

    /// Octets read so far.
    pub(super) fn position(&self) -> usize {
        self.at
    }

    /// The octets not yet read.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..self.end).unwrap_or_default()
    }

    /// Goes on at this octet of the input; not beyond its end.
    pub(super) fn go_to(&mut self, at: usize) {
        self.at = at.min(self.end);
    }

    pub(super) fn octet(&mut self) -> Result<u8, DecodeError> {
        let octet = self.peek()?;
        self.at += 1;
        Ok(octet)
    }

    pub(super) fn peek(&self) -> Result<u8, DecodeError> {
        match self.rest().first() {
            Some(octet) => Ok(*octet),
            None => Err(self.too_short()),
        }
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        match self.rest().first_chunk() {
            Some(octets) => {
                self.at += N;
                Ok(*octets)
            }
            None => Err(self.too_short()),
        }
    }

    /// Text up to the next zero octet, as it stands there.
    #[inline]
    pub(super) fn word(&mut self) -> Result<Span, DecodeError> {
        let found = CStr::from_bytes_until_nul(self.rest());
        let len = found.map_err(|_| self.unterminated())?.count_bytes();
        let octets = self.at..self.at + len;
        self.at += len + 1;
        Ok(Span {
            octets,
            escaped: false,
        })
    }

    /// Text before a zero octet as peers write it: `"…"` with `\"` inside, `#n"…`, or bare.
    #[inline]
    pub(super) fn literal(&mut self) -> Result<Span, DecodeError> {
        if let Some(span) = self.byte_length_literal() {
            return Ok(span);
        }
        let mut span = self.word()?;
        let text = self.bytes.get(span.octets.clone()).unwrap_or_default();
        if let [b'"', inner @ .., b'"'] = text {
            // Nearly always there is no backslash at all, which is found out faster.
            span.escaped = inner.contains(&b'\\') && inner.windows(2).any(|pair| pair == b"\\\"");
            span.octets = span.octets.start + 1..span.octets.end - 1;
        } else if let Some((_, prefix)) = byte_length(text) {
            span.octets.start += prefix;
        }
        Ok(span)
    }

    /// `#n"` whose n octets, which may be zero octets too, are followed by a zero octet.
    fn byte_length_literal(&mut self) -> Option<Span> {
        let (count, prefix) = byte_length(self.rest())?;
        let start = self.at + prefix;
        let end = start.checked_add(count).filter(|end| *end < self.end)?;
        if self.bytes.get(end) != Some(&0) {
            return None;
        }
        self.at = end + 1;
        Some(Span {
            octets: start..end,
            escaped: false,
        })
    }

    /// This many octets.
    pub(super) fn counted(&mut self, count: usize) -> Result<Span, DecodeError> {
        if count > self.rest().len() {
            return Err(self.too_short());
        }
        let octets = self.at..self.at + count;
        self.at += count;
        Ok(Span {
            octets,
            escaped: false,
        })
    }

    pub(super) fn len8(&mut self) -> Result<usize, DecodeError> {
        self.octet().map(usize::from)
    }

    pub(super) fn len16(&mut self) -> Result<usize, DecodeError> {
        self.array().map(|len| usize::from(u16::from_be_bytes(len)))
    }

    /// What does not fit the machine does not fit the input either.
    pub(super) fn len32(&mut self) -> Result<usize, DecodeError> {
        self.array()
            .map(|len| usize::try_from(u32::from_be_bytes(len)).unwrap_or(usize::MAX))
    }

    /// An entry of a code table: where a table would be asked.
    pub(super) fn coded(&self) -> Result<Span, DecodeError> {
        Err(self.error(Fault::Unsupported, "an index into a code table"))
    }

    /// The octets, shared with the input unless there is something to unescape.
    #[inline]
    pub(super) fn bytes_of(&self, span: Span) -> Bytes {
        let octets = self.bytes.slice(span.octets);
        if span.escaped {
            Bytes::from(unescape(&octets))
        } else {
            octets
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

    /// Whether an envelope may have this many layers.
    pub(super) fn check_layers(&self, layers: usize) -> Result<(), DecodeError> {
        if layers > self.limits.max_layers {
            return Err(self.error(Fault::Limit, "too many layers"));
        }
        Ok(())
    }

    pub(super) fn error(&self, fault: Fault, what: &'static str) -> DecodeError {
        DecodeError {
            offset: self.at,
            fault,
            what,
        }
    }

    /// The octet that was read last is none that may stand there.
    pub(super) fn unexpected(&self, what: &'static str) -> DecodeError {
        DecodeError {
            offset: self.at.saturating_sub(1),
            fault: Fault::Malformed,
            what,
        }
    }

    #[cold]
    fn too_short(&self) -> DecodeError {
        self.ends("it ends too soon")
    }

    #[cold]
    fn unterminated(&self) -> DecodeError {
        self.ends("a text without its closing zero octet")
    }

    fn ends(&self, what: &'static str) -> DecodeError {
        if self.end < self.bytes.len() {
            self.error(Fault::Limit, "too long")
        } else {
            self.error(Fault::Malformed, what)
        }
    }
}

/// The n of `#n"` and how many octets these are.
fn byte_length(text: &[u8]) -> Option<(usize, usize)> {
    let digits = text.strip_prefix(b"#")?;
    let mut count = 0_usize;
    for (i, octet) in digits.iter().enumerate() {
        match octet {
            b'0'..=b'9' => {
                let digit = usize::from(octet - b'0');
                count = count.saturating_mul(10).saturating_add(digit);
            }
            b'"' if i > 0 => return Some((count, i + 2)),
            _ => return None,
        }
    }
    None
}

fn unescape(octets: &[u8]) -> Vec<u8> {
    let mut text = Vec::with_capacity(octets.len());
    let mut rest = octets;
    loop {
        rest = match rest {
            [b'\\', b'"', after @ ..] => {
                text.push(b'"');
                after
            }
            [octet, after @ ..] => {
                text.push(*octet);
                after
            }
            [] => return text,
        };
    }
}
