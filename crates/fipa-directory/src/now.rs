use std::time::Duration;

/// The time, as it is handed to every state machine: none of them asks for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Now {
    /// Time since the program started, by a clock that only runs forward. Deadlines go by it.
    pub mono: Duration,
    /// Milliseconds since 1970-01-01T00:00:00Z, by the machine's clock. Dates are written by it.
    pub unix_millis: i64,
}

impl Now {
    /// This time and so much more on both clocks.
    #[must_use]
    pub fn plus(self, span: Duration) -> Now {
        Now {
            mono: self.mono + span,
            unix_millis: self
                .unix_millis
                .saturating_add(i64::try_from(span.as_millis()).unwrap_or(i64::MAX)),
        }
    }
}
