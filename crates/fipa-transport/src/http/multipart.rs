//! The body of a letter's request: envelope and payload as the two parts of a MIME multipart
//! (RFC 2046 section 5.1).

use std::borrow::Cow;
use std::ops::Range;

use bytes::Bytes;
use memchr::memmem::Finder;

/// What stands in front of the first part; no reader looks at it.
const PREAMBLE: &str = "This is not part of the MIME multipart encoded message.\r\n";

/// Digits of a boundary that we make; JADE takes no other number.
const BOUNDARY: usize = 31;

/// Octets of a boundary at most (RFC 2046 section 5.1.1).
const LONGEST_BOUNDARY: usize = 70;

/// Octets of the header of a part at most.
const LONGEST_HEADER: usize = 16 << 10;

/// Why a body does not hold an envelope and a payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum MultipartError {
    /// The Content-Type is another one, or there is none.
    #[error("the Content-Type is not multipart/mixed")]
    NotMultipart,
    /// The Content-Type has no boundary that could be one.
    #[error("the Content-Type names no boundary")]
    NoBoundary,
    /// The body ends before a delimiter that must come.
    #[error("octet {at}: the body ends, and {what} is missing")]
    Truncated {
        /// Where what is missing was looked for.
        at: usize,
        /// What is missing.
        what: &'static str,
    },
    /// The header of a part is none.
    #[error("octet {at}: the header of a part does not end in an empty line")]
    Header {
        /// Where the header begins.
        at: usize,
    },
    /// A part is in base64 or quoted-printable.
    #[error(
        "octet {at}: the part has a Content-Transfer-Encoding; its octets must stand as they are"
    )]
    Encoded {
        /// Where the header begins.
        at: usize,
    },
}

/// The boundary that a Content-Type names: in quotes or without, in any case, and
/// `multipart-mixed` as the standard misprints it.
pub(super) fn boundary_of(content_type: &str) -> Result<Cow<'_, str>, MultipartError> {
    let (kind, parameters) = content_type.split_once(';').unwrap_or((content_type, ""));
    let kind = kind.trim();
    if !kind.eq_ignore_ascii_case("multipart/mixed")
        && !kind.eq_ignore_ascii_case("multipart-mixed")
    {
        return Err(MultipartError::NotMultipart);
    }
    let boundary = parameter(parameters, "boundary").ok_or(MultipartError::NoBoundary)?;
    let is_allowed = |octet: u8| octet == b' ' || octet.is_ascii_graphic();
    match boundary.len() {
        1..=LONGEST_BOUNDARY if boundary.bytes().all(is_allowed) && !boundary.ends_with(' ') => {
            Ok(boundary)
        }
        _ => Err(MultipartError::NoBoundary),
    }
}

/// The value of a parameter, `;` within quotes and escapes heeded.
fn parameter<'a>(parameters: &'a str, wanted: &str) -> Option<Cow<'a, str>> {
    let mut rest = parameters;
    loop {
        rest = rest.trim_start_matches([';', ' ', '\t', '\r', '\n']);
        let (name, value) = rest.split_once('=')?;
        let (value, after) = value_of(value.trim_start());
        if name.trim().eq_ignore_ascii_case(wanted) {
            return Some(value);
        }
        rest = after;
    }
}

fn value_of(text: &str) -> (Cow<'_, str>, &str) {
    let Some(quoted) = text.strip_prefix('"') else {
        let end = text.find(';').unwrap_or(text.len());
        let (value, after) = text.split_at(end);
        return (value.trim_end().into(), after);
    };
    if let Some((value, after)) = quoted.split_once('"')
        && !value.contains('\\')
    {
        return (value.into(), after);
    }
    let mut value = String::new();
    let mut chars = quoted.chars();
    while let Some(c) = chars.next() {
        match c {
            '"' => break,
            '\\' => value.extend(chars.next()),
            c => value.push(c),
        }
    }
    (value.into(), chars.as_str())
}

/// Envelope and payload as they stand in a body, octet for octet; further parts are ignored.
///
/// Lines may end in a bare line feed. The line end in front of a delimiter belongs to it.
pub(super) fn read(body: &Bytes, boundary: &str) -> Result<(Bytes, Bytes), MultipartError> {
    let mut delimiters = Delimiters {
        boundary: boundary.as_bytes(),
        body,
        at: 0,
    };
    let first = delimiters.next("the first delimiter")?;
    if first.closes {
        return Err(MultipartError::Truncated {
            at: first.end,
            what: "the envelope",
        });
    }
    let second = delimiters.next("the delimiter behind the envelope")?;
    let envelope = content(body, first.end..second.begin)?;
    if second.closes {
        return Err(MultipartError::Truncated {
            at: second.end,
            what: "the payload",
        });
    }
    let third = delimiters.next("the delimiter behind the payload")?;
    let payload = content(body, second.end..third.begin)?;
    Ok((envelope, payload))
}

/// A delimiter line, with the line end in front of it and its own.
struct Delimiter {
    begin: usize,
    end: usize,
    closes: bool,
}

struct Delimiters<'a> {
    boundary: &'a [u8],
    body: &'a [u8],
    /// The beginning of the line that is looked at next.
    at: usize,
}

impl Delimiters<'_> {
    fn next(&mut self, what: &'static str) -> Result<Delimiter, MultipartError> {
        let from = self.at;
        loop {
            if let Some(delimiter) = self.delimiter(self.at) {
                self.at = delimiter.end;
                return Ok(Delimiter {
                    // The line end of one delimiter may be that in front of the next.
                    begin: delimiter.begin.max(from),
                    ..delimiter
                });
            }
            let rest = self.body.get(self.at..).unwrap_or_default();
            let Some(line) = memchr::memchr(b'\n', rest) else {
                return Err(MultipartError::Truncated { at: from, what });
            };
            self.at += line + 1;
        }
    }

    /// The delimiter that the line is which begins here, if it is one.
    fn delimiter(&self, line: usize) -> Option<Delimiter> {
        let rest = self.body.get(line..)?.strip_prefix(b"--")?;
        let mut rest = rest.strip_prefix(self.boundary)?;
        let closes = rest.starts_with(b"--");
        if closes {
            rest = rest.get(2..)?;
        }
        let padding = rest
            .iter()
            .take_while(|o| matches!(o, b' ' | b'\t'))
            .count();
        let behind = match rest.get(padding..)? {
            [b'\r', b'\n', behind @ ..] | [b'\n', behind @ ..] => behind,
            // Nothing needs to follow the last delimiter, and what does is not read.
            behind @ [] if closes => behind,
            _ => return None,
        };
        let line_end = match self.body.get(..line)? {
            [.., b'\r', b'\n'] => 2,
            [.., b'\n'] => 1,
            _ => 0,
        };
        Some(Delimiter {
            begin: line - line_end,
            end: self.body.len() - behind.len(),
            closes,
        })
    }
}

/// What stands behind the header of a part.
fn content(body: &Bytes, part: Range<usize>) -> Result<Bytes, MultipartError> {
    let Range { start, end } = part;
    let octets = body.get(start..end).unwrap_or_default();
    let mut at = 0;
    loop {
        let rest = octets.get(at..).unwrap_or_default();
        let length = memchr::memchr(b'\n', rest);
        let Some(length) = length.filter(|length| at + length < LONGEST_HEADER) else {
            return Err(MultipartError::Header { at: start });
        };
        let line = rest.get(..length).unwrap_or_default();
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        at += length + 1;
        if line.is_empty() {
            return Ok(body.slice(start + at..end));
        }
        check_field(line, start)?;
    }
}

fn check_field(line: &[u8], at: usize) -> Result<(), MultipartError> {
    if line.starts_with(b" ") || line.starts_with(b"\t") {
        return Ok(());
    }
    let colon = memchr::memchr(b':', line).ok_or(MultipartError::Header { at })?;
    let (name, value) = line.split_at(colon);
    let value = value.get(1..).unwrap_or_default().trim_ascii();
    let as_it_is = [&b"7bit"[..], b"8bit", b"binary"];
    let is_encoding = name
        .trim_ascii_end()
        .eq_ignore_ascii_case(b"Content-Transfer-Encoding");
    match is_encoding && !as_it_is.iter().any(|one| value.eq_ignore_ascii_case(one)) {
        true => Err(MultipartError::Encoded { at }),
        false => Ok(()),
    }
}

/// What stands between the parts of bodies.
#[derive(Clone, Debug)]
pub(super) struct Boundary {
    text: String,
    finder: Finder<'static>,
}

impl Boundary {
    /// One that nobody could know before.
    pub(super) fn random(random: &mut fastrand::Rng) -> Boundary {
        let text = (0..BOUNDARY).map(|_| digit(random)).collect::<String>();
        let finder = Finder::new(text.as_bytes()).into_owned();
        Boundary { text, finder }
    }

    pub(super) fn as_str(&self) -> &str {
        &self.text
    }

    fn is_in(&self, octets: &[u8]) -> bool {
        self.finder.find(octets).is_some()
    }
}

/// A body that holds envelope and payload, with a boundary that stands nowhere else in it.
#[derive(Clone, Debug)]
pub(super) struct Multipart<'a> {
    pub(super) boundary: Cow<'a, Boundary>,
    envelope: &'a [u8],
    payload: &'a [u8],
    payload_type: &'a str,
}

impl<'a> Multipart<'a> {
    /// The body around an envelope in XML and a payload of this media type; where they hold the
    /// boundary, which whoever had a letter before knows, with another one.
    pub(super) fn new(
        boundary: &'a Boundary,
        envelope: &'a [u8],
        payload: &'a [u8],
        payload_type: &'a str,
    ) -> Multipart<'a> {
        let mut boundary = Cow::Borrowed(boundary);
        while boundary.is_in(envelope) || boundary.is_in(payload) {
            boundary = Cow::Owned(Boundary::random(&mut fastrand::Rng::new()));
        }
        Multipart {
            boundary,
            envelope,
            payload,
            payload_type,
        }
    }

    /// What stands in front of the payload, piece by piece.
    fn head(&self) -> [&[u8]; 10] {
        let boundary = self.boundary.as_str().as_bytes();
        [
            PREAMBLE.as_bytes(),
            b"--",
            boundary,
            b"\r\nContent-Type: application/xml\r\n\r\n",
            self.envelope,
            b"\r\n--",
            boundary,
            b"\r\nContent-Type: ",
            self.payload_type.as_bytes(),
            b"\r\n\r\n",
        ]
    }

    /// What stands behind it.
    fn tail(&self) -> [&[u8]; 3] {
        [b"\r\n--", self.boundary.as_str().as_bytes(), b"--\r\n"]
    }

    /// Octets of the body.
    pub(super) fn len(&self) -> usize {
        let around = self.head().into_iter().chain(self.tail());
        around.map(<[u8]>::len).sum::<usize>() + self.payload.len()
    }

    /// Writes what stands in front of the payload.
    pub(super) fn write_head(&self, out: &mut Vec<u8>) {
        let pieces = self.head().into_iter();
        pieces.for_each(|piece| out.extend_from_slice(piece));
    }

    /// Writes what stands behind it.
    pub(super) fn write_tail(&self, out: &mut Vec<u8>) {
        let pieces = self.tail().into_iter();
        pieces.for_each(|piece| out.extend_from_slice(piece));
    }
}

fn digit(random: &mut fastrand::Rng) -> char {
    char::from_digit(random.u32(..16), 16).unwrap_or('0')
}

#[cfg(test)]
#[path = "multipart_tests.rs"]
mod tests;
