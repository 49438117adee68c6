use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use fipa_directory::Now;

/// The time that is handed to the state machines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    start: Instant,
}

/// The monotonic clock starts here, so that what another process has known for long can be given
/// its true age.
const OFFSET: Duration = Duration::from_secs(100 * 365 * 86_400);

impl Clock {
    pub(crate) fn start() -> Clock {
        Clock {
            start: Instant::now(),
        }
    }

    pub(crate) fn now(&self) -> Now {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH);
        let millis = since_epoch.unwrap_or_default().as_millis();
        Now {
            mono: OFFSET + self.start.elapsed(),
            unix_millis: i64::try_from(millis).unwrap_or(i64::MAX),
        }
    }

    /// The instant at which the monotonic clock shows this.
    pub(crate) fn instant(&self, mono: Duration) -> Instant {
        self.start + mono.saturating_sub(OFFSET)
    }
}
