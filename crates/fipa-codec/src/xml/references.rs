use std::ops::Range;

use memchr::memchr;

use super::cursor::Cursor;
use super::text::Octets;
use crate::{DecodeError, Fault};

/// Octets of the longest reference that is looked for.
const LONGEST_REFERENCE: usize = 32;

impl Cursor<'_> {
    /// An attribute's value with what its references stand for.
    pub(super) fn unescaped(&self, value: Range<usize>) -> Result<Octets, DecodeError> {
        let mut octets = Octets::default();
        let mut at = value.start;
        while let Some(len) = memchr(b'&', self.octets(at..value.end)) {
            octets.add(at..at + len, self);
            let (character, len_of_reference) = self.reference_at(at + len, value.end)?;
            octets.add_character(character, self);
            at += len + len_of_reference;
        }
        octets.add(at..value.end, self);
        Ok(octets)
    }

    /// The reference that begins here.
    pub(super) fn reference(&mut self) -> Result<char, DecodeError> {
        let (character, len) = self.reference_at(self.at, self.end)?;
        self.go_to(self.at + len);
        Ok(character)
    }

    /// The character that a reference stands for, and the octets of the reference. There are the
    /// five that XML defines and those to numbers; nothing else is ever expanded.
    fn reference_at(&self, at: usize, end: usize) -> Result<(char, usize), DecodeError> {
        let rest = self.octets(at + 1..end.min(at + LONGEST_REFERENCE));
        let name = memchr(b';', rest).and_then(|len| rest.get(..len));
        let name = name.filter(|name| has_form_of_reference(name));
        if name.is_none() && self.lenient {
            return Ok(('&', 1));
        }
        let character = name.and_then(character).ok_or(DecodeError {
            offset: at,
            fault: Fault::Malformed,
            what: "a reference to nothing that is known",
        })?;
        Ok((character, name.map_or(0, <[u8]>::len) + 2))
    }
}

fn has_form_of_reference(name: &[u8]) -> bool {
    let name = name.strip_prefix(b"#").unwrap_or(name);
    !name.is_empty() && name.iter().all(u8::is_ascii_alphanumeric)
}

fn character(name: &[u8]) -> Option<char> {
    match name {
        b"amp" => Some('&'),
        b"lt" => Some('<'),
        b"gt" => Some('>'),
        b"quot" => Some('"'),
        b"apos" => Some('\''),
        [b'#', b'x', digits @ ..] => number(digits, 16),
        [b'#', digits @ ..] => number(digits, 10),
        _ => None,
    }
}

/// Any character but zero: peers write control characters like this too.
fn number(digits: &[u8], radix: u32) -> Option<char> {
    let digits = std::str::from_utf8(digits).ok()?;
    let number = u32::from_str_radix(digits, radix).ok()?;
    char::from_u32(number).filter(|character| *character != '\0')
}
