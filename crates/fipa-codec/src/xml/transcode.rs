use std::ops::Range;

use bytes::Bytes;
use encoding_rs::{UTF_16BE, UTF_16LE};

use crate::charset::{Charset, Named};
use crate::{DecodeError, Fault};

/// The beginning of an input as UTF-8.
pub(super) struct Transcoded<'a> {
    pub(super) text: Bytes,
    octets: &'a [u8],
    charset: Charset,
    /// Octets of the byte order mark in front of them.
    mark: usize,
}

impl<'a> Transcoded<'a> {
    #[cold]
    fn new(octets: &'a [u8], mark: usize, charset: Charset) -> Transcoded<'a> {
        let octets = octets.get(mark..).unwrap_or_default();
        Transcoded {
            text: charset.transcoded(octets),
            octets,
            charset,
            mark,
        }
    }

    /// Where in the input that stands which stands here in the text.
    pub(super) fn position(&self, at: usize) -> usize {
        let read = match self.text.get(..at) {
            Some(text) if at < self.text.len() => self
                .charset
                .octets_read(self.octets, &String::from_utf8_lossy(text)),
            _ => self.octets.len(),
        };
        self.mark + read
    }
}

/// The input as UTF-8 if it is in UTF-16, which its first octets tell.
#[inline]
pub(super) fn from_utf16(bytes: &[u8], max_octets: usize) -> Option<Transcoded<'_>> {
    let (mark, encoding) = match bytes {
        [0xfe, 0xff, ..] => (2, UTF_16BE),
        [0xff, 0xfe, ..] => (2, UTF_16LE),
        [0, b'<', ..] => (0, UTF_16BE),
        [b'<', 0, ..] => (0, UTF_16LE),
        _ => return None,
    };
    let octets = bytes.get(..max_octets).unwrap_or(bytes);
    // Half a unit is nothing yet.
    let octets = octets.get(..octets.len() & !1).unwrap_or_default();
    Some(Transcoded::new(octets, mark, Charset::Other(encoding)))
}

/// The input up to its `end` as UTF-8 if its declaration says that it is in another charset.
///
/// What is declared as UTF-16 and has its declaration in ASCII is not in UTF-16.
#[inline]
pub(super) fn from_declared<'a>(
    bytes: &'a [u8],
    end: impl FnOnce(&[u8]) -> Option<usize>,
    max_octets: usize,
) -> Result<Option<Transcoded<'a>>, DecodeError> {
    // What nearly everybody writes declares none.
    if bytes.starts_with(b"<?xml version=\"1.0\"?>") || !bytes.starts_with(b"<?xml") {
        return Ok(None);
    }
    by_declaration(bytes, end, max_octets)
}

#[cold]
fn by_declaration<'a>(
    bytes: &'a [u8],
    end: impl FnOnce(&[u8]) -> Option<usize>,
    max_octets: usize,
) -> Result<Option<Transcoded<'a>>, DecodeError> {
    let Some(name) = declared_encoding(bytes) else {
        return Ok(None);
    };
    match Named::of(&String::from_utf8_lossy(
        bytes.get(name.clone()).unwrap_or_default(),
    )) {
        Named::Utf8 | Named::Wide => Ok(None),
        Named::Unknown => Err(DecodeError {
            offset: name.start,
            fault: Fault::Unsupported,
            what: "nobody here knows this encoding",
        }),
        Named::Charset(charset) => {
            let len = end(bytes).unwrap_or(bytes.len()).min(max_octets);
            let octets = bytes.get(..len).unwrap_or(bytes);
            Ok(Some(Transcoded::new(octets, 0, charset)))
        }
    }
}

/// Where the name of the encoding stands in the declaration, which begins the input if there is
/// one.
fn declared_encoding(bytes: &[u8]) -> Option<Range<usize>> {
    let text = bytes.strip_prefix(b"<?xml")?;
    if !text.first()?.is_ascii_whitespace() {
        return None;
    }
    let text = text.get(..DECLARATION).unwrap_or(text);
    let text = text.get(..memchr::memmem::find(text, b"?>")?)?;
    let found = memchr::memmem::find(text, b"encoding")?;
    let value = text.get(found + 8..)?.trim_ascii_start();
    let value = value.strip_prefix(b"=")?.trim_ascii_start();
    let (quote, value) = value.split_first()?;
    let len = memchr::memchr(*quote, value)?;
    let start = 5 + text.len() - value.len();
    Some(start..start + len)
}

/// Octets within which a declaration ends.
const DECLARATION: usize = 256;
