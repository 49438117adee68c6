//! Points in time as people read them.

use std::time::Duration;

use ::time::OffsetDateTime;

/// Since 1970-01-01T00:00:00Z, as a date of certificates; the last one that there is, if it is later.
pub(crate) fn date(since_epoch: Duration) -> OffsetDateTime {
    let seconds = i64::try_from(since_epoch.as_secs()).unwrap_or(i64::MAX);
    let last = ::time::Date::MAX.midnight().assume_utc();
    OffsetDateTime::from_unix_timestamp(seconds).unwrap_or(last)
}

/// `2026-11-22 10:00 UTC`.
pub(crate) fn shown(since_epoch: Duration) -> String {
    let at = date(since_epoch);
    format!("{} {:02}:{:02} UTC", at.date(), at.hour(), at.minute())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_shown_to_the_minute() {
        assert_eq!(shown(Duration::from_secs(0)), "1970-01-01 00:00 UTC");
        assert_eq!(
            shown(Duration::from_secs(1_795_341_600)),
            "2026-11-22 10:00 UTC"
        );
        assert!(shown(Duration::MAX).starts_with("9999-12-31"));
    }
}
