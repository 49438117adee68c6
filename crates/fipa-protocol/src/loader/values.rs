use std::time::Duration;

use crate::pattern::PatternError;
use crate::performatives::Performatives;

/// `yes`, `true`, `1` or `no`, `false`, `0`.
pub(super) fn boolean(value: &str) -> Option<bool> {
    match value.trim() {
        "yes" | "true" | "1" => Some(true),
        "no" | "false" | "0" => Some(false),
        _ => None,
    }
}

/// A span such as `500ms`, `30s`, `2min` or `1h`.
pub(super) fn duration(value: &str) -> Option<Duration> {
    let value = value.trim();
    let unit = value.find(|c: char| !c.is_ascii_digit() && c != '.')?;
    let (number, unit) = value.split_at(unit);
    let seconds = match unit {
        "ms" => 0.001,
        "s" => 1.0,
        "min" => 60.0,
        "h" => 3600.0,
        _ => return None,
    };
    let number: f64 = number.parse().ok()?;
    Duration::try_from_secs_f64(number * seconds).ok()
}

/// The acts that an `event` of SCXML names: words separated by blanks, of which a trailing `.*`
/// or `.` says nothing; `*` is any.
pub(super) fn event(value: &str, max_pattern: usize) -> Result<Performatives, PatternError> {
    let words = value.split_whitespace().map(|word| match word {
        "*" | ".*" => ".*",
        word => word
            .strip_suffix(".*")
            .or(word.strip_suffix('.'))
            .unwrap_or(word),
    });
    Performatives::new(&words.collect::<Vec<_>>(), max_pattern)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_have_a_unit() {
        assert_eq!(duration("500ms"), Some(Duration::from_millis(500)));
        assert_eq!(duration("1.5s"), Some(Duration::from_millis(1500)));
        assert_eq!(duration("2min"), Some(Duration::from_secs(120)));
        for wrong in ["", "5", "s", "-1s", "5 s", "1e400h", "..s"] {
            assert_eq!(duration(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn events_are_words() {
        let acts = |value| event(value, 1 << 16).unwrap().to_string();
        assert_eq!(acts("inform agree.*"), "agree or inform");
        assert_eq!(acts("*"), "any act");
        assert_eq!(acts("inform|refuse"), "inform or refuse");
    }
}
