//! How long things took, in few numbers.

use serde_json::{Value, json};

/// Times in microseconds, shortest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Times(Vec<f64>);

impl FromIterator<f64> for Times {
    fn from_iter<I: IntoIterator<Item = f64>>(times: I) -> Times {
        let mut times: Vec<f64> = times.into_iter().collect();
        times.sort_by(f64::total_cmp);
        Times(times)
    }
}

impl Times {
    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// The time that this share of all does not exceed; `None` of none.
    pub(crate) fn percentile(&self, share: f64) -> Option<f64> {
        let last = self.0.len().checked_sub(1)?;
        self.0.get((last as f64 * share).round() as usize).copied()
    }

    /// `{"min":…,"p50":…,"mean":…,"stddev":…,"p99":…,"max":…}`, or null.
    pub(crate) fn to_json(&self) -> Value {
        let (Some(min), Some(p50), Some(p99), Some(max)) = (
            self.percentile(0.0),
            self.percentile(0.5),
            self.percentile(0.99),
            self.percentile(1.0),
        ) else {
            return Value::Null;
        };
        let count = self.len() as f64;
        let mean = self.0.iter().sum::<f64>() / count;
        let variance = self.0.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / count;
        json!({
            "min": rounded(min),
            "p50": rounded(p50),
            "mean": rounded(mean),
            "stddev": rounded(variance.sqrt()),
            "p99": rounded(p99),
            "max": rounded(max),
        })
    }
}

/// With one digit after the point.
pub(crate) fn rounded(number: f64) -> f64 {
    (number * 10.0).round() / 10.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_numbers_tell_of_many() {
        let times: Times = (1..=101).rev().map(f64::from).collect();
        assert_eq!(
            times.to_json(),
            json!({"min": 1.0, "p50": 51.0, "mean": 51.0, "stddev": 29.2, "p99": 100.0, "max": 101.0})
        );
        assert_eq!(Times::default().to_json(), Value::Null);
        assert_eq!(Times::default().percentile(0.5), None);
    }
}
