use bytes::Bytes;

use super::code_table::Coding;
use super::scan::{find_zero, find_zero_or_backslash};
use crate::{DecodeError, Fault, Limits};

/// Where the octets are read: a cursor that never goes beyond its end.
pub(super) struct Reader<'a> {
    /// The whole input, of which texts and contents are slices.
    input: &'a Bytes,
    /// The octets not yet read, up to the end.
    rest: &'a [u8],
    /// Where reading ends: with the input, or before it because of the limit.
    end: usize,
    limits: &'a Limits,
    items_left: usize,
    /// The code table of the message, if it uses one.
    pub(super) table: Option<Coding<'a>>,
}

impl<'a> Reader<'a> {
    /// Reads from the beginning, and never more than the limit allows for one input.
    #[inline]
    pub(super) fn new(input: &'a Bytes, limits: &'a Limits) -> Reader<'a> {
        let end = input.len().min(limits.max_octets);
        Reader {
            input,
            rest: input.get(..end).unwrap_or_default(),
            end,
            limits,
            items_left: limits.max_items,
            table: None,
        }
    }

    /// Whether the message fills the whole input; line ends behind it are ignored.
    #[inline]
    pub(super) fn finish(&self) -> Result<(), DecodeError> {
        let used = self.position();
        let behind = self.input.get(used..).unwrap_or_default();
        let is_line_end = |octet: &u8| matches!(octet, b'\r' | b'\n');
        match behind.iter().position(|octet| !is_line_end(octet)) {
            None => Ok(()),
            Some(position) => Err(DecodeError {
                offset: used + position,
                fault: Fault::Malformed,
                what: "something follows the message",
            }),
        }
    }

    /// Octets read so far.
    #[inline]
    pub(super) fn position(&self) -> usize {
        self.end - self.rest.len()
    }

    /// The octets not yet read.
    #[inline]
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// Octets of the input, shared with it.
    #[inline]
    pub(super) fn share(&self, octets: &[u8]) -> Bytes {
        self.input.slice_ref(octets)
    }

    /// Goes on at this octet of the input; not beyond its end.
    pub(super) fn go_to(&mut self, at: usize) {
        self.rest = self.input.get(at..self.end).unwrap_or_default();
    }

    #[inline]
    pub(super) fn octet(&mut self) -> Result<u8, DecodeError> {
        match self.rest {
            [octet, rest @ ..] => {
                self.rest = rest;
                Ok(*octet)
            }
            [] => Err(self.too_short()),
        }
    }

    #[inline]
    pub(super) fn peek(&self) -> Result<u8, DecodeError> {
        match self.rest {
            [octet, ..] => Ok(*octet),
            [] => Err(self.too_short()),
        }
    }

    /// Steps over this octet if it is the next one.
    #[inline]
    pub(super) fn skip_if(&mut self, octet: u8) -> Result<bool, DecodeError> {
        let found = self.peek()? == octet;
        if found {
            self.rest = self.rest.get(1..).unwrap_or_default();
        }
        Ok(found)
    }

    #[inline]
    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        match self.rest.split_first_chunk() {
            Some((octets, rest)) => {
                self.rest = rest;
                Ok(*octets)
            }
            None => Err(self.too_short()),
        }
    }

    /// This many octets.
    #[inline]
    pub(super) fn counted(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        match self.rest.split_at_checked(count) {
            Some((octets, rest)) => {
                self.rest = rest;
                Ok(octets)
            }
            None => Err(self.too_short()),
        }
    }

    /// The octets up to the next zero octet, which is stepped over.
    #[inline(always)]
    pub(super) fn until_zero(&mut self) -> Result<&'a [u8], DecodeError> {
        let found = find_zero(self.rest);
        match found.and_then(|len| self.rest.split_at_checked(len)) {
            Some((octets, [_, rest @ ..])) => {
                self.rest = rest;
                Ok(octets)
            }
            _ => Err(self.unterminated()),
        }
    }

    /// The same if there is no backslash among them; else nothing is stepped over.
    #[inline(always)]
    pub(super) fn until_zero_without_backslash(&mut self) -> Option<&'a [u8]> {
        let len = find_zero_or_backslash(self.rest)?;
        match self.rest.split_at_checked(len)? {
            (octets, [0, rest @ ..]) => {
                self.rest = rest;
                Some(octets)
            }
            _ => None,
        }
    }

    #[inline]
    pub(super) fn len8(&mut self) -> Result<usize, DecodeError> {
        self.octet().map(usize::from)
    }

    #[inline]
    pub(super) fn len16(&mut self) -> Result<usize, DecodeError> {
        self.array().map(|len| usize::from(u16::from_be_bytes(len)))
    }

    /// What does not fit the machine does not fit the input either.
    pub(super) fn len32(&mut self) -> Result<usize, DecodeError> {
        self.array()
            .map(|len| usize::try_from(u32::from_be_bytes(len)).unwrap_or(usize::MAX))
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
    #[inline]
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

    #[cold]
    pub(super) fn error(&self, fault: Fault, what: &'static str) -> DecodeError {
        DecodeError {
            offset: self.position(),
            fault,
            what,
        }
    }

    /// The octet that was read last is none that may stand there.
    #[cold]
    pub(super) fn unexpected(&self, what: &'static str) -> DecodeError {
        DecodeError {
            offset: self.position().saturating_sub(1),
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
        if self.end < self.input.len() {
            self.error(Fault::Limit, "too long")
        } else {
            self.error(Fault::Malformed, what)
        }
    }
}
