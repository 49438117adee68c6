use std::ops::Range;

use base64::Engine;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use bytes::Bytes;
use fipa_acl::{Message, UserDefined};
use memchr::memmem;

use super::cursor::{Cursor, Element, is_space};
use super::markup::SECTION;
use super::text::Octets;
use super::values::ATTRIBUTES;
use crate::{DecodeError, Fault};

/// The user-defined parameter that says how the content is written, without its `X-`.
pub(super) const ENCODING_PARAMETER: &str = "JADE-Encoding";
/// Its only value.
pub(super) const BASE64: &str = "Base64";

/// Which end tag ends a text that was written without escaping it.
#[derive(Clone, Copy)]
pub(super) enum EndTag {
    First,
    Last,
}

impl Cursor<'_> {
    /// The content, exactly as it stands there: it is octets, and no rule for texts applies to
    /// them but that references are resolved. An empty one is an absent one.
    pub(super) fn content(&mut self, element: &Element) -> Result<Option<Bytes>, DecodeError> {
        let octets = if self.lenient {
            self.unescaped_text(element, EndTag::Last, ATTRIBUTES)?
        } else if let Some(section) = self.raw_section(element)? {
            Octets::shared(section)
        } else {
            self.escaped_content(element)?
        };
        Ok(Some(self.bytes_of(octets)).filter(|content| !content.is_empty()))
    }

    /// Text up to an end tag with whatever stands in between; an empty element has it in one of
    /// these attributes. A section that is all of the text is opened.
    pub(super) fn unescaped_text(
        &mut self,
        element: &Element,
        which: EndTag,
        attributes: &[&[u8]],
    ) -> Result<Octets, DecodeError> {
        if element.empty {
            return self.value(element, attributes);
        }
        let end_tag = [b"</", self.octets(element.name.clone()), b">"].concat();
        let found = match which {
            EndTag::First => memmem::find(self.rest(), &end_tag),
            EndTag::Last => memmem::rfind(self.rest(), &end_tag),
        };
        let len = found.ok_or_else(|| self.too_short())?;
        let text = self.at..self.at + len;
        self.at = text.end;
        self.close(element)?;
        let octets = self.octets(text.clone());
        let section = octets.strip_prefix(SECTION);
        Ok(Octets::shared(
            match section.and_then(|inner| inner.strip_suffix(b"]]>")) {
                Some(_) => text.start + SECTION.len()..text.end - 3,
                None => text,
            },
        ))
    }

    /// A section that is all of the content. fipa_acl writes one with whatever octets there are,
    /// `]]>` too: it ends in front of the end tag.
    fn raw_section(&mut self, element: &Element) -> Result<Option<Range<usize>>, DecodeError> {
        if element.empty || !self.raw_ends {
            return Ok(None);
        }
        let Some(text) = self.rest().strip_prefix(SECTION) else {
            return Ok(None);
        };
        let start = self.at + SECTION.len();
        let name = self.octets(element.name.clone());
        let ends_here = |found: &usize| {
            let behind = text
                .get(found + 5..)
                .and_then(|rest| rest.strip_prefix(name));
            let mut behind = behind.unwrap_or_default().iter();
            behind.find(|octet| !is_space(**octet)) == Some(&b'>')
        };
        let Some(len) = memmem::find_iter(text, b"]]></").find(ends_here) else {
            self.raw_ends = false;
            return Ok(None);
        };
        self.at = start + len + 3;
        self.close(element)?;
        Ok(Some(start..start + len))
    }

    fn escaped_content(&mut self, element: &Element) -> Result<Octets, DecodeError> {
        let attribute = self.one_attribute(ATTRIBUTES);
        let mut text = Octets::default();
        if self.text(element, &mut text)?.is_some() {
            return Err(self.error(Fault::Malformed, "markup within the content"));
        }
        match attribute {
            Some(value) if text.as_slice(self).is_empty() => self.unescaped(value),
            _ => Ok(text),
        }
    }
}

/// Undoes what is done to contents that XML cannot hold: they are written in Base64, and a
/// parameter says so. A content that is not in Base64 is left as it is.
pub(super) fn undo_base64(message: &mut Message) {
    let Some(position) = message.user_defined.iter().rposition(says_base64) else {
        return;
    };
    if let Some(content) = &message.content {
        match from_base64(content) {
            Some(octets) if octets.is_empty() => message.content = None,
            Some(octets) => message.content = Some(Bytes::from(octets)),
            None => return,
        }
    }
    message.user_defined.remove(position);
}

fn says_base64(parameter: &UserDefined) -> bool {
    parameter.name.eq_ignore_ascii_case(ENCODING_PARAMETER)
        && parameter
            .value
            .as_str()
            .is_some_and(|value| value.eq_ignore_ascii_case(BASE64))
}

/// Encoders differ in whether they break lines and fill up the end.
const TOLERANT: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

fn from_base64(text: &[u8]) -> Option<Vec<u8>> {
    if !text.iter().any(|octet| is_space(*octet)) {
        return TOLERANT.decode(text).ok();
    }
    let text: Vec<u8> = text
        .iter()
        .copied()
        .filter(|octet| !is_space(*octet))
        .collect();
    TOLERANT.decode(text).ok()
}
