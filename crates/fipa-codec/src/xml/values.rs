use fipa_acl::{Expression, Text};

use super::cursor::{Cursor, Element};
use crate::{DecodeError, Fault};

/// What can hold a value besides the text of an element.
pub(super) const ATTRIBUTES: &[&[u8]] = &[b"href", b"value"];

impl Cursor<'_> {
    /// The expression that a value stands for; an empty one is an absent one.
    #[inline(never)]
    pub(super) fn tag(
        &mut self,
        element: &Element,
        place: &mut Option<Expression>,
    ) -> Result<(), DecodeError> {
        let text = self.exact(element, ATTRIBUTES)?;
        *place = match text.is_empty() {
            true => None,
            false => Some(self.expression(text)?),
        };
        Ok(())
    }

    /// A text; an empty one is an absent one.
    pub(super) fn optional(&mut self, element: &Element) -> Result<Option<Text>, DecodeError> {
        let text = self.exact(element, ATTRIBUTES)?;
        Ok(Some(text).filter(|text| !text.is_empty()))
    }

    /// A text without white space at its ends; an empty one is an absent one.
    pub(super) fn optional_trimmed(
        &mut self,
        element: &Element,
    ) -> Result<Option<Text>, DecodeError> {
        let text = self.trimmed(element, ATTRIBUTES)?;
        Ok(Some(text).filter(|text| !text.is_empty()))
    }

    /// The expression that a text stands for. What nests too deeply or has too many items is
    /// found out before anything is made of it.
    #[inline]
    pub(super) fn expression(&mut self, text: Text) -> Result<Expression, DecodeError> {
        if let Some((items, depth)) = extent(text.as_bytes()) {
            self.count_items(items)?;
            self.check_depth(depth)?;
        }
        Ok(Expression::from(text))
    }

    /// A count in decimal digits; an empty one is an absent one.
    pub(super) fn count(&mut self, element: &Element) -> Result<Option<u64>, DecodeError> {
        let start = self.at;
        let Some(text) = self.optional_trimmed(element)? else {
            return Ok(None);
        };
        let is_number = text.bytes().all(|octet| octet.is_ascii_digit());
        let number = text.parse().ok().filter(|_| is_number).ok_or(DecodeError {
            offset: start,
            fault: Fault::Malformed,
            what: "not a number",
        })?;
        Ok(Some(number))
    }
}

/// The items in the lists that a text is made of, and how deep they nest; `None` if it is not one
/// list.
fn extent(text: &[u8]) -> Option<(usize, usize)> {
    let mut rest = text.strip_prefix(b"(")?;
    let (mut items, mut depth, mut deepest) = (0_usize, 1_usize, 1_usize);
    while let [octet, behind @ ..] = rest {
        rest = match octet {
            b'(' => {
                (items, depth) = (items + 1, depth + 1);
                deepest = deepest.max(depth);
                behind
            }
            b')' if depth == 1 => return behind.is_empty().then_some((items, deepest)),
            b')' => {
                depth -= 1;
                behind
            }
            b'"' => {
                items += 1;
                behind_literal(behind)?
            }
            b'#' => {
                items += 1;
                behind_byte_length_string(behind)?
            }
            octet if octet.is_ascii_whitespace() => behind,
            _ => {
                items += 1;
                let len = behind.iter().take_while(|octet| is_token(**octet)).count();
                behind.get(len..)?
            }
        };
    }
    None
}

fn behind_literal(mut rest: &[u8]) -> Option<&[u8]> {
    loop {
        match rest {
            [b'\\', b'"', behind @ ..] => rest = behind,
            [b'"', behind @ ..] => return Some(behind),
            [_, behind @ ..] => rest = behind,
            [] => return None,
        }
    }
}

fn behind_byte_length_string(rest: &[u8]) -> Option<&[u8]> {
    let digits = rest.iter().take_while(|octet| octet.is_ascii_digit());
    let (digits, rest) = rest.split_at_checked(digits.count())?;
    let count: usize = std::str::from_utf8(digits).ok()?.parse().ok()?;
    rest.strip_prefix(b"\"")?.get(count..)
}

fn is_token(octet: u8) -> bool {
    !octet.is_ascii_whitespace() && !matches!(octet, b'(' | b')')
}
