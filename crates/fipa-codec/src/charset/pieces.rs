use std::ops::Range;

use super::{Extent, Foreign};

/// A part of a payload.
pub(super) struct Piece {
    pub(super) octets: Range<usize>,
    /// Whether it is of no charset.
    pub(super) is_kept: bool,
}

/// The pieces of a payload in their order, kept ones and transcoded ones.
pub(super) struct Pieces<'a> {
    payload: Foreign<'a>,
    at: usize,
    /// Octets of the piece that was found behind the one that was given last.
    found: Option<usize>,
    literal: Literal,
}

impl<'a> Pieces<'a> {
    pub(super) fn of(payload: Foreign<'a>) -> Pieces<'a> {
        Pieces {
            payload,
            at: 0,
            found: None,
            literal: Literal::default(),
        }
    }

    fn piece(&mut self, end: usize, is_found: bool) -> Piece {
        let octets = self.at..end;
        self.at = end;
        Piece {
            octets,
            // In bit-efficient form the texts are found, in string form what is no text.
            is_kept: is_found != (self.payload.extent == Extent::Texts),
        }
    }

    /// Where the next piece of the other kind begins, and how many octets it has.
    fn find(&mut self) -> Option<(usize, usize)> {
        match self.payload.extent {
            Extent::Whole => None,
            Extent::Uncounted => self.find_counted(),
            Extent::Texts => self.find_text(),
        }
    }

    /// The next `#n"` outside a literal, with its octets.
    fn find_counted(&mut self) -> Option<(usize, usize)> {
        let octets = self.payload.octets;
        let mut from = self.at;
        // No charset that extends ASCII has a `#` within another character.
        for hash in memchr::memchr_iter(b'#', octets.get(self.at..)?) {
            let hash = self.at + hash;
            let before = self.payload.part(&(from..hash));
            self.literal.follow(&self.payload.charset.decode(before));
            from = hash;
            if self.literal.is_open {
                continue;
            }
            if let Some((prefix, count)) = octets.get(hash..).and_then(counted) {
                let left = octets.len() - hash - prefix;
                return Some((hash, prefix + count.min(left)));
            }
        }
        None
    }

    /// The next word or literal of a bit-efficient message that is not UTF-8.
    fn find_text(&mut self) -> Option<(usize, usize)> {
        const HEADER: usize = 3;
        let octets = self.payload.octets;
        let mut at = self.at.max(HEADER);
        loop {
            let rest = octets.get(at..)?;
            match Token::first(rest)? {
                Token::Other(len) => at += len,
                Token::Text(len) => {
                    let text = rest.get(1..=len)?;
                    if std::str::from_utf8(text).is_err() {
                        return Some((at + 1, len));
                    }
                    at += 1 + len;
                }
            }
        }
    }
}

impl Iterator for Pieces<'_> {
    type Item = Piece;

    fn next(&mut self) -> Option<Piece> {
        let end = self.payload.octets.len();
        if self.at >= end {
            return None;
        }
        if let Some(len) = self.found.take() {
            return Some(self.piece(self.at + len, true));
        }
        let Some((start, len)) = self.find() else {
            return Some(self.piece(end, false));
        };
        if start == self.at {
            return Some(self.piece(start + len, true));
        }
        self.found = Some(len);
        Some(self.piece(start, false))
    }
}

/// Octets of the `#n"` at the beginning of the text, and n.
fn counted(text: &[u8]) -> Option<(usize, usize)> {
    let digits = text.strip_prefix(b"#")?;
    let digits = digits.iter().take_while(|octet| octet.is_ascii_digit());
    let digits = digits.count();
    if digits == 0 || text.get(digits + 1) != Some(&b'"') {
        return None;
    }
    let count = std::str::from_utf8(text.get(1..=digits)?).ok()?.parse();
    // What is too large for a number is too large for the text as well.
    Some((digits + 2, count.unwrap_or(usize::MAX)))
}

/// Whether a text is within a literal (SC00070I, StringLiteral).
#[derive(Default)]
struct Literal {
    is_open: bool,
    is_behind_backslash: bool,
}

impl Literal {
    fn follow(&mut self, text: &str) {
        for octet in text.bytes() {
            if octet == b'"' {
                self.is_open = !self.is_open || self.is_behind_backslash;
            }
            self.is_behind_backslash = octet == b'\\';
        }
    }
}

/// What a bit-efficient message consists of behind its header (SC00069G). The codes of parameters
/// and of values are different ones, so that one can tell what is text without a grammar.
enum Token {
    /// One octet, a text of so many octets, and a zero octet, which reads as the end of a list.
    Text(usize),
    /// So many octets.
    Other(usize),
}

impl Token {
    /// The first token; `None` where none is known to begin.
    fn first(octets: &[u8]) -> Option<Token> {
        let (code, rest) = octets.split_first()?;
        let len = |octets: Option<&[u8]>| {
            let number = octets?
                .iter()
                .fold(0, |n: usize, o| n << 8 | usize::from(*o));
            number.checked_add(1)
        };
        let is_fused = matches!(code, 0x50..=0x59 | 0x70..=0x79);
        Some(match code {
            0x00..=0x0d | 0x40 | 0x60 | 0xff => Token::Other(1),
            0x20..=0x22 => Token::Other(10),
            0x24..=0x26 => Token::Other(11),
            0x10..=0x19 | 0x50..=0x59 | 0x70..=0x79 => match code & 15 {
                0 => Token::Text(memchr::memchr(0, rest)?),
                4 => Token::literal(rest)?,
                2 | 3 => Token::Other(2 + rest.iter().position(|octet| octet & 15 == 0)?),
                6 => Token::Other(len(rest.get(..1))? + 1),
                7 => Token::Other(len(rest.get(..2))? + 2),
                // The codes of lengths of 32 bits and of indexes are exchanged in lists.
                8 if is_fused => Token::Other(len(rest.get(..4))? + 4),
                9 if !is_fused => Token::Other(len(rest.get(..4))? + 4),
                _ => return None,
            },
            _ => return None,
        })
    }

    fn literal(rest: &[u8]) -> Option<Token> {
        let Some((prefix, count)) = counted(rest) else {
            return Some(Token::Text(memchr::memchr(0, rest)?));
        };
        let end = prefix.checked_add(count)?;
        match rest.get(end) {
            Some(0) => Some(Token::Other(1 + end)),
            _ => Some(Token::Other(1 + memchr::memchr(0, rest)?)),
        }
    }
}
