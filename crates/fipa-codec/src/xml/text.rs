use std::ops::Range;

use bytes::Bytes;
use fipa_acl::Text;
use memchr::memchr2;

use super::cursor::{Cursor, Element, is_space};
use super::names::Tag;
use crate::DecodeError;

/// The octets of a value: a part of the input as long as they stand there in one piece.
#[derive(Default)]
pub(super) struct Octets {
    shared: Range<usize>,
    /// All of them, once they are in more than one piece.
    owned: Option<Vec<u8>>,
}

impl Octets {
    pub(super) fn shared(range: Range<usize>) -> Octets {
        Octets {
            shared: range,
            owned: None,
        }
    }

    pub(super) fn as_slice<'a>(&'a self, cursor: &Cursor<'a>) -> &'a [u8] {
        match &self.owned {
            None => cursor.octets(self.shared.clone()),
            Some(octets) => octets,
        }
    }

    /// Without white space at the ends.
    fn trimmed(mut self, cursor: &Cursor<'_>) -> Octets {
        let octets = self.as_slice(cursor);
        if let [first, .., last] = octets
            && !is_space(*first)
            && !is_space(*last)
        {
            return self;
        }
        let start = octets.iter().take_while(|octet| is_space(**octet)).count();
        let rest = octets.get(start..).unwrap_or_default();
        let behind = rest.iter().rev().take_while(|octet| is_space(**octet));
        let end = octets.len() - behind.count();
        match &mut self.owned {
            None => self.shared = self.shared.start + start..self.shared.start + end,
            Some(octets) => {
                octets.truncate(end);
                octets.drain(..start);
            }
        }
        self
    }

    pub(super) fn add(&mut self, piece: Range<usize>, cursor: &Cursor<'_>) {
        if piece.is_empty() {
            return;
        }
        if self.owned.is_none() && self.shared.is_empty() {
            self.shared = piece;
        } else {
            self.in_pieces(cursor)
                .extend_from_slice(cursor.octets(piece));
        }
    }

    pub(super) fn add_character(&mut self, character: char, cursor: &Cursor<'_>) {
        let mut buffer = [0; 4];
        let octets = character.encode_utf8(&mut buffer).as_bytes();
        self.in_pieces(cursor).extend_from_slice(octets);
    }

    fn in_pieces(&mut self, cursor: &Cursor<'_>) -> &mut Vec<u8> {
        let first = cursor.octets(self.shared.clone());
        self.owned.get_or_insert_with(|| first.to_vec())
    }
}

impl Cursor<'_> {
    /// A value as it stands there: text, else the first of these attributes.
    #[inline]
    pub(super) fn exact(
        &mut self,
        element: &Element,
        attributes: &[&[u8]],
    ) -> Result<Text, DecodeError> {
        let octets = self.value(element, attributes)?;
        Ok(self.text_of(octets))
    }

    /// A value without white space at its ends.
    #[inline]
    pub(super) fn trimmed(
        &mut self,
        element: &Element,
        attributes: &[&[u8]],
    ) -> Result<Text, DecodeError> {
        let octets = self.value(element, attributes)?.trimmed(self);
        Ok(self.text_of(octets))
    }

    /// All that is within an element without attributes, if it is nothing but text; what most
    /// values are is read without looking for anything else.
    #[inline]
    fn plain_text(&mut self, element: &Element) -> Result<Option<Range<usize>>, DecodeError> {
        if element.empty || !self.attributes.is_empty() {
            return Ok(None);
        }
        let rest = self.rest();
        let len = memchr2(b'<', b'&', rest).unwrap_or_default();
        if rest.get(len..).is_none_or(|end| !end.starts_with(b"</")) {
            return Ok(None);
        }
        let text = self.at..self.at + len;
        self.at = text.end;
        self.close(element)?;
        Ok(Some(text))
    }

    /// The value of the tag that was read last, if it has this attribute.
    pub(super) fn attribute_text(&self, name: &[u8]) -> Result<Option<Text>, DecodeError> {
        let Some(value) = self.attribute(name) else {
            return Ok(None);
        };
        let octets = self.unescaped(value)?;
        Ok(Some(self.text_of(octets)))
    }

    /// What an element says: its text, else the first of these attributes, else what a `url`
    /// within it says.
    #[inline]
    pub(super) fn value(
        &mut self,
        element: &Element,
        attributes: &[&[u8]],
    ) -> Result<Octets, DecodeError> {
        match self.plain_text(element)? {
            Some(text) => Ok(Octets::shared(text)),
            None => self.any_value(element, attributes),
        }
    }

    #[inline(never)]
    fn any_value(
        &mut self,
        element: &Element,
        attributes: &[&[u8]],
    ) -> Result<Octets, DecodeError> {
        let attribute = self.one_attribute(attributes);
        let mut text = Octets::default();
        let mut url = None;
        while let Some(child) = self.text(element, &mut text)? {
            if child.tag == Tag::Url && url.is_none() {
                url = Some(self.url(&child)?);
            } else {
                self.skip(&child)?;
            }
        }
        match (attribute, url) {
            (None, None) => Ok(text),
            (Some(value), _) if is_blank(text.as_slice(self)) => self.unescaped(value),
            (None, Some(url)) if is_blank(text.as_slice(self)) => Ok(url),
            _ => Ok(text),
        }
    }

    /// The text of a `url`, which has no further one within it.
    fn url(&mut self, element: &Element) -> Result<Octets, DecodeError> {
        let attribute = self.one_attribute(&[b"href", b"value"]);
        let mut text = Octets::default();
        while let Some(child) = self.text(element, &mut text)? {
            self.skip(&child)?;
        }
        match attribute {
            Some(value) if is_blank(text.as_slice(self)) => self.unescaped(value),
            _ => Ok(text.trimmed(self)),
        }
    }

    /// Adds the text up to the next element within this one, or to its end.
    #[inline]
    pub(super) fn text(
        &mut self,
        element: &Element,
        text: &mut Octets,
    ) -> Result<Option<Element>, DecodeError> {
        if element.empty {
            return Ok(None);
        }
        loop {
            let rest = self.rest();
            let len = memchr2(b'<', b'&', rest).ok_or_else(|| self.too_short())?;
            text.add(self.at..self.at + len, self);
            self.at += len;
            match rest.get(len..).unwrap_or_default() {
                [b'&', ..] => {
                    let character = self.reference()?;
                    text.add_character(character, self);
                }
                [b'<', b'/', ..] => return self.close(element).map(|()| None),
                [b'<', b'!', b'[', ..] => {
                    let section = self.section()?;
                    text.add(section, self);
                }
                [b'<', b'!' | b'?', ..] => self.skip_markup()?,
                _ => return self.open().map(Some),
            }
        }
    }

    /// The octets, shared with the input if they stand there in one piece.
    #[inline]
    pub(super) fn bytes_of(&self, octets: Octets) -> Bytes {
        match octets.owned {
            Some(owned) => Bytes::from(owned),
            None if octets.shared.is_empty() => Bytes::new(),
            None => self.bytes.slice(octets.shared),
        }
    }

    /// The text, with U+FFFD for what is not UTF-8.
    #[inline]
    pub(super) fn text_of(&self, octets: Octets) -> Text {
        match octets.owned {
            Some(owned) => Text::from_utf8_lossy(Bytes::from(owned)),
            None => self.shared_text(octets.shared),
        }
    }

    #[inline]
    fn shared_text(&self, text: Range<usize>) -> Text {
        if let Some(short) = Text::short(self.octets(text.clone())) {
            return short;
        }
        Text::from_utf8(self.bytes.slice(text.clone()))
            .unwrap_or_else(|_| Text::from_utf8_lossy(self.bytes.slice(text)))
    }
}

fn is_blank(octets: &[u8]) -> bool {
    octets.iter().all(|octet| is_space(*octet))
}
