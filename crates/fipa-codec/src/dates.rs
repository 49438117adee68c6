//! Dates as text (SC00070I DateTimeToken), and what all forms of dates share.

use fipa_acl::{CivilTime, FipaTime, InvalidToken, Relative, Zone};

use crate::{Fault, Output};

/// DateTimeToken of SC00070I, as a point in time in UTC or a span.
pub(crate) fn parse(token: &[u8]) -> Result<FipaTime, (Fault, &'static str)> {
    FipaTime::from_token(token).map_err(|error| match error {
        InvalidToken::Shape => (Fault::Malformed, "a date is like 20260102T030405678Z"),
        InvalidToken::NoSuchDate => (Fault::Violation, "no such date"),
    })
}

/// The point in time of a date in a zone that adds so many milliseconds to UTC, if there is such a
/// date and its year has four digits in UTC.
#[inline]
pub(crate) fn absolute(local: CivilTime, offset: i64, zone: Zone) -> Option<FipaTime> {
    let unix_millis = local.to_unix_millis().ok()? - offset;
    is_writable(unix_millis).then_some(FipaTime::Absolute { unix_millis, zone })
}

/// Whether the year has four digits.
#[inline]
fn is_writable(unix_millis: i64) -> bool {
    FipaTime::from_unix_millis(unix_millis).unix_millis() == Some(unix_millis)
}

/// The fields of a point in time as they are written, in UTC.
#[inline]
pub(crate) fn civil(unix_millis: i64) -> Result<CivilTime, &'static str> {
    if is_writable(unix_millis) {
        Ok(CivilTime::from_unix_millis(unix_millis))
    } else {
        Err("the year is not within 0000 and 9999")
    }
}

/// The fields of two digits of a span: months, days, hours, minutes, seconds.
pub(crate) fn pairs_of(span: &Relative) -> Result<[u8; 5], &'static str> {
    let pairs = [
        span.months,
        span.days,
        span.hours,
        span.minutes,
        span.seconds,
    ];
    if span.years > 9999 || span.millis > 999 || pairs.iter().any(|pair| *pair > 99) {
        return Err("a field of the span has too many digits");
    }
    Ok(pairs)
}

/// DateTimeToken of SC00070I: a point in time in UTC, with its letter if that is wanted, or a span
/// with its sign.
pub(crate) fn write(
    time: &FipaTime,
    zone_letter: bool,
    out: &mut Output,
) -> Result<(), &'static str> {
    match time {
        FipaTime::Absolute { unix_millis, .. } => {
            let t = civil(*unix_millis)?;
            let pairs = [t.month, t.day, t.hour, t.minute, t.second];
            out.put_slice(&digits(t.year, pairs, t.millis));
            if zone_letter {
                out.put_u8(b'Z');
            }
        }
        FipaTime::Relative(span) => {
            let pairs = pairs_of(span)?;
            out.put_u8(if span.negative { b'-' } else { b'+' });
            out.put_slice(&digits(span.years, pairs, span.millis));
        }
    }
    Ok(())
}

fn digits(year: u16, [month, day, hour, minute, second]: [u8; 5], millis: u16) -> [u8; 18] {
    let [y1, y2] = pair(year / 100);
    let [y3, y4] = pair(year);
    let [m1, m2] = pair(month.into());
    let [d1, d2] = pair(day.into());
    let [h1, h2] = pair(hour.into());
    let [n1, n2] = pair(minute.into());
    let [s1, s2] = pair(second.into());
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
