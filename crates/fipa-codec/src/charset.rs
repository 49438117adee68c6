//! Charsets of payloads: what the names in `payload-encoding` (SC00067F) stand for, and payloads in
//! them as UTF-8.

mod pieces;

use std::borrow::Cow;
use std::ops::Range;

use bytes::Bytes;
use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252, X_USER_DEFINED, mem};

use self::pieces::{Piece, Pieces};

/// What the name of a charset stands for.
pub(crate) enum Named {
    /// Nobody here knows it.
    Unknown,
    /// UTF-8 or US-ASCII: octets that are read as they are.
    Utf8,
    /// Two or four octets for each unit. In which order they stand, the octets tell.
    Wide,
    /// Any other one.
    Charset(Charset),
}

impl Named {
    pub(crate) fn of(name: &str) -> Named {
        let name = name.trim_ascii().to_ascii_lowercase();
        if WIDE.iter().any(|wide| name.starts_with(wide)) {
            return Named::Wide;
        }
        let Some(encoding) = Encoding::for_label_no_replacement(name.as_bytes()) else {
            return Named::Unknown;
        };
        // Browsers take US-ASCII and ISO-8859-1 for windows-1252, and made the last one up.
        let is_ascii = name.contains("ascii") || name.starts_with("ansi");
        let is_latin1 = encoding == WINDOWS_1252 && !name.contains("1252");
        match encoding {
            _ if encoding == UTF_8 || is_ascii => Named::Utf8,
            _ if encoding == UTF_16BE || encoding == UTF_16LE => Named::Wide,
            _ if is_latin1 => Named::Charset(Charset::Latin1),
            _ if encoding == X_USER_DEFINED => Named::Unknown,
            _ => Named::Charset(Charset::Other(encoding)),
        }
    }
}

/// How names begin that are in no table of browsers.
const WIDE: [&str; 5] = ["utf-16", "utf16", "utf-32", "utf32", "iso-10646-ucs-4"];

/// A charset that is not read as UTF-8.
#[derive(Clone, Copy)]
pub(crate) enum Charset {
    /// ISO-8859-1.
    Latin1,
    /// UTF-32, and how a unit is read.
    Utf32(fn([u8; 4]) -> u32),
    /// UTF-16 included.
    Other(&'static Encoding),
}

impl Charset {
    /// The charset of a text in units of two or four octets, which begins with a byte order mark
    /// or with ASCII; `None` for a text that is none such, whatever was said about it.
    pub(crate) fn of_wide(text: &[u8]) -> Option<Charset> {
        match text {
            [0, 0, 0xfe, 0xff, ..] | [0, 0, 0, _, ..] => Some(Charset::Utf32(u32::from_be_bytes)),
            [0xff, 0xfe, 0, 0, ..] | [_, 0, 0, 0, ..] => Some(Charset::Utf32(u32::from_le_bytes)),
            [0xfe, 0xff, ..] | [0, _, ..] => Some(Charset::Other(UTF_16BE)),
            [0xff, 0xfe, ..] | [_, 0, ..] => Some(Charset::Other(UTF_16LE)),
            _ => None,
        }
    }

    /// Whether every octet of ASCII stands for itself, wherever it begins a character.
    pub(crate) fn extends_ascii(self) -> bool {
        match self {
            Charset::Latin1 => true,
            Charset::Utf32(_) => false,
            Charset::Other(encoding) => encoding.is_ascii_compatible(),
        }
    }

    /// A text in UTF-8.
    pub(crate) fn transcoded(self, text: &[u8]) -> Bytes {
        Bytes::copy_from_slice(self.decode(text).as_bytes())
    }

    /// The octets as text; U+FFFD stands for what is not of the charset.
    fn decode(self, octets: &[u8]) -> Cow<'_, str> {
        match self {
            Charset::Latin1 => mem::decode_latin1(octets),
            Charset::Utf32(unit) => {
                let character = |octets: &[u8]| octets.try_into().map(unit).ok();
                let characters = octets.chunks(4).map(|octets| {
                    let code = character(octets).and_then(char::from_u32);
                    code.unwrap_or(char::REPLACEMENT_CHARACTER)
                });
                Cow::Owned(characters.collect())
            }
            Charset::Other(encoding) => encoding.decode_without_bom_handling(octets).0,
        }
    }

    /// How many of the octets were read for so much of their text.
    pub(crate) fn octets_read(self, octets: &[u8], text: &str) -> usize {
        match self {
            Charset::Latin1 => text.chars().count(),
            Charset::Utf32(_) => octets.len().min(4 * text.chars().count()),
            // What could not be decoded was one unit and became a character of one unit.
            Charset::Other(encoding) if encoding == UTF_16BE || encoding == UTF_16LE => {
                octets.len().min(2 * text.encode_utf16().count())
            }
            Charset::Other(encoding) => {
                let mut decoder = encoding.new_decoder_without_bom_handling();
                let mut written = 0;
                let one_by_one = octets.chunks(1).take_while(|octet| {
                    let is_wanted = written < text.len();
                    // Room for more characters than one octet can complete.
                    written += decoder.decode_to_utf8(octet, &mut [0; 32], false).2;
                    is_wanted
                });
                one_by_one.count()
            }
        }
    }
}

/// A payload in another charset.
#[derive(Clone, Copy)]
pub(crate) struct Foreign<'a> {
    pub(crate) octets: &'a [u8],
    pub(crate) charset: Charset,
    pub(crate) extent: Extent,
}

/// What of a payload is in the charset.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extent {
    /// All of it.
    Whole,
    /// In string form, all but what stands behind `#n"` (SC00070I, ByteLengthEncodedString).
    Uncounted,
    /// In bit-efficient form, the words and literals that are not UTF-8.
    Texts,
}

impl<'a> Foreign<'a> {
    /// The payload with its texts in UTF-8.
    pub(crate) fn to_utf8(self) -> Bytes {
        let mut text = Vec::with_capacity(self.octets.len());
        for piece in Pieces::of(self) {
            text.extend_from_slice(&self.transcoded(&piece));
        }
        Bytes::from(text)
    }

    /// Where in the payload that stands which stands here in what was made of it.
    pub(crate) fn position(self, mut at: usize) -> usize {
        for piece in Pieces::of(self) {
            let text = self.transcoded(&piece);
            if at >= text.len() {
                at -= text.len();
                continue;
            }
            let before = text.get(..at).unwrap_or_default();
            let octets = self.part(&piece.octets);
            let read = match piece.is_kept {
                true => at,
                false => self
                    .charset
                    .octets_read(octets, &String::from_utf8_lossy(before)),
            };
            return piece.octets.start + read;
        }
        self.octets.len()
    }

    fn transcoded(self, piece: &Piece) -> Cow<'a, [u8]> {
        let octets = self.part(&piece.octets);
        match piece.is_kept {
            true => Cow::Borrowed(octets),
            false => match self.charset.decode(octets) {
                Cow::Borrowed(text) => Cow::Borrowed(text.as_bytes()),
                Cow::Owned(text) => Cow::Owned(text.into_bytes()),
            },
        }
    }

    fn part(self, range: &Range<usize>) -> &'a [u8] {
        self.octets.get(range.clone()).unwrap_or_default()
    }
}
