use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bytes::Bytes;
use fipa_acl::{Expression, Text};
use memchr::{memchr, memchr3, memchr3_iter, memmem};

use super::markup::{END_OF_SECTION, SECTION};
use crate::decimal::Decimal;
use crate::{EncodeError, Output};

/// Octets that are encoded in Base64 at once; a multiple of three.
const BASE64_PIECE: usize = 3 * 256;

/// Octets that are looked at together.
const PIECE: usize = 64;

/// Where a text stands: more has to be escaped in attributes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    Text,
    Attribute,
}

/// An element that is written, as its parts.
#[derive(Clone, Copy)]
pub(super) struct Element {
    pub(super) name: &'static str,
    pub(super) open: &'static str,
    pub(super) close: &'static str,
}

macro_rules! element {
    ($name:literal) => {
        $crate::xml::writer::Element {
            name: $name,
            open: concat!("<", $name, ">"),
            close: concat!("</", $name, ">"),
        }
    };
}
pub(super) use element;

impl Element {
    /// The element with a text in it.
    #[inline]
    pub(super) fn write(self, text: &str, out: &mut Output) -> Result<(), EncodeError> {
        out.put_slice(self.open.as_bytes());
        write_text(text, Place::Text, self.name, out)?;
        out.put_slice(self.close.as_bytes());
        Ok(())
    }

    /// The element with a text in it; an empty text is an absent one.
    #[inline]
    pub(super) fn write_optional(
        self,
        text: &Option<Text>,
        out: &mut Output,
    ) -> Result<(), EncodeError> {
        match text {
            Some(text) if !text.is_empty() => self.write(text, out),
            _ => Ok(()),
        }
    }
}

/// Writes text with references for what has a meaning in XML.
#[inline]
pub(super) fn write_text(
    text: &str,
    place: Place,
    parameter: &'static str,
    out: &mut Output,
) -> Result<(), EncodeError> {
    if is_plain(text.as_bytes()) {
        out.put_slice(text.as_bytes());
        return Ok(());
    }
    if !is_legal(text.as_bytes()) {
        return Err(EncodeError {
            parameter,
            what: "a character that XML cannot hold",
        });
    }
    write_escaped(text.as_bytes(), place, out);
    Ok(())
}

/// Writes the text of an expression.
pub(super) fn write_expression(
    value: &Expression,
    place: Place,
    parameter: &'static str,
    out: &mut Output,
) -> Result<(), EncodeError> {
    match value.as_str() {
        Some(text) => write_text(text, place, parameter, out),
        None => write_text(&value.to_string(), place, parameter, out),
    }
}

/// Whether an expression is written at all: an empty text is an absent one.
pub(super) fn is_empty(value: &Expression) -> bool {
    value.as_str().is_some_and(str::is_empty)
}

/// Writes octets that [`is_text`], as they are and by reference if that is possible.
pub(super) fn write_content(octets: &Bytes, out: &mut Output) {
    let has_return = memchr(b'\r', octets).is_some();
    if has_return {
        write_escaped(octets, Place::Text, out);
    } else if memchr3(b'&', b'<', b'>', octets).is_none() {
        out.put_shared(octets);
    } else if section_pays(octets) {
        write_section(octets, out);
    } else {
        write_escaped(octets, Place::Text, out);
    }
}

/// Writes octets without `]]>` as a section, by reference.
pub(super) fn write_section(octets: &Bytes, out: &mut Output) {
    out.put_slice(SECTION);
    out.put_shared(octets);
    out.put_slice(END_OF_SECTION);
}

/// Writes a document that is UTF-8 as ASCII without line ends: with references, which can stand
/// wherever it has something else.
pub(super) fn write_plain(document: &str, out: &mut Output) {
    let is_plain = |character: char| character.is_ascii() && character != '\n';
    let mut rest = document;
    while let Some(at) = rest.find(|character| !is_plain(character)) {
        let (plain, other) = rest.split_at(at);
        out.put_slice(plain.as_bytes());
        let mut characters = other.chars();
        let code = characters.next().map_or(0, u32::from);
        out.put_slice(b"&#");
        out.put_slice(Decimal::new(code.into()).as_bytes());
        out.put_u8(b';');
        rest = characters.as_str();
    }
    out.put_slice(rest.as_bytes());
}

/// Whether octets without a carriage return, which would be read as a line feed, are shorter in a
/// section: it has twelve octets, and a reference three more than what it stands for at least.
///
/// An end of a section among them would have to be split, and is read differently by peers.
fn section_pays(octets: &[u8]) -> bool {
    memchr3_iter(b'&', b'<', b'>', octets).nth(4).is_some()
        && memmem::find(octets, END_OF_SECTION).is_none()
}

/// Writes octets in Base64.
pub(super) fn write_base64(octets: &[u8], out: &mut Output) {
    out.reserve(octets.len().div_ceil(3) * 4);
    let mut buffer = [0; BASE64_PIECE / 3 * 4];
    for piece in octets.chunks(BASE64_PIECE) {
        // The buffer has room for the longest piece.
        let len = STANDARD
            .encode_slice(piece, &mut buffer)
            .unwrap_or_default();
        out.put_slice(buffer.get(..len).unwrap_or_default());
    }
}

/// Whether XML can hold the octets as text.
pub(super) fn is_text(octets: &[u8]) -> bool {
    std::str::from_utf8(octets).is_ok() && is_legal(octets)
}

/// Whether no octet has a meaning or may be part of something that XML cannot hold.
#[inline]
fn is_plain(octets: &[u8]) -> bool {
    let needs_care = |octet: u8| {
        (octet < 0x20) | (octet == b'&') | (octet == b'<') | (octet == b'>') | (octet == b'"')
    };
    !any_octet(octets, needs_care) && !has_noncharacter(octets)
}

/// Whether XML 1.0 allows all characters of what is UTF-8.
fn is_legal(octets: &[u8]) -> bool {
    let is_control =
        |octet: u8| (octet < 0x20) & (octet != b'\t') & (octet != b'\n') & (octet != b'\r');
    !any_octet(octets, is_control) && !has_noncharacter(octets)
}

/// Looks at many octets at once, which is faster than to stop at the first.
#[inline(always)]
fn any_octet(octets: &[u8], is: impl Fn(u8) -> bool) -> bool {
    let (pieces, rest) = octets.as_chunks::<PIECE>();
    let in_piece = |piece: &[u8; PIECE]| piece.iter().fold(0, |any, o| any | u8::from(is(*o)));
    pieces.iter().any(|piece| in_piece(piece) != 0) || rest.iter().any(|octet| is(*octet))
}

/// U+FFFE and U+FFFF.
#[inline]
fn has_noncharacter(octets: &[u8]) -> bool {
    memchr(0xef, octets).is_some_and(|first| {
        let octets = octets.get(first..).unwrap_or_default();
        memmem::find(octets, b"\xef\xbf\xbe").is_some()
            || memmem::find(octets, b"\xef\xbf\xbf").is_some()
    })
}

pub(super) fn write_escaped(octets: &[u8], place: Place, out: &mut Output) {
    let mut rest = octets;
    let has_return = place == Place::Text && memchr(b'\r', octets).is_some();
    while let Some((len, reference)) = next_escape(rest, place, has_return) {
        let (plain, behind) = rest.split_at_checked(len).unwrap_or((rest, &[]));
        out.put_slice(plain);
        out.put_slice(reference);
        rest = behind.get(1..).unwrap_or_default();
    }
    out.put_slice(rest);
}

/// The next octet that must be written in another way, and the way.
fn next_escape(octets: &[u8], place: Place, has_return: bool) -> Option<(usize, &'static [u8])> {
    if place == Place::Text && !has_return {
        let found = memchr3(b'&', b'<', b'>', octets)?;
        return escape(*octets.get(found)?, place).map(|reference| (found, reference));
    }
    let mut numbered = octets.iter().enumerate();
    numbered.find_map(|(i, octet)| escape(*octet, place).map(|reference| (i, reference)))
}

/// A carriage return would be read as a line feed, white space in an attribute as a blank.
#[inline]
fn escape(octet: u8, place: Place) -> Option<&'static [u8]> {
    if octet > b'>' {
        return None;
    }
    let in_attribute = place == Place::Attribute;
    Some(match octet {
        b'&' => b"&amp;",
        b'<' => b"&lt;",
        b'>' => b"&gt;",
        b'\r' => b"&#13;",
        b'"' if in_attribute => b"&quot;",
        b'\t' if in_attribute => b"&#9;",
        b'\n' if in_attribute => b"&#10;",
        _ => return None,
    })
}
