use fipa_acl::{CivilTime, FipaTime, Relative, Zone};

use super::scan::is_digits;
use crate::{EncodeError, Fault, Output};

const MINUTE: i64 = 60_000;

type Wrong = (Fault, &'static str);

const MALFORMED: Wrong = (Fault::Malformed, "a date is like 20260102T030405678Z");
const NO_SUCH_DATE: Wrong = (Fault::Violation, "no such date");

/// DateTimeToken of SC00070I, as a point in time in UTC or a span.
///
/// The milliseconds may be missing, and the zone may be an offset such as `+0100`.
pub(super) fn parse(token: &[u8]) -> Result<FipaTime, Wrong> {
    let (sign, text) = match token {
        [sign @ (b'+' | b'-'), text @ ..] => (Some(*sign), text),
        _ => (None, token),
    };
    let (date, text) = text.split_at_checked(8).ok_or(MALFORMED)?;
    let [b'T' | b't', text @ ..] = text else {
        return Err(MALFORMED);
    };
    let digits = text.iter().take_while(|octet| octet.is_ascii_digit());
    let (time, zone) = text.split_at(digits.count());
    let fields = Fields::of(date, time).ok_or(MALFORMED)?;
    let (offset, zone) = offset_of(zone).ok_or(MALFORMED)?;
    match sign {
        None => fields.absolute(offset, zone),
        Some(sign) => fields.relative(sign == b'-'),
    }
    .ok_or(NO_SUCH_DATE)
}

/// What a zone adds to UTC, in milliseconds: a letter of the military zones, of which `J` is the
/// local time of somebody, or hours and minutes.
fn offset_of(zone: &[u8]) -> Option<(i64, Zone)> {
    let letter = match zone {
        [] => return Some((0, Zone::Unspecified)),
        [letter] => letter.to_ascii_uppercase(),
        [b'+', digits @ ..] => return Some((offset_of_digits(digits)?, Zone::Utc)),
        [b'-', digits @ ..] => return Some((-offset_of_digits(digits)?, Zone::Utc)),
        _ => return None,
    };
    let hours = match letter {
        b'Z' => 0,
        b'A'..=b'I' => i64::from(letter - b'A') + 1,
        b'J' => return Some((0, Zone::Unspecified)),
        b'K'..=b'M' => i64::from(letter - b'K') + 10,
        b'N'..=b'Y' => -i64::from(letter - b'N') - 1,
        _ => return None,
    };
    Some((hours * 60 * MINUTE, Zone::Utc))
}

fn offset_of_digits(digits: &[u8]) -> Option<i64> {
    if digits.len() != 4 || !is_digits(digits) {
        return None;
    }
    let (hours, minutes) = digits.split_at(2);
    let minutes = i64::from(number(hours)) * 60 + i64::from(number(minutes));
    Some(minutes * MINUTE)
}

/// Year, month, day, hour, minute, second.
struct Fields {
    year: u16,
    pairs: [u8; 5],
    millis: u16,
}

impl Fields {
    fn of(date: &[u8], time: &[u8]) -> Option<Fields> {
        if !is_digits(date) || !is_digits(time) || !matches!(time.len(), 6 | 9) {
            return None;
        }
        let (year, days) = date.split_at(4);
        let (time, millis) = time.split_at(6);
        let mut pairs = [0; 5];
        let fields = days.chunks_exact(2).chain(time.chunks_exact(2));
        for (pair, digits) in pairs.iter_mut().zip(fields) {
            *pair = u8::try_from(number(digits)).ok()?;
        }
        Some(Fields {
            year: number(year),
            pairs,
            millis: number(millis),
        })
    }

    fn absolute(&self, offset: i64, zone: Zone) -> Option<FipaTime> {
        let [month, day, hour, minute, second] = self.pairs;
        let local = CivilTime {
            year: self.year,
            month,
            day,
            hour,
            minute,
            second,
            millis: self.millis,
        };
        let unix_millis = local.to_unix_millis().ok()? - offset;
        is_writable(unix_millis).then_some(FipaTime::Absolute { unix_millis, zone })
    }

    fn relative(&self, negative: bool) -> Option<FipaTime> {
        let [months, days, hours, minutes, seconds] = self.pairs;
        Some(FipaTime::Relative(Relative {
            negative,
            years: self.year,
            months,
            days,
            hours,
            minutes,
            seconds,
            millis: self.millis,
        }))
    }
}

/// The number in up to four digits.
fn number(digits: &[u8]) -> u16 {
    let value = |number, digit: &u8| number * 10 + u16::from(digit.wrapping_sub(b'0'));
    digits.iter().take(4).fold(0, value)
}

/// Whether the year has four digits.
fn is_writable(unix_millis: i64) -> bool {
    FipaTime::from_unix_millis(unix_millis).unix_millis() == Some(unix_millis)
}

/// A point in time in UTC with its zone letter, or a span with its sign.
pub(super) fn write(time: &FipaTime, out: &mut Output) -> Result<(), EncodeError> {
    let wrong = |what| EncodeError {
        parameter: "reply-by",
        what,
    };
    match time {
        FipaTime::Absolute { unix_millis, .. } if !is_writable(*unix_millis) => {
            Err(wrong("the year is not within 0000 and 9999"))
        }
        FipaTime::Absolute { unix_millis, .. } => {
            let t = CivilTime::from_unix_millis(*unix_millis);
            let pairs = [t.month, t.day, t.hour, t.minute, t.second];
            out.put_slice(&digits(t.year, pairs, t.millis));
            out.put_u8(b'Z');
            Ok(())
        }
        FipaTime::Relative(span) => {
            let pairs = [
                span.months,
                span.days,
                span.hours,
                span.minutes,
                span.seconds,
            ];
            if span.years > 9999 || span.millis > 999 || pairs.iter().any(|pair| *pair > 99) {
                return Err(wrong("a field of the span has too many digits"));
            }
            out.put_u8(if span.negative { b'-' } else { b'+' });
            out.put_slice(&digits(span.years, pairs, span.millis));
            Ok(())
        }
    }
}

fn digits(year: u16, [month, day, hour, minute, second]: [u8; 5], millis: u16) -> [u8; 18] {
    let [m1, m2] = pair(month.into());
    let [d1, d2] = pair(day.into());
    let [h1, h2] = pair(hour.into());
    let [n1, n2] = pair(minute.into());
    let [s1, s2] = pair(second.into());
    let [y1, y2] = pair(year / 100);
    let [y3, y4] = pair(year);
    let [i1, i2] = pair(millis / 10);
    let [_, i3] = pair(millis);
    [
        y1, y2, y3, y4, m1, m2, d1, d2, b'T', h1, h2, n1, n2, s1, s2, i1, i2, i3,
    ]
}

/// The last two decimal digits.
fn pair(number: u16) -> [u8; 2] {
    let [low, _] = (number % 10).to_le_bytes();
    let [high, _] = (number / 10 % 10).to_le_bytes();
    [b'0' + high, b'0' + low]
}
