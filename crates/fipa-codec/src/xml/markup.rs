use std::ops::Range;

use memchr::memmem;
use quick_xml::parser::{CommentParser, Parser, PiParser};

use super::cursor::Cursor;
use crate::{DecodeError, Fault};

/// How a section begins, whose text has no references in it.
pub(super) const SECTION: &[u8] = b"<![CDATA[";

/// How it ends.
pub(super) const END_OF_SECTION: &[u8] = b"]]>";

impl Cursor<'_> {
    /// Comments, instructions, and sections of text where text has no meaning.
    pub(super) fn skip_markup(&mut self) -> Result<(), DecodeError> {
        match self.rest() {
            [b'<', b'?', ..] => self.skip_instruction(),
            [b'<', b'!', b'[', ..] => self.section().map(drop),
            _ => self.skip_comment(),
        }
    }

    /// The text in `<![CDATA[…]]>`.
    pub(super) fn section(&mut self) -> Result<Range<usize>, DecodeError> {
        let Some(text) = self.rest().strip_prefix(SECTION) else {
            return Err(self.error(Fault::Malformed, "no markup begins like this"));
        };
        let start = self.at + SECTION.len();
        let len = memmem::find(text, END_OF_SECTION).ok_or_else(|| self.too_short())?;
        self.go_to(start + len + END_OF_SECTION.len());
        Ok(start..start + len)
    }

    pub(super) fn skip_comment(&mut self) -> Result<(), DecodeError> {
        match self.rest().strip_prefix(b"<!--") {
            Some(text) => self.skip_through(4, CommentParser::default().feed(text)),
            None => Err(self.error(Fault::Malformed, "no markup begins like this")),
        }
    }

    pub(super) fn skip_instruction(&mut self) -> Result<(), DecodeError> {
        let text = self.rest().get(2..).unwrap_or_default();
        // The parser of quick-xml counts up to the last octet, that of comments beyond it.
        let len = PiParser(false).feed(text).map(|last| last + 1);
        self.skip_through(2, len)
    }

    /// A reference to a document type says nothing about a message. An internal subset could
    /// define what its text stands for.
    pub(super) fn skip_document_type(&mut self) -> Result<(), DecodeError> {
        let Some(text) = self.rest().strip_prefix(b"<!DOCTYPE") else {
            return Err(self.error(Fault::Malformed, "no markup begins like this"));
        };
        let mut quote = None;
        for (i, octet) in text.iter().enumerate() {
            match (quote, octet) {
                (None, b'>') => return self.skip_through(9, Some(i + 1)),
                (None, b'[') => {
                    self.go_to(self.at + 9 + i);
                    return Err(self.error(Fault::Unsupported, "an internal subset"));
                }
                (None, b'"' | b'\'') => quote = Some(octet),
                (Some(open), octet) if open == octet => quote = None,
                _ => {}
            }
        }
        Err(self.too_short())
    }

    fn skip_through(&mut self, prefix: usize, len: Option<usize>) -> Result<(), DecodeError> {
        let len = len.ok_or_else(|| self.too_short())?;
        self.go_to(self.at + prefix + len);
        Ok(())
    }
}
