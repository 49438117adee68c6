use std::ops::Range;

use bytes::Bytes;
use memchr::{memchr, memchr2};

use super::names::Tag;
use super::tags::Attribute;
use crate::{DecodeError, Fault, Limits};

/// Where the document is read: elements are asked for one after the other, and whatever stands
/// between them is skipped or refused here.
///
/// quick-xml tells where tags with attributes, comments and instructions end, and splits
/// attributes. Its reader of whole documents is not used: it costs more for each tag than reading
/// a value may take, refuses contents that are not UTF-8, and would need all that is checked here
/// on top of it.
pub(super) struct Cursor<'a> {
    pub(super) bytes: &'a Bytes,
    pub(super) at: usize,
    pub(super) end: usize,
    pub(super) limits: &'a Limits,
    /// Those of the tag that was read last.
    pub(super) attributes: Vec<Attribute>,
    /// Whether text is read that was written without escaping it.
    pub(super) lenient: bool,
    /// Whether a `]]></content>` can still be found; looked for only once in vain.
    pub(super) raw_ends: bool,
    items_left: usize,
    depth: usize,
}

/// An element whose start tag was read.
#[derive(Clone)]
pub(super) struct Element {
    pub(super) tag: Tag,
    /// Its name as it stands there.
    pub(super) name: Range<usize>,
    /// Whether it is `<…/>`.
    pub(super) empty: bool,
}

impl<'a> Cursor<'a> {
    /// Reads from the beginning, and never more than the limit allows for one input.
    pub(super) fn new(bytes: &'a Bytes, limits: &'a Limits) -> Cursor<'a> {
        let mark = if bytes.starts_with(BYTE_ORDER_MARK) {
            3
        } else {
            0
        };
        let end = bytes.len().min(limits.max_octets);
        Cursor {
            bytes,
            at: mark.min(end),
            end,
            limits,
            attributes: Vec::new(),
            lenient: false,
            raw_ends: true,
            items_left: limits.max_items,
            depth: 0,
        }
    }

    /// Reads text that was written without escaping it, in a document that ends here at the
    /// latest.
    pub(super) fn lenient(bytes: &'a Bytes, end: usize, limits: &'a Limits) -> Cursor<'a> {
        let mut cursor = Cursor::new(bytes, limits);
        cursor.end = cursor.end.min(end);
        cursor.lenient = true;
        cursor
    }

    /// The octets not yet read.
    #[inline]
    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..self.end).unwrap_or_default()
    }

    /// The octets of a part of the input.
    #[inline]
    pub(super) fn octets(&self, range: Range<usize>) -> &'a [u8] {
        self.bytes.get(range).unwrap_or_default()
    }

    /// The start tag of the outermost element, behind what may stand in front of it.
    pub(super) fn root(&mut self) -> Result<Element, DecodeError> {
        loop {
            self.skip_space();
            match self.rest() {
                [b'<', b'?', ..] => self.skip_instruction()?,
                [b'<', b'!', b'-', ..] => self.skip_comment()?,
                [b'<', b'!', ..] => self.skip_document_type()?,
                [b'<', ..] => return self.open(),
                [] => return Err(self.too_short()),
                _ => return Err(self.error(Fault::Malformed, "no XML begins like this")),
            }
        }
    }

    /// The next element within this one; `None` when its end tag was read. Text in between has
    /// no meaning, but must be well-formed.
    #[inline]
    pub(super) fn child(&mut self, parent: &Element) -> Result<Option<Element>, DecodeError> {
        if parent.empty {
            return Ok(None);
        }
        loop {
            match self.rest() {
                [b'<', b'/', ..] => return self.close(parent).map(|()| None),
                [b'<', b'!' | b'?', ..] => self.skip_markup()?,
                [b'<', ..] => return self.open().map(Some),
                [b'&', ..] => drop(self.reference()?),
                rest => match memchr2(b'<', b'&', rest) {
                    Some(text) => self.at += text,
                    None => return Err(self.too_short()),
                },
            }
        }
    }

    /// The rest of an element that nobody asked for.
    pub(super) fn skip(&mut self, element: &Element) -> Result<(), DecodeError> {
        let mut within = Vec::new();
        let mut innermost = element.clone();
        loop {
            match self.child(&innermost)? {
                Some(child) if child.empty => {}
                Some(child) => within.push(std::mem::replace(&mut innermost, child)),
                None => match within.pop() {
                    Some(parent) => innermost = parent,
                    None => return Ok(()),
                },
            }
        }
    }

    /// The end tag of this element, which begins here.
    #[inline]
    pub(super) fn close(&mut self, element: &Element) -> Result<(), DecodeError> {
        let name = self.octets(element.name.clone());
        let Some(behind) = self
            .rest()
            .get(2..)
            .and_then(|rest| rest.strip_prefix(name))
        else {
            return Err(self.wrong_end());
        };
        let mut space = 0;
        if behind.first() != Some(&b'>') {
            space = behind.iter().take_while(|octet| is_space(**octet)).count();
            if behind.get(space) != Some(&b'>') {
                return Err(self.wrong_end());
            }
        }
        self.at += 2 + name.len() + space + 1;
        self.depth = self.depth.saturating_sub(1);
        Ok(())
    }

    /// One may be nested this deep in elements; each level of the limit has up to two.
    #[inline]
    pub(super) fn entered(&mut self) -> Result<(), DecodeError> {
        self.depth += 1;
        if self.depth > self.limits.max_depth.saturating_mul(2).saturating_add(8) {
            return Err(self.error(Fault::Limit, "nested too deeply"));
        }
        Ok(())
    }

    /// Nothing but white space follows.
    pub(super) fn finish(&mut self) -> Result<(), DecodeError> {
        self.skip_space();
        if self.end < self.bytes.len() {
            return Err(self.too_short());
        }
        match self.rest() {
            [] => Ok(()),
            // Not escaping a text is no reason for it.
            [b'<', next, ..] if *next != b'/' => {
                Err(self.error(Fault::Violation, "another element follows the message"))
            }
            _ => Err(self.error(Fault::Malformed, "something follows the message")),
        }
    }

    pub(super) fn skip_space(&mut self) {
        let space = self.rest().iter().take_while(|octet| is_space(**octet));
        self.at += space.count();
    }

    /// Goes on at this octet of the input; not beyond its end.
    #[inline]
    pub(super) fn go_to(&mut self, at: usize) {
        self.at = at.min(self.end);
    }

    /// Counts entries of lists.
    #[inline]
    pub(super) fn count_items(&mut self, items: usize) -> Result<(), DecodeError> {
        match self.items_left.checked_sub(items) {
            Some(left) => {
                self.items_left = left;
                Ok(())
            }
            None => Err(self.error(Fault::Limit, "too many entries in lists")),
        }
    }

    /// Whether resolvers or lists may nest this deep.
    #[inline]
    pub(super) fn check_depth(&self, depth: usize) -> Result<(), DecodeError> {
        if depth > self.limits.max_depth {
            return Err(self.error(Fault::Limit, "nested too deeply"));
        }
        Ok(())
    }

    #[cold]
    pub(super) fn error(&self, fault: Fault, what: &'static str) -> DecodeError {
        DecodeError {
            offset: self.at,
            fault,
            what,
        }
    }

    /// What is looked for is not there.
    #[cold]
    pub(super) fn too_short(&self) -> DecodeError {
        let (offset, fault, what) = if self.end < self.bytes.len() {
            (self.end, Fault::Limit, "too long")
        } else {
            (self.end, Fault::Malformed, "it ends too soon")
        };
        DecodeError {
            offset,
            fault,
            what,
        }
    }

    #[cold]
    fn wrong_end(&self) -> DecodeError {
        if memchr(b'>', self.rest()).is_none() {
            return self.too_short();
        }
        self.error(Fault::Malformed, "another end tag belongs here")
    }
}

pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// White space of XML.
#[inline]
pub(super) fn is_space(octet: u8) -> bool {
    matches!(octet, b' ' | b'\t' | b'\r' | b'\n')
}
