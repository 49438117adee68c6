use bytes::{BufMut, BytesMut};
use fipa_acl::{CivilTime, FipaTime, Relative, Text, Zone};

use super::reader::Reader;
use crate::{DecodeError, EncodeError, Fault};

/// What a nibble of Digits (SC00069G, note on coded numbers) stands for; 0 for none.
const CHARACTERS: [u8; 16] = *b"\x000123456789\x00+E-.";

const HOUR: i64 = 3_600_000;

/// BinDateTimeToken of SC00069G, as a point in time in UTC or a span.
pub(super) fn read_time(reader: &mut Reader<'_>) -> Result<FipaTime, DecodeError> {
    let code = reader.octet()?;
    if !matches!(code, 0x20..=0x22 | 0x24..=0x26) {
        return Err(reader.unexpected("no date begins like this"));
    }
    let start = reader.position();
    let wrong = |fault, what| DecodeError {
        offset: start,
        fault,
        what,
    };
    let fields = Fields::of(reader.array()?).ok_or(wrong(Fault::Malformed, "not digits"))?;
    let (offset, zone) = match code {
        0x24..=0x26 => zone(reader)?,
        _ => (0, Zone::Unspecified),
    };
    let time = match code {
        0x20 | 0x24 => fields.absolute(offset, zone),
        0x21 | 0x25 => fields.relative(false),
        _ => fields.relative(true),
    };
    time.ok_or(wrong(Fault::Violation, "no such date"))
}

/// What a zone letter adds to UTC, in milliseconds. `J` is the local time of somebody.
fn zone(reader: &mut Reader<'_>) -> Result<(i64, Zone), DecodeError> {
    let letter = reader.octet()?.to_ascii_uppercase();
    let hours = match letter {
        b'Z' => 0,
        b'A'..=b'I' => i64::from(letter - b'A') + 1,
        b'J' => return Ok((0, Zone::Unspecified)),
        b'K'..=b'M' => i64::from(letter - b'K') + 10,
        b'N'..=b'Y' => -i64::from(letter - b'N') - 1,
        _ => return Err(reader.unexpected("a time zone is one letter")),
    };
    Ok((hours * HOUR, Zone::Utc))
}

/// Year, month, day, hour, minute, second, millisecond.
struct Fields([u16; 7]);

impl Fields {
    /// Peers put the padding of a field in front of its digits or behind them.
    fn of(octets: [u8; 9]) -> Option<Fields> {
        let [y1, y2, month, day, hour, minute, second, m1, m2] = octets;
        Some(Fields([
            field(&[y1, y2])?,
            field(&[month])?,
            field(&[day])?,
            field(&[hour])?,
            field(&[minute])?,
            field(&[second])?,
            field(&[m1, m2])?,
        ]))
    }

    fn absolute(&self, offset: i64, zone: Zone) -> Option<FipaTime> {
        let Fields([year, month, day, hour, minute, second, millis]) = *self;
        let local = CivilTime {
            year,
            month: u8::try_from(month).ok()?,
            day: u8::try_from(day).ok()?,
            hour: u8::try_from(hour).ok()?,
            minute: u8::try_from(minute).ok()?,
            second: u8::try_from(second).ok()?,
            millis,
        };
        let unix_millis = local.to_unix_millis().ok()? - offset;
        is_writable(unix_millis).then_some(FipaTime::Absolute { unix_millis, zone })
    }

    fn relative(&self, negative: bool) -> Option<FipaTime> {
        let Fields([years, months, days, hours, minutes, seconds, millis]) = *self;
        if millis > 999 {
            return None;
        }
        Some(FipaTime::Relative(Relative {
            negative,
            years,
            months: u8::try_from(months).ok()?,
            days: u8::try_from(days).ok()?,
            hours: u8::try_from(hours).ok()?,
            minutes: u8::try_from(minutes).ok()?,
            seconds: u8::try_from(seconds).ok()?,
            millis,
        }))
    }
}

/// The number in up to four digits; padding nibbles are skipped.
fn field(octets: &[u8]) -> Option<u16> {
    let nibbles = octets.iter().flat_map(|octet| [octet >> 4, octet & 15]);
    let mut digits = nibbles.filter(|nibble| *nibble != 0).peekable();
    digits.peek()?;
    digits.try_fold(0, |number, nibble| match nibble {
        1..=10 => Some(number * 10 + u16::from(nibble) - 1),
        _ => None,
    })
}

/// Whether the year has four digits.
fn is_writable(unix_millis: i64) -> bool {
    FipaTime::from_unix_millis(unix_millis).unix_millis() == Some(unix_millis)
}

/// A point in time in UTC with its zone letter, or a span.
pub(super) fn write_time(
    time: &FipaTime,
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    let wrong = |what| EncodeError { parameter, what };
    match time {
        FipaTime::Absolute { unix_millis, .. } if !is_writable(*unix_millis) => {
            Err(wrong("the year is not within 0000 and 9999"))
        }
        FipaTime::Absolute { unix_millis, .. } => {
            write_absolute(*unix_millis, out);
            Ok(())
        }
        FipaTime::Relative(span) => write_relative(span, out).map_err(wrong),
    }
}

fn write_absolute(unix_millis: i64, out: &mut BytesMut) {
    let t = CivilTime::from_unix_millis(unix_millis);
    let days = [t.month, t.day, t.hour, t.minute, t.second];
    out.put_u8(0x24);
    out.put_slice(&coded_fields(t.year, days, t.millis));
    out.put_u8(b'Z');
}

fn write_relative(span: &Relative, out: &mut BytesMut) -> Result<(), &'static str> {
    let days = [
        span.months,
        span.days,
        span.hours,
        span.minutes,
        span.seconds,
    ];
    if span.years > 9999 || span.millis > 999 || days.iter().any(|field| *field > 99) {
        return Err("a field of the span has too many digits");
    }
    out.put_u8(if span.negative { 0x22 } else { 0x21 });
    out.put_slice(&coded_fields(span.years, days, span.millis));
    Ok(())
}

/// The padding of the three digits of the milliseconds is last, which all peers read.
fn coded_fields(year: u16, [month, day, hour, minute, second]: [u8; 5], millis: u16) -> [u8; 9] {
    let pair = |number: u16| digit(number / 10) << 4 | digit(number);
    [
        pair(year / 100),
        pair(year),
        pair(month.into()),
        pair(day.into()),
        pair(hour.into()),
        pair(minute.into()),
        pair(second.into()),
        pair(millis / 10),
        digit(millis) << 4,
    ]
}

/// The nibble of the last decimal digit.
fn digit(number: u16) -> u8 {
    let [nibble, _] = (number % 10 + 1).to_le_bytes();
    nibble
}

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
