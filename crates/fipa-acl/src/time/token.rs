use super::{CivilTime, FipaTime, InvalidTime, Relative, Zone};

const MINUTE: i64 = 60_000;

/// Why a token is no date.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InvalidToken {
    /// It is not built like one.
    #[error("a date is like 20260102T030405678Z")]
    Shape,
    /// It is built like one, but no calendar has it.
    #[error("no such date")]
    NoSuchDate,
}

impl FipaTime {
    /// Reads DateTimeToken of FIPA SC00070I and SC00008I, as a point in time in UTC or a span.
    ///
    /// The milliseconds may be missing, and the zone may be an offset such as `+0100`. JADE has a
    /// `Z` where the `T` belongs, and any letter is taken there.
    ///
    /// ```
    /// use fipa_acl::FipaTime;
    ///
    /// let time = FipaTime::from_token(b"20261122T100000000Z").unwrap();
    /// assert_eq!(time.to_string(), "2026-11-22T10:00:00.000Z");
    /// assert_eq!(time.to_token().unwrap(), "20261122T100000000Z");
    /// ```
    pub fn from_token(token: &[u8]) -> Result<FipaTime, InvalidToken> {
        parse(token)
    }

    /// The DateTimeToken of this time: in UTC with its zone letter, or a span with its sign.
    ///
    /// Fails where a field has more digits than the token has room for.
    pub fn to_token(&self) -> Result<String, InvalidTime> {
        let (sign, digits, zone) = match self {
            FipaTime::Absolute { unix_millis, .. } if !is_writable(*unix_millis) => {
                return Err(InvalidTime("the year is not within 0000 and 9999"));
            }
            FipaTime::Absolute { unix_millis, .. } => {
                let t = CivilTime::from_unix_millis(*unix_millis);
                let pairs = [t.month, t.day, t.hour, t.minute, t.second];
                ("", digits(t.year, pairs, t.millis), "Z")
            }
            FipaTime::Relative(span) => {
                let pairs = span.pairs();
                if span.years > 9999 || span.millis > 999 || pairs.iter().any(|pair| *pair > 99) {
                    return Err(InvalidTime("a field of the span has too many digits"));
                }
                let sign = if span.negative { "-" } else { "+" };
                (sign, digits(span.years, pairs, span.millis), "")
            }
        };
        Ok(format!("{sign}{digits}{zone}"))
    }
}

impl Relative {
    fn pairs(&self) -> [u8; 5] {
        [
            self.months,
            self.days,
            self.hours,
            self.minutes,
            self.seconds,
        ]
    }
}

fn parse(token: &[u8]) -> Result<FipaTime, InvalidToken> {
    let (sign, text) = match token {
        [sign @ (b'+' | b'-'), text @ ..] => (Some(*sign), text),
        _ => (None, token),
    };
    let (date, text) = text.split_at_checked(8).ok_or(InvalidToken::Shape)?;
    let [b'A'..=b'Z' | b'a'..=b'z', text @ ..] = text else {
        return Err(InvalidToken::Shape);
    };
    let digits = text.iter().take_while(|octet| octet.is_ascii_digit());
    let (time, zone) = text.split_at(digits.count());
    let fields = Fields::of(date, time).ok_or(InvalidToken::Shape)?;
    let (offset, zone) = offset_of(zone).ok_or(InvalidToken::Shape)?;
    match sign {
        None => fields.absolute(offset, zone),
        Some(sign) => fields.relative(sign == b'-'),
    }
    .ok_or(InvalidToken::NoSuchDate)
}

/// What a zone adds to UTC, in milliseconds: a letter, or hours and minutes.
fn offset_of(zone: &[u8]) -> Option<(i64, Zone)> {
    match zone {
        [] => Some((0, Zone::Unspecified)),
        [letter] => Zone::of_letter(*letter),
        [b'+', digits @ ..] => Some((offset_of_digits(digits)?, Zone::Utc)),
        [b'-', digits @ ..] => Some((-offset_of_digits(digits)?, Zone::Utc)),
        _ => None,
    }
}

impl Zone {
    /// What a letter of the military zones adds to UTC, in milliseconds, and the zone of a point in
    /// time that it stands behind once that is in UTC. `J` is the local time of somebody.
    pub fn of_letter(letter: u8) -> Option<(i64, Zone)> {
        let letter = letter.to_ascii_uppercase();
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
        Fields::with_millis(date, time).or_else(|| Fields::of_any(date, time))
    }

    /// As nearly everybody writes them.
    #[inline]
    fn with_millis(date: &[u8], time: &[u8]) -> Option<Fields> {
        let (time, [last @ b'0'..=b'9']) = time.split_first_chunk()? else {
            return None;
        };
        let [century, year, month, day] = four_pairs(*date.first_chunk()?)?;
        let [hour, minute, second, millis] = four_pairs(*time)?;
        Some(Fields {
            year: u16::from(century) * 100 + u16::from(year),
            pairs: [month, day, hour, minute, second],
            millis: u16::from(millis) * 10 + u16::from(last - b'0'),
        })
    }

    fn of_any(date: &[u8], time: &[u8]) -> Option<Fields> {
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

/// The numbers in eight digits, two each.
#[inline]
fn four_pairs(digits: [u8; 8]) -> Option<[u8; 4]> {
    const fn each(octet: u8) -> u64 {
        u64::from_le_bytes([octet; 8])
    }
    // What is more than nine becomes more than 7F, or is it already.
    let digits = u64::from_le_bytes(digits) ^ each(b'0');
    if (digits | digits.wrapping_add(each(0x7f - 9))) & each(0x80) != 0 {
        return None;
    }
    // Each first digit is in the lower octet of its two.
    let [first, _, second, _, third, _, fourth, _] = (digits * 10 + (digits >> 8)).to_le_bytes();
    Some([first, second, third, fourth])
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

fn digits(year: u16, [month, day, hour, minute, second]: [u8; 5], millis: u16) -> String {
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}{millis:03}")
}

fn is_digits(text: &[u8]) -> bool {
    !text.is_empty() && text.iter().all(u8::is_ascii_digit)
}
