use bytes::{BufMut, BytesMut};
use fipa_acl::Text;

use super::reader::Reader;
use crate::{DecodeError, Fault};

/// What a nibble of Digits (SC00069G, note on coded numbers) stands for; 0 for none.
const CHARACTERS: [u8; 16] = *b"\x000123456789\x00+E-.";

/// Digits of SC00069G as text.
pub(super) fn read_number(reader: &mut Reader<'_>) -> Result<Text, DecodeError> {
    let mut text = String::new();
    read_digits(reader, |character| {
        text.push(char::from(character));
        Some(())
    })?;
    Ok(Text::from(text))
}

/// Digits as a count.
pub(super) fn read_count(reader: &mut Reader<'_>) -> Result<u64, DecodeError> {
    let mut count = 0_u64;
    read_digits(reader, |character| {
        let digit = char::from(character).to_digit(10)?;
        count = count.checked_mul(10)?.checked_add(u64::from(digit))?;
        Some(())
    })?;
    Ok(count)
}

/// Hands over each character; `None` refuses it. The low nibble of the last octet is 0.
fn read_digits(
    reader: &mut Reader<'_>,
    mut take: impl FnMut(u8) -> Option<()>,
) -> Result<(), DecodeError> {
    let start = reader.position();
    let mut empty = true;
    loop {
        let octet = reader.octet()?;
        for nibble in [octet >> 4, octet & 15] {
            if nibble == 0 {
                continue;
            }
            let character = CHARACTERS.get(usize::from(nibble)).copied();
            let known = character.filter(|character| *character != 0);
            known.and_then(&mut take).ok_or(DecodeError {
                offset: reader.position() - 1,
                fault: Fault::Malformed,
                what: "not a digit of such a number",
            })?;
            empty = false;
        }
        if octet & 15 == 0 {
            break;
        }
    }
    if empty {
        return Err(DecodeError {
            offset: start,
            fault: Fault::Malformed,
            what: "a number without digits",
        });
    }
    Ok(())
}

/// Whether the text can be written in Digits without changing it.
pub(super) fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|character| nibble(character).is_some())
}

/// Writes Digits: two a nibble, the last low nibble is 0. Only what [`is_number`].
pub(super) fn write_digits(text: &[u8], out: &mut BytesMut) {
    let mut nibbles = text.iter().filter_map(|character| nibble(*character));
    while let Some(high) = nibbles.next() {
        match nibbles.next() {
            Some(low) => out.put_u8(high << 4 | low),
            None => return out.put_u8(high << 4),
        }
    }
    out.put_u8(0);
}

/// `e` has the nibble of `E`: the number is the same, its text is not.
fn nibble(character: u8) -> Option<u8> {
    Some(match character {
        b'0'..=b'9' => character - b'0' + 1,
        b'+' => 0xc,
        b'e' | b'E' => 0xd,
        b'-' => 0xe,
        b'.' => 0xf,
        _ => return None,
    })
}
