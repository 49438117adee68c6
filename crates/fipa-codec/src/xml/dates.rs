use fipa_acl::{CivilTime, FipaTime, Relative, Text, Zone};

use crate::{EncodeError, Output};

const HOUR: i64 = 3_600_000;
const MINUTE: i64 = 60_000;

/// DateTimeToken of SC00070I as the peers write it: `[+-]YYYYMMDD?hhmmssmmm` and a zone.
///
/// JADE has a `Z` where the `T` belongs and means the local time of its machine.
pub(super) fn parse_time(text: &Text) -> Option<FipaTime> {
    let (sign, token) = match text.as_bytes() {
        [sign @ (b'+' | b'-'), token @ ..] => (Some(*sign), token),
        token => (None, token),
    };
    let (date, [letter, clock @ ..]) = token.split_first_chunk::<8>()? else {
        return None;
    };
    let (clock, zone) = clock.split_first_chunk::<9>()?;
    if !letter.is_ascii_alphabetic() {
        return None;
    }
    let [y1, y2, y3, y4, mo1, mo2, d1, d2] = *date;
    let [h1, h2, m1, m2, s1, s2, f1, f2, f3] = *clock;
    let year = number(&[y1, y2, y3, y4])?;
    let pairs = [[mo1, mo2], [d1, d2], [h1, h2], [m1, m2], [s1, s2]];
    let mut fields = [0_u8; 5];
    for (field, pair) in fields.iter_mut().zip(pairs) {
        *field = u8::try_from(number(&pair)?).ok()?;
    }
    let millis = number(&[f1, f2, f3])?;
    match sign {
        Some(sign) => Some(relative(sign == b'-', year, fields, millis)),
        None => absolute(year, fields, millis, zone),
    }
}

fn absolute(year: u16, fields: [u8; 5], millis: u16, zone: &[u8]) -> Option<FipaTime> {
    let [month, day, hour, minute, second] = fields;
    let local = CivilTime {
        year,
        month,
        day,
        hour,
        minute,
        second,
        millis,
    };
    let (offset, zone) = offset(zone)?;
    let unix_millis = local.to_unix_millis().ok()? - offset;
    is_writable(unix_millis).then_some(FipaTime::Absolute { unix_millis, zone })
}

fn relative(negative: bool, years: u16, fields: [u8; 5], millis: u16) -> FipaTime {
    let [months, days, hours, minutes, seconds] = fields;
    FipaTime::Relative(Relative {
        negative,
        years,
        months,
        days,
        hours,
        minutes,
        seconds,
        millis,
    })
}

/// What a zone adds to UTC, in milliseconds: a letter, or the digits that one peer puts behind.
/// `J` is the local time of somebody.
fn offset(zone: &[u8]) -> Option<(i64, Zone)> {
    let utc = |offset| Some((offset, Zone::Utc));
    match zone {
        [] | [b'J' | b'j'] => Some((0, Zone::Unspecified)),
        [letter] => match letter.to_ascii_uppercase() {
            b'Z' => utc(0),
            letter @ b'A'..=b'I' => utc((i64::from(letter - b'A') + 1) * HOUR),
            letter @ b'K'..=b'M' => utc((i64::from(letter - b'K') + 10) * HOUR),
            letter @ b'N'..=b'Y' => utc((-i64::from(letter - b'N') - 1) * HOUR),
            _ => None,
        },
        [sign @ (b'+' | b'-'), h1, h2, m1, m2] => {
            let hours = i64::from(number(&[*h1, *h2])?);
            let minutes = i64::from(number(&[*m1, *m2])?);
            let offset = hours * HOUR + minutes * MINUTE;
            utc(if *sign == b'-' { -offset } else { offset })
        }
        _ => None,
    }
}

fn number(digits: &[u8]) -> Option<u16> {
    digits.iter().try_fold(0_u16, |number, digit| {
        let digit = digit.checked_sub(b'0').filter(|digit| *digit < 10)?;
        Some(number * 10 + u16::from(digit))
    })
}

/// Whether the year has four digits.
fn is_writable(unix_millis: i64) -> bool {
    FipaTime::from_unix_millis(unix_millis).unix_millis() == Some(unix_millis)
}

/// A point in time in UTC, `YYYYMMDDThhmmssmmmZ`, or a span.
pub(super) fn write_time(
    time: &FipaTime,
    zone_letter: bool,
    parameter: &'static str,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let wrong = |what| EncodeError { parameter, what };
    match time {
        FipaTime::Absolute { unix_millis, .. } if !is_writable(*unix_millis) => {
            Err(wrong("the year is not within 0000 and 9999"))
        }
        FipaTime::Absolute { unix_millis, .. } => {
            let t = CivilTime::from_unix_millis(*unix_millis);
            let fields = [t.month, t.day, t.hour, t.minute, t.second];
            out.put_slice(&token(t.year, fields, t.millis));
            if zone_letter {
                out.put_u8(b'Z');
            }
            Ok(())
        }
        FipaTime::Relative(span) => write_span(span, out).map_err(wrong),
    }
}

fn write_span(span: &Relative, out: &mut Output) -> Result<(), &'static str> {
    let fields = [
        span.months,
        span.days,
        span.hours,
        span.minutes,
        span.seconds,
    ];
    if span.years > 9999 || span.millis > 999 || fields.iter().any(|field| *field > 99) {
        return Err("a field of the span has too many digits");
    }
    out.put_u8(if span.negative { b'-' } else { b'+' });
    out.put_slice(&token(span.years, fields, span.millis));
    Ok(())
}

fn token(year: u16, [month, day, hour, minute, second]: [u8; 5], millis: u16) -> [u8; 18] {
    let [y1, y2] = pair(year / 100);
    let [y3, y4] = pair(year % 100);
    let [mo1, mo2] = pair(month.into());
    let [d1, d2] = pair(day.into());
    let [h1, h2] = pair(hour.into());
    let [m1, m2] = pair(minute.into());
    let [s1, s2] = pair(second.into());
    let [f1, f2] = pair(millis / 10);
    let [_, f3] = pair(millis % 10);
    [
        y1, y2, y3, y4, mo1, mo2, d1, d2, b'T', h1, h2, m1, m2, s1, s2, f1, f2, f3,
    ]
}

/// The last two decimal digits.
fn pair(number: u16) -> [u8; 2] {
    let [tens, _] = (number / 10 % 10).to_le_bytes();
    let [ones, _] = (number % 10).to_le_bytes();
    [b'0' + tens, b'0' + ones]
}
