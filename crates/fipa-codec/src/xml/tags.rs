use std::borrow::Cow;
use std::ops::Range;

use fipa_acl::Text;
use memchr::memchr;
use quick_xml::events::attributes::Attributes;
use quick_xml::parser::{ElementParser, Parser};

use super::cursor::{Cursor, Element, is_space};
use super::names::{LONGEST, Tag};
use super::text::Octets;
use crate::{DecodeError, Fault};

/// Attributes of one element, as many as nobody needs.
const MAX_ATTRIBUTES: usize = 32;

/// Where an attribute stands in the input: its name and its value without the quotes.
pub(super) struct Attribute {
    name: Range<usize>,
    value: Range<usize>,
}

impl Cursor<'_> {
    /// The start tag that begins here.
    #[inline]
    pub(super) fn open(&mut self) -> Result<Element, DecodeError> {
        self.attributes.clear();
        let start = self.at + 1;
        let octets = self.octets(start..self.end);
        // Nearly all tags are one of these, and what is known need not be examined.
        if let Some(len) = memchr(b'>', octets.get(..LONGEST + 1).unwrap_or(octets))
            && let Some(tag) = Tag::known(octets.get(..len).unwrap_or_default())
        {
            self.at = start + len + 1;
            self.entered()?;
            return Ok(Element {
                tag,
                name: start..start + len,
                empty: false,
            });
        }
        self.open_any()
    }

    /// Any start tag: with attributes, with a prefix, of an empty element, of an unknown one.
    #[inline(never)]
    fn open_any(&mut self) -> Result<Element, DecodeError> {
        let start = self.at + 1;
        let octets = self.octets(start..self.end);
        let (len, prefix) = name_len(octets);
        if !begins_name(octets) {
            return Err(self.no_name());
        }
        let empty = self.rest_of_tag(start + len)?;
        if !empty {
            self.entered()?;
        }
        Ok(Element {
            tag: Tag::of(octets.get(prefix..len).unwrap_or_default()),
            name: start..start + len,
            empty,
        })
    }

    /// The value of an attribute of the tag that was read last, prefixes left aside.
    pub(super) fn attribute(&self, name: &[u8]) -> Option<Range<usize>> {
        self.attributes
            .iter()
            .find(|attribute| local(self.octets(attribute.name.clone())) == name)
            .map(|attribute| attribute.value.clone())
    }

    /// The value of the first of these attributes that the tag has.
    pub(super) fn one_attribute(&self, names: &[&[u8]]) -> Option<Range<usize>> {
        if self.attributes.is_empty() {
            return None;
        }
        names.iter().find_map(|name| self.attribute(name))
    }

    /// The name of an element as a text, without its prefix.
    pub(super) fn local_name(&self, element: &Element) -> Text {
        let name = element.name.clone();
        let prefix = name.len() - local(self.octets(name.clone())).len();
        self.text_of(Octets::shared(name.start + prefix..name.end))
    }

    /// What stands behind the name, and whether the tag is that of an empty element.
    fn rest_of_tag(&mut self, start: usize) -> Result<bool, DecodeError> {
        let rest = self.octets(start..self.end);
        let len = ElementParser::Outside
            .feed(rest)
            .ok_or_else(|| self.too_short())?;
        let inner = rest.get(..len).unwrap_or_default();
        let (inner, empty) = match inner.strip_suffix(b"/") {
            Some(inner) => (inner, true),
            None => (inner, false),
        };
        if !inner.iter().all(|octet| is_space(*octet)) {
            self.split_attributes(start, inner)?;
        }
        self.at = start + len + 1;
        Ok(empty)
    }

    fn split_attributes(&mut self, start: usize, inner: &[u8]) -> Result<(), DecodeError> {
        let text = same_length_text(inner);
        let mut attributes = Attributes::new(&text, 0);
        // Ours compares few of them without allocating.
        for attribute in attributes.with_checks(false) {
            let wrong = |cursor: &Self| cursor.error(Fault::Malformed, "no attribute is like this");
            let attribute = attribute.map_err(|_| wrong(self))?;
            let name = within(&text, attribute.key.into_inner()).ok_or_else(|| wrong(self))?;
            let value = within(&text, &attribute.value).ok_or_else(|| wrong(self))?;
            let in_front = name.start.checked_sub(1).and_then(|at| inner.get(at));
            if !in_front.is_some_and(|octet| is_space(*octet)) {
                return Err(wrong(self));
            }
            self.add_attribute(Attribute {
                name: start + name.start..start + name.end,
                value: start + value.start..start + value.end,
            })?;
        }
        Ok(())
    }

    fn add_attribute(&mut self, attribute: Attribute) -> Result<(), DecodeError> {
        if self.attributes.len() == MAX_ATTRIBUTES {
            return Err(self.error(Fault::Limit, "too many attributes"));
        }
        let name = self.octets(attribute.name.clone());
        let is_same = |other: &Attribute| self.octets(other.name.clone()) == name;
        if self.attributes.iter().any(is_same) {
            return Err(DecodeError {
                offset: attribute.name.start,
                fault: Fault::Malformed,
                what: "an attribute that the element has already",
            });
        }
        self.attributes.push(attribute);
        Ok(())
    }

    #[cold]
    fn no_name(&self) -> DecodeError {
        if self.rest().len() < 2 {
            return self.too_short();
        }
        self.error(Fault::Malformed, "no tag begins like this")
    }
}

/// The text, with something else of the same length for what is not UTF-8.
fn same_length_text(octets: &[u8]) -> Cow<'_, str> {
    let replaced = |octet: &u8| {
        if octet.is_ascii() {
            char::from(*octet)
        } else {
            '_'
        }
    };
    match std::str::from_utf8(octets) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(octets.iter().map(replaced).collect()),
    }
}

/// Where a part of a text stands in it.
fn within(text: &str, part: &str) -> Option<Range<usize>> {
    let start = part.as_ptr().addr().checked_sub(text.as_ptr().addr())?;
    let range = start..start.checked_add(part.len())?;
    (range.end <= text.len()).then_some(range)
}

/// The name without its prefix: namespaces have no meaning here.
fn local(name: &[u8]) -> &[u8] {
    let (_, prefix) = name_len(name);
    name.get(prefix..).unwrap_or_default()
}

/// Octets of the name at the beginning, and of its prefix with the colon.
#[inline]
fn name_len(octets: &[u8]) -> (usize, usize) {
    let mut prefix = 0;
    for (i, octet) in octets.iter().enumerate() {
        match KINDS.get(usize::from(*octet)) {
            Some(Kind::Name) => {}
            Some(Kind::Colon) if prefix == 0 => prefix = i + 1,
            Some(Kind::Colon) => {}
            _ => return (i, prefix),
        }
    }
    (octets.len(), prefix)
}

/// What an octet is in a name.
#[derive(Clone, Copy)]
enum Kind {
    Name,
    Colon,
    Other,
}

/// Looked up for every octet of every name, where comparing takes longer.
const KINDS: [Kind; 256] = {
    let mut kinds = [Kind::Other; 256];
    let mut octet = 0;
    while octet < 256 {
        kinds[octet] = match octet as u8 {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | 0x80.. => Kind::Name,
            b':' => Kind::Colon,
            _ => Kind::Other,
        };
        octet += 1;
    }
    kinds
};

fn begins_name(octets: &[u8]) -> bool {
    let first = octets.first();
    first.is_some_and(|first| first.is_ascii_alphabetic() || matches!(first, b'_' | b':' | 0x80..))
}
