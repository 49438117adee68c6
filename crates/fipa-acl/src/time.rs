mod token;

use std::fmt;
use std::str::FromStr;

pub use token::InvalidToken;

/// A point in time or a span, as FIPA SC00070I writes them, to the millisecond.
///
/// ```
/// use fipa_acl::FipaTime;
///
/// let time: FipaTime = "2026-11-22T10:00:00.000Z".parse().unwrap();
/// assert_eq!(time.unix_millis(), Some(1_795_341_600_000));
/// let in_ten: FipaTime = "+PT10S".parse().unwrap();
/// assert_eq!(in_ten.resolve(1_000), 11_000);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FipaTime {
    /// A point in time.
    Absolute {
        /// Milliseconds since 1970-01-01T00:00:00Z, years 0 to 9999. A time without a zone
        /// counts as UTC.
        unix_millis: i64,
        /// Whether a zone was given.
        zone: Zone,
    },
    /// A span from the time of reading.
    Relative(Relative),
}

/// Whether a date said which zone it is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Zone {
    /// UTC; what stood in another zone was converted.
    Utc,
    /// No zone was given: local time of somebody, read as UTC.
    Unspecified,
}

/// A span of time in the fields of a FIPA date.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Relative {
    /// Whether it points into the past.
    pub negative: bool,
    /// Years of 365 days, up to 9999.
    pub years: u16,
    /// Months of 30 days, up to 99.
    pub months: u8,
    /// Days, up to 99.
    pub days: u8,
    /// Hours, up to 99.
    pub hours: u8,
    /// Minutes, up to 99.
    pub minutes: u8,
    /// Seconds, up to 99.
    pub seconds: u8,
    /// Milliseconds, up to 999.
    pub millis: u16,
}

/// A date and time of day in the proleptic Gregorian calendar, without a zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CivilTime {
    /// 0 to 9999.
    pub year: u16,
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
    /// 0 to 23.
    pub hour: u8,
    /// 0 to 59.
    pub minute: u8,
    /// 0 to 59; 60 (a leap second) is read as the second after 59.
    pub second: u8,
    /// 0 to 999.
    pub millis: u16,
}

/// The text or the fields are no time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct InvalidTime(&'static str);

impl InvalidTime {
    /// What is wrong.
    pub fn as_str(&self) -> &'static str {
        self.0
    }
}

const DAY: i64 = 86_400_000;
const YEAR_0: i64 = -62_167_219_200_000;
const YEAR_10000: i64 = 253_402_300_800_000;

impl FipaTime {
    /// The point in time this many milliseconds after 1970-01-01T00:00:00Z, held within the years
    /// 0 to 9999 that FIPA can write.
    pub fn from_unix_millis(unix_millis: i64) -> FipaTime {
        FipaTime::Absolute {
            unix_millis: unix_millis.clamp(YEAR_0, YEAR_10000 - 1),
            zone: Zone::Utc,
        }
    }

    /// Milliseconds since 1970-01-01T00:00:00Z; `None` for a relative time.
    pub fn unix_millis(&self) -> Option<i64> {
        match self {
            FipaTime::Absolute { unix_millis, .. } => Some(*unix_millis),
            FipaTime::Relative(_) => None,
        }
    }

    /// The point in time that this means when read at `now` (both in milliseconds since
    /// 1970-01-01T00:00:00Z).
    pub fn resolve(&self, now: i64) -> i64 {
        match self {
            FipaTime::Absolute { unix_millis, .. } => *unix_millis,
            FipaTime::Relative(span) => now.saturating_add(span.as_millis()),
        }
    }

    /// Reads what [`Display`](fmt::Display) writes: RFC 3339, or a signed ISO 8601 duration.
    pub fn parse(text: &str) -> Result<FipaTime, InvalidTime> {
        match text.as_bytes() {
            [b'+', ..] => Relative::parse(&text[1..], false).map(FipaTime::Relative),
            [b'-', ..] => Relative::parse(&text[1..], true).map(FipaTime::Relative),
            _ => parse_rfc3339(text),
        }
    }
}

impl Relative {
    /// The span in milliseconds, with years of 365 and months of 30 days.
    pub fn as_millis(&self) -> i64 {
        let days = i64::from(self.years) * 365 + i64::from(self.months) * 30 + i64::from(self.days);
        let seconds =
            i64::from(self.hours) * 3600 + i64::from(self.minutes) * 60 + i64::from(self.seconds);
        let span = days * DAY + seconds * 1000 + i64::from(self.millis);
        if self.negative { -span } else { span }
    }

    /// `P[nY][nM][nD][T[nH][nM][n[.fff]S]]`; hours, minutes and seconds beyond those of the clock
    /// carry as long as the days have two digits.
    fn parse(text: &str, negative: bool) -> Result<Relative, InvalidTime> {
        const SHAPE: InvalidTime = InvalidTime("a duration is like +PT10S or +P1DT2H");
        let body = text.strip_prefix('P').ok_or(SHAPE)?;
        let (date, time) = body.split_once('T').unwrap_or((body, ""));
        if date.is_empty() && time.is_empty() {
            return Err(SHAPE);
        }
        let [years, months, days] = designated(date, ["Y", "M", "D"]).ok_or(SHAPE)?;
        let [hours, minutes, seconds] = designated(time, ["H", "M", "S"]).ok_or(SHAPE)?;
        let whole = |n: u64| n.is_multiple_of(1000).then_some(n / 1000);
        let whole = [years, months, days, hours, minutes].map(whole);
        let mut fields = [0; 5];
        for (field, number) in fields.iter_mut().zip(whole) {
            *field = number.ok_or(SHAPE)?;
        }
        Relative::of(negative, fields, seconds)
            .ok_or(InvalidTime("a relative time is shorter than 100 days"))
    }

    /// The span of these years, months, days, hours and minutes, and of so many milliseconds.
    fn of(
        negative: bool,
        [years, months, days, hours, minutes]: [u64; 5],
        millis: u64,
    ) -> Option<Relative> {
        let field = |number: u64| u8::try_from(number).ok().filter(|field| *field < 100);
        let dated = Relative {
            negative,
            years: u16::try_from(years).ok().filter(|years| *years < 10_000)?,
            months: field(months)?,
            ..Relative::default()
        };
        let clock = hours
            .checked_mul(60)?
            .checked_add(minutes)?
            .checked_mul(60_000)?
            .checked_add(millis)?;
        dated.carried(days, clock).or_else(|| {
            // Its fields hold it as it is.
            Some(Relative {
                days: field(days)?,
                hours: field(hours)?,
                minutes: field(minutes)?,
                seconds: field(millis / 1000)?,
                millis: (millis % 1000) as u16,
                ..dated
            })
        })
    }

    /// The span with so many days and milliseconds, without hours, minutes and seconds beyond
    /// those of the clock; `None` if these days have more than two digits.
    fn carried(self, days: u64, millis: u64) -> Option<Relative> {
        let days = u8::try_from(days.checked_add(millis / 86_400_000)?).ok()?;
        (days < 100).then_some(Relative {
            days,
            hours: (millis / 3_600_000 % 24) as u8,
            minutes: (millis / 60_000 % 60) as u8,
            seconds: (millis / 1000 % 60) as u8,
            millis: (millis % 1000) as u16,
            ..self
        })
    }
}

/// Reads `n<designator>` parts in order, each optional; the values are thousandths.
fn designated(mut text: &str, designators: [&str; 3]) -> Option<[u64; 3]> {
    let mut values = [0; 3];
    for (value, designator) in values.iter_mut().zip(designators) {
        let end = text
            .find(|c: char| !c.is_ascii_digit() && c != '.')
            .unwrap_or(text.len());
        let Some(rest) = text[end..].strip_prefix(designator) else {
            continue;
        };
        *value = thousandths(&text[..end])?;
        text = rest;
    }
    text.is_empty().then_some(values)
}

/// `12` or `12.345` (up to three decimals are kept) as 12345.
fn thousandths(text: &str) -> Option<u64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, "0"));
    let digits = |t: &str| !t.is_empty() && t.bytes().all(|b| b.is_ascii_digit());
    if !digits(whole) || !digits(fraction) {
        return None;
    }
    let fraction: u64 = format!("{fraction:0<3}")[..3].parse().ok()?;
    whole
        .parse::<u64>()
        .ok()?
        .checked_mul(1000)?
        .checked_add(fraction)
}

impl CivilTime {
    /// The civil time in UTC of a point in time.
    pub fn from_unix_millis(unix_millis: i64) -> CivilTime {
        let unix_millis = unix_millis.clamp(YEAR_0, YEAR_10000 - 1);
        // 32 bits hold the days and the milliseconds of a day; they are divided faster.
        let since_year_0 = (unix_millis - YEAR_0) as u64;
        let (year, month, day) = civil_from_days((since_year_0 / DAY as u64) as u32);
        let rest = (since_year_0 % DAY as u64) as u32;
        CivilTime {
            year,
            month,
            day,
            hour: (rest / 3_600_000) as u8,
            minute: (rest / 60_000 % 60) as u8,
            second: (rest / 1000 % 60) as u8,
            millis: (rest % 1000) as u16,
        }
    }

    /// Milliseconds since 1970-01-01T00:00:00 of the same zone.
    pub fn to_unix_millis(self) -> Result<i64, InvalidTime> {
        let leap = self.year.is_multiple_of(4)
            && (!self.year.is_multiple_of(100) || self.year.is_multiple_of(400));
        let days = match self.month {
            1 | 3 | 5 | 7 | 8 | 10 | 12 => 31,
            4 | 6 | 9 | 11 => 30,
            2 if leap => 29,
            2 => 28,
            _ => return Err(InvalidTime("the month is not within 01 and 12")),
        };
        if self.day == 0 || self.day > days {
            return Err(InvalidTime("the month has no such day"));
        }
        if self.year > 9999 || self.hour > 23 || self.minute > 59 || self.second > 60 {
            return Err(InvalidTime("a field is out of range"));
        }
        if self.millis > 999 {
            return Err(InvalidTime("the milliseconds are more than 999"));
        }
        let seconds =
            u32::from(self.hour) * 3600 + u32::from(self.minute) * 60 + u32::from(self.second);
        let days = days_from_civil(self.year.into(), self.month.into(), self.day.into());
        let of_day = seconds * 1000 + u32::from(self.millis);
        Ok(YEAR_0 + i64::from(days) * DAY + i64::from(of_day))
    }
}

/// Days of an era of 400 years, after which the calendar repeats itself.
const ERA: u32 = 146_097;

/// Days from 0000-01-01 to the next March, with which the years of eras begin.
const TO_MARCH: u32 = 60;

/// Days since 0000-01-01.
fn days_from_civil(year: u32, month: u32, day: u32) -> u32 {
    // One era more, because January of the year 0 is in front of the first one.
    let year = year + 400 - u32::from(month <= 2);
    let month_from_march = (month + 9) % 12;
    let day_of_year = (153 * month_from_march + 2) / 5 + day - 1;
    let leap_days = year / 4 - year / 100 + year / 400;
    year * 365 + leap_days + day_of_year + TO_MARCH - ERA
}

/// Year, month and day of so many days since 0000-01-01.
fn civil_from_days(days: u32) -> (u16, u8, u8) {
    let days = days + ERA - TO_MARCH;
    let (era, day_of_era) = (days / ERA, days % ERA);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = era * 400 + year_of_era + u32::from(month <= 2) - 400;
    (year as u16, month as u8, day as u8)
}

/// `YYYY-MM-DDThh:mm:ss[.fff…][Z|±hh:mm]`; without an offset it is read as UTC.
fn parse_rfc3339(text: &str) -> Result<FipaTime, InvalidTime> {
    const SHAPE: InvalidTime = InvalidTime("a date is like 2026-11-22T10:00:00.000Z");
    let field = |from: usize, len: usize| -> Result<u16, InvalidTime> {
        let digits = text.get(from..from + len).ok_or(SHAPE)?;
        if digits.bytes().all(|b| b.is_ascii_digit()) {
            digits.parse().map_err(|_| SHAPE)
        } else {
            Err(SHAPE)
        }
    };
    let octet = |at: usize| text.as_bytes().get(at).copied().unwrap_or(0);
    if [octet(4), octet(7), octet(13), octet(16)] != *b"--::"
        || !matches!(octet(10), b'T' | b't' | b' ')
    {
        return Err(SHAPE);
    }
    let mut rest = text.get(19..).ok_or(SHAPE)?;
    let mut millis = 0;
    if let Some(fraction) = rest.strip_prefix('.') {
        let end = fraction
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(fraction.len());
        let thousandths = thousandths(&format!("0.{}", &fraction[..end])).ok_or(SHAPE)?;
        millis = thousandths as u16;
        rest = &fraction[end..];
    }
    let civil = CivilTime {
        year: field(0, 4)?,
        month: field(5, 2)? as u8,
        day: field(8, 2)? as u8,
        hour: field(11, 2)? as u8,
        minute: field(14, 2)? as u8,
        second: field(17, 2)? as u8,
        millis,
    };
    let (offset_minutes, zone) = parse_offset(rest).ok_or(SHAPE)?;
    let unix_millis = civil.to_unix_millis()? - offset_minutes * 60_000;
    if !(YEAR_0..YEAR_10000).contains(&unix_millis) {
        return Err(InvalidTime("the year is not within 0000 and 9999"));
    }
    Ok(FipaTime::Absolute { unix_millis, zone })
}

fn parse_offset(text: &str) -> Option<(i64, Zone)> {
    match text.as_bytes() {
        [] => Some((0, Zone::Unspecified)),
        [b'Z' | b'z'] => Some((0, Zone::Utc)),
        [sign @ (b'+' | b'-'), h1, h2, b':', m1, m2]
            if [h1, h2, m1, m2].iter().all(|b| b.is_ascii_digit()) =>
        {
            let two = |a: &u8, b: &u8| i64::from(a - b'0') * 10 + i64::from(b - b'0');
            let minutes = two(h1, h2) * 60 + two(m1, m2);
            Some((if *sign == b'-' { -minutes } else { minutes }, Zone::Utc))
        }
        _ => None,
    }
}

impl fmt::Display for FipaTime {
    /// RFC 3339 in UTC with milliseconds, or an ISO 8601 duration with its sign and without zero
    /// parts.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FipaTime::Absolute { unix_millis, .. } => {
                let t = CivilTime::from_unix_millis(*unix_millis);
                write!(
                    f,
                    "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z",
                    t.year, t.month, t.day, t.hour, t.minute, t.second, t.millis
                )
            }
            FipaTime::Relative(span) => fmt_span(span, f),
        }
    }
}

fn fmt_span(span: &Relative, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let clock = (u64::from(span.hours) * 60 + u64::from(span.minutes)) * 60;
    let millis = (clock + u64::from(span.seconds)) * 1000 + u64::from(span.millis);
    // As it is read.
    let span = span.carried(span.days.into(), millis).unwrap_or(*span);
    let part = |f: &mut fmt::Formatter<'_>, n: u16, designator: char| match n {
        0 => Ok(()),
        n => write!(f, "{n}{designator}"),
    };
    f.write_str(if span.negative { "-P" } else { "+P" })?;
    part(f, span.years, 'Y')?;
    part(f, span.months.into(), 'M')?;
    part(f, span.days.into(), 'D')?;
    let date_only = span.years > 0 || span.months > 0 || span.days > 0;
    let zero_time = span.hours == 0 && span.minutes == 0 && span.seconds == 0 && span.millis == 0;
    if date_only && zero_time {
        return Ok(());
    }
    f.write_str("T")?;
    part(f, span.hours.into(), 'H')?;
    part(f, span.minutes.into(), 'M')?;
    match (span.seconds, span.millis) {
        (0, 0) if !zero_time => Ok(()),
        (seconds, 0) => write!(f, "{seconds}S"),
        (seconds, millis) => {
            let fraction = format!("{millis:03}");
            write!(f, "{seconds}.{}S", fraction.trim_end_matches('0'))
        }
    }
}

impl FromStr for FipaTime {
    type Err = InvalidTime;
    fn from_str(text: &str) -> Result<FipaTime, InvalidTime> {
        FipaTime::parse(text)
    }
}
