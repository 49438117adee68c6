use std::collections::VecDeque;
use std::time::Duration;

use fipa_acl::Text;

/// Heartbeats for which a grant lasts at its holder.
pub(crate) const LEASE: u32 = 3;
/// Heartbeats of silence after which an agent counts as dead.
pub(crate) const SILENCE: u32 = 4;
/// Answers to older probes than so many say nothing any more.
const REMEMBERED: usize = 4;

/// Another agent that is probed.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Watch {
    heartbeat: Duration,
    /// When it last answered, or when we began.
    pub(crate) heard: Duration,
    pub(crate) next: Duration,
    pub(crate) open: VecDeque<Probe>,
}

/// A probe that was not answered yet.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Probe {
    pub(crate) conversation: Text,
    pub(crate) sent: Duration,
    /// The number of the grant that it wants to have confirmed.
    pub(crate) fencing: Option<u64>,
}

impl Watch {
    /// A watch whose first probe is due at once.
    pub(crate) fn new(now: Duration, heartbeat: Duration) -> Watch {
        Watch {
            heartbeat,
            heard: now,
            next: now,
            open: VecDeque::new(),
        }
    }

    pub(crate) fn set_heartbeat(&mut self, heartbeat: Duration) {
        self.heartbeat = heartbeat;
    }

    pub(crate) fn is_due(&self, now: Duration) -> bool {
        self.next <= now
    }

    pub(crate) fn is_silent(&self, now: Duration) -> bool {
        self.dead_at() <= now
    }

    pub(crate) fn dead_at(&self) -> Duration {
        self.heard + self.heartbeat * SILENCE
    }

    pub(crate) fn sent(&mut self, probe: Probe) {
        self.next = probe.sent + self.heartbeat;
        if self.open.len() == REMEMBERED {
            self.open.pop_front();
        }
        self.open.push_back(probe);
    }

    /// The probe of this conversation was answered.
    pub(crate) fn answered(&mut self, now: Duration, conversation: &str) -> Option<Probe> {
        let mut open = self.open.iter();
        let at = open.position(|probe| probe.conversation == *conversation)?;
        self.heard = now;
        self.open.remove(at)
    }
}
