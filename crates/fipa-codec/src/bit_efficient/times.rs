use bytes::{BufMut, BytesMut};
use fipa_acl::{CivilTime, FipaTime, Relative, Zone};

use super::options::WriteOptions;
use super::reader::Reader;
use crate::{DecodeError, EncodeError, Fault, dates};

/// The number below 100 that stands in an octet as two digits, for every octet.
const PAIRS: [u8; 256] = pairs();

/// No two digits; its highest bit is that of no number below 100.
const NO_PAIR: u8 = 0x80;

const fn pairs() -> [u8; 256] {
    let mut pairs = [NO_PAIR; 256];
    let mut number = 0;
    while number < 100 {
        pairs[(number as usize / 10 + 1) << 4 | (number as usize % 10 + 1)] = number;
        number += 1;
    }
    pairs
}

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
    let fields =
        Fields::of(reader.array()?).ok_or_else(|| wrong(Fault::Malformed, "not digits"))?;
    let (offset, zone) = match code {
        0x24..=0x26 => zone(reader)?,
        _ => (0, Zone::Unspecified),
    };
    let time = match code {
        0x20 | 0x24 => fields.absolute(offset, zone),
        0x21 | 0x25 => fields.relative(false),
        _ => fields.relative(true),
    };
    time.ok_or_else(|| wrong(Fault::Violation, "no such date"))
}

/// What a zone letter adds to UTC, in milliseconds.
fn zone(reader: &mut Reader<'_>) -> Result<(i64, Zone), DecodeError> {
    let letter = reader.octet()?;
    Zone::of_letter(letter).ok_or_else(|| reader.unexpected("a time zone is one letter"))
}

/// Year, month, day, hour, minute, second, millisecond.
struct Fields([u16; 7]);

impl Fields {
    fn of(octets: [u8; 9]) -> Option<Fields> {
        Fields::of_usual(octets).or_else(|| Fields::of_padded(octets))
    }

    /// All digits, with the padding where nearly everybody puts it: behind the milliseconds.
    #[inline]
    fn of_usual(octets: [u8; 9]) -> Option<Fields> {
        let pairs = octets.map(|octet| PAIRS.get(usize::from(octet)).copied().unwrap_or(NO_PAIR));
        let [y1, y2, month, day, hour, minute, second, m1, _] = pairs.map(u16::from);
        let [.., last] = octets;
        let m2 = u16::from(last >> 4);
        let all = pairs.iter().take(8).fold(0, |all, pair| all | pair);
        if all & NO_PAIR != 0 || last & 15 != 0 || !(1..=10).contains(&m2) {
            return None;
        }
        let (year, millis) = (y1 * 100 + y2, m1 * 10 + m2 - 1);
        Some(Fields([year, month, day, hour, minute, second, millis]))
    }

    /// Peers put the padding of a field in front of its digits or behind them.
    #[cold]
    fn of_padded(octets: [u8; 9]) -> Option<Fields> {
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
        dates::absolute(local, offset, zone)
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
#[inline]
fn field(octets: &[u8]) -> Option<u16> {
    let mut number = 0;
    let mut digits = 0;
    for nibble in octets.iter().flat_map(|octet| [octet >> 4, octet & 15]) {
        match nibble {
            0 => continue,
            1..=10 => number = number * 10 + u16::from(nibble) - 1,
            _ => return None,
        }
        digits += 1;
    }
    (digits > 0).then_some(number)
}

/// A point in time in UTC, or a span.
pub(super) fn write_time(
    time: &FipaTime,
    parameter: &'static str,
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    match time {
        FipaTime::Absolute { unix_millis, .. } => write_absolute(*unix_millis, options, out),
        FipaTime::Relative(span) => write_relative(span, out),
    }
    .map_err(|what| EncodeError { parameter, what })
}

fn write_absolute(
    unix_millis: i64,
    options: &WriteOptions,
    out: &mut BytesMut,
) -> Result<(), &'static str> {
    let t = dates::civil(unix_millis)?;
    let days = [t.month, t.day, t.hour, t.minute, t.second];
    let fields = coded_fields(t.year, days, t.millis);
    let [y1, y2, month, day, hour, minute, second, m1, m2] = fields;
    if options.zone_letter {
        out.put_slice(&[0x24, y1, y2, month, day, hour, minute, second, m1, m2, b'Z']);
    } else {
        // Who writes no zone writes a zero in front of the milliseconds.
        let (m1, m2) = (0x10 | m1 >> 4, m1 << 4 | m2 >> 4);
        out.put_slice(&[0x20, y1, y2, month, day, hour, minute, second, m1, m2]);
    }
    Ok(())
}

fn write_relative(span: &Relative, out: &mut BytesMut) -> Result<(), &'static str> {
    let days = dates::pairs_of(span)?;
    out.put_u8(if span.negative { 0x22 } else { 0x21 });
    out.put_slice(&coded_fields(span.years, days, span.millis));
    Ok(())
}

/// The padding of the three digits of the milliseconds is last, which all peers read.
fn coded_fields(year: u16, [month, day, hour, minute, second]: [u8; 5], millis: u16) -> [u8; 9] {
    [
        pair(year / 100),
        pair(year % 100),
        pair(month.into()),
        pair(day.into()),
        pair(hour.into()),
        pair(minute.into()),
        pair(second.into()),
        pair(millis / 10),
        pair(millis % 10) << 4,
    ]
}

/// A number below 100 as two digits in an octet.
#[inline]
fn pair(number: u16) -> u8 {
    const CODED: [u8; 100] = {
        let mut coded = [0; 100];
        let mut number = 0_u8;
        while number < 100 {
            coded[number as usize] = (number / 10 + 1) << 4 | (number % 10 + 1);
            number += 1;
        }
        coded
    };
    CODED.get(usize::from(number)).copied().unwrap_or_default()
}
