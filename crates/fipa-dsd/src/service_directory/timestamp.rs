//! Times as Rock writes them: `YYYYMMDD-hh:mm:ss:uuuuuu`.
use fipa_acl::CivilTime;

/// The time in UTC of milliseconds since 1970-01-01T00:00:00Z.
pub(crate) fn write(unix_millis: i64) -> String {
    let CivilTime {
        year,
        month,
        day,
        hour,
        minute,
        second,
        millis,
    } = CivilTime::from_unix_millis(unix_millis);
    format!("{year:04}{month:02}{day:02}-{hour:02}:{minute:02}:{second:02}:{millis:03}000")
}

/// The time in milliseconds since 1970-01-01T00:00:00Z, if the text is one. Newer peers append the
/// offset of their zone (`+0100`); without it the time is taken as UTC, though it may be local.
pub(crate) fn read(text: &str) -> Option<i64> {
    let (date, time) = text.trim().split_once('-')?;
    let at = time.find(['+', '-']).unwrap_or(time.len());
    let (time, offset) = time.split_at_checked(at)?;
    let mut fields = time.split(':');
    let mut next = |digits| number(fields.next()?, digits);
    let (hour, minute, second, micros) = (next(2)?, next(2)?, next(2)?, next(6)?);
    if fields.next().is_some() {
        return None;
    }
    let civil = CivilTime {
        year: u16::try_from(number(date.get(..4)?, 4)?).ok()?,
        month: small(number(date.get(4..6)?, 2)?)?,
        day: small(number(date.get(6..)?, 2)?)?,
        hour: small(hour)?,
        minute: small(minute)?,
        second: small(second)?,
        millis: u16::try_from(micros / 1000).ok()?,
    };
    Some(civil.to_unix_millis().ok()? - offset_minutes(offset)? * 60_000)
}

/// `+0130` as 90.
fn offset_minutes(offset: &str) -> Option<i64> {
    let Some(digits) = offset.get(1..) else {
        return Some(0);
    };
    let digits = digits.replace(':', "");
    let (hours, minutes) = (
        number(digits.get(..2)?, 2)?,
        number(digits.get(2..)?, 2).or(digits.get(2..)?.is_empty().then_some(0))?,
    );
    let offset_minutes = i64::from(hours * 60 + minutes);
    Some(match offset.starts_with('-') {
        true => -offset_minutes,
        false => offset_minutes,
    })
}

fn number(text: &str, digits: usize) -> Option<u32> {
    let plain = text.len() == digits && text.bytes().all(|b| b.is_ascii_digit());
    plain.then(|| text.parse().ok())?
}

fn small(number: u32) -> Option<u8> {
    u8::try_from(number).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_written_in_utc_with_six_digits() {
        assert_eq!(write(0), "19700101-00:00:00:000000");
        assert_eq!(write(1_795_330_382_938), "20261122-06:53:02:938000");
    }

    #[test]
    fn times_of_all_peers_are_read() {
        for (text, expected) in [
            ("20261122-06:53:02:938849", 1_795_330_382_938),
            ("20261122-06:53:02:938000", 1_795_330_382_938),
            ("20261122-06:53:02:938849+0000", 1_795_330_382_938),
            ("20261122-07:53:02:938849+0100", 1_795_330_382_938),
            ("20261122-05:23:02:938849-01:30", 1_795_330_382_938),
        ] {
            assert_eq!(read(text), Some(expected), "{text}");
        }
    }

    #[test]
    fn what_is_no_time_is_none() {
        for text in [
            "",
            "-",
            "now",
            "20261122",
            "20261122-06:53:02",
            "20261322-06:53:02:938849",
            "20261122-06:53:02:93884",
            "20261122-06:53:02:938849:1",
            "2026112ä-06:53:02:938849",
            "20261122-06:53:02:938849+1",
            "20261122-06:53:02:938849+äö",
            "+0261122-06:53:02:938849",
        ] {
            assert_eq!(read(text), None, "{text}");
        }
    }
}
