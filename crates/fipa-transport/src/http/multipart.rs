//! The body of a letter's request: envelope and payload as the two parts of a MIME multipart
//! (RFC 2046 section 5.1).

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
pub(super) fn boundary_of(content_type: &str) -> Result<String, MultipartError> {
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
fn parameter(parameters: &str, wanted: &str) -> Option<String> {
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

fn value_of(text: &str) -> (String, &str) {
    let Some(quoted) = text.strip_prefix('"') else {
        let end = text.find(';').unwrap_or(text.len());
        return (text[..end].trim_end().to_owned(), &text[end..]);
    };
    let mut value = String::new();
    let mut chars = quoted.char_indices();
    while let Some((at, c)) = chars.next() {
        match c {
            '"' => return (value, &quoted[at + 1..]),
            '\\' => value.extend(chars.next().map(|(_, escaped)| escaped)),
            c => value.push(c),
        }
    }
    (value, "")
}

/// Envelope and payload as they stand in a body, octet for octet; further parts are ignored.
///
/// Lines may end in a bare line feed. The line end in front of a delimiter belongs to it.
pub(super) fn read(body: &Bytes, boundary: &str) -> Result<(Bytes, Bytes), MultipartError> {
    let delimiter = format!("--{boundary}");
    let mut delimiters = Delimiters {
        finder: Finder::new(delimiter.as_bytes()),
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
    finder: Finder<'a>,
    body: &'a [u8],
    at: usize,
}

impl Delimiters<'_> {
    fn next(&mut self, what: &'static str) -> Result<Delimiter, MultipartError> {
        let from = self.at;
        loop {
            let rest = self.body.get(self.at..).unwrap_or_default();
            let Some(found) = self.finder.find(rest) else {
                return Err(MultipartError::Truncated { at: from, what });
            };
            let begin = self.at + found;
            self.at = begin + 1;
            if let Some(delimiter) = self.delimiter(begin) {
                // The line end of one delimiter may be that in front of the next.
                self.at = delimiter.end.saturating_sub(1);
                return Ok(Delimiter {
                    begin: delimiter.begin.max(from),
                    ..delimiter
                });
            }
        }
    }

    /// The delimiter whose dashes stand here, if it fills its line.
    fn delimiter(&self, dashes: usize) -> Option<Delimiter> {
        let before = self.body.get(..dashes)?;
        let begin = match before {
            [] => 0,
            [.., b'\r', b'\n'] => dashes - 2,
            [.., b'\n'] => dashes - 1,
            _ => return None,
        };
        let mut end = dashes + self.finder.needle().len();
        let mut rest = self.body.get(end..)?;
        let closes = rest.starts_with(b"--");
        if closes {
            end += 2;
            rest = rest.get(2..)?;
        }
        let padding = rest
            .iter()
            .take_while(|o| matches!(o, b' ' | b'\t'))
            .count();
        let line_end = match rest.get(padding..)? {
            [b'\r', b'\n', ..] => 2,
            [b'\n', ..] => 1,
            // Nothing needs to follow the last delimiter, and what does is not read.
            [] if closes => 0,
            _ => return None,
        };
        end += padding + line_end;
        Some(Delimiter { begin, end, closes })
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

/// A body that holds envelope and payload, with the boundary between them.
#[derive(Clone, Debug)]
pub(super) struct Multipart {
    /// The boundary, which stands nowhere else in the body.
    pub(super) boundary: String,
    /// The octets of the body, in parts that follow each other.
    pub(super) parts: [Bytes; 5],
}

impl Multipart {
    /// The body around an envelope in XML and a payload of this media type.
    pub(super) fn new(
        envelope: &Bytes,
        payload: &Bytes,
        payload_type: &str,
        random: &mut fastrand::Rng,
    ) -> Multipart {
        let boundary = loop {
            let boundary: String = (0..BOUNDARY).map(|_| digit(random)).collect();
            let finder = Finder::new(boundary.as_bytes());
            if finder.find(envelope).is_none() && finder.find(payload).is_none() {
                break boundary;
            }
        };
        let head = format!("{PREAMBLE}--{boundary}\r\nContent-Type: application/xml\r\n\r\n");
        let between = format!("\r\n--{boundary}\r\nContent-Type: {payload_type}\r\n\r\n");
        let tail = format!("\r\n--{boundary}--\r\n");
        Multipart {
            boundary,
            parts: [
                head.into(),
                envelope.clone(),
                between.into(),
                payload.clone(),
                tail.into(),
            ],
        }
    }

    /// Octets of the body.
    pub(super) fn len(&self) -> usize {
        self.parts.iter().map(Bytes::len).sum()
    }
}

fn digit(random: &mut fastrand::Rng) -> char {
    char::from_digit(random.u32(..16), 16).unwrap_or('0')
}

#[cfg(test)]
#[path = "multipart_tests.rs"]
mod tests;
