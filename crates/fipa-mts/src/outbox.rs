use std::collections::{HashSet, VecDeque};
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::{Envelope, Text};
use fipa_directory::InstanceId;

/// What an outbox holds at most: the letters for robots that are known but away.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutboxConfig {
    /// Letters for one peer.
    pub letters: usize,
    /// Octets of the letters for one peer.
    pub octets: usize,
    /// Octets of the letters for all peers together.
    pub total_octets: usize,
    /// How long a letter is kept.
    pub age: Duration,
}

impl Default for OutboxConfig {
    /// 1,000 letters and 64 MiB a peer, 256 MiB in all, a day.
    fn default() -> OutboxConfig {
        OutboxConfig {
            letters: 1000,
            octets: 64 << 20,
            total_octets: 256 << 20,
            age: Duration::from_secs(24 * 3600),
        }
    }
}

/// A letter as it is stored until its receiver is there again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredLetter {
    /// Its number in the store. Letters for one receiver are sent in the order of their numbers.
    pub key: u64,
    /// The receiver.
    pub to: Text,
    /// The platform on which the receiver was last; it is what the limits go by.
    pub peer: Text,
    /// When it was stored, in milliseconds since 1970-01-01T00:00:00Z.
    pub since: i64,
    /// When nobody wants it any more, in milliseconds since 1970-01-01T00:00:00Z.
    pub reply_by: Option<i64>,
    /// The letter as it is sent: the bit-efficient envelope with our stamp, and the payload.
    pub octets: Bytes,
}

/// A copy of a letter, whoever sends it again: the number in the stamp of the service that sent it
/// to its receiver's platform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct LetterId {
    pub(crate) instance: InstanceId,
    pub(crate) number: u64,
}

impl LetterId {
    /// Reads the id of a stamp; services of other makes write other things there.
    pub(crate) fn read(id: &str) -> Option<LetterId> {
        let (instance, number) = id.split_once(':')?;
        Some(LetterId {
            instance: instance.parse().ok()?,
            number: number.parse().ok()?,
        })
    }

    /// The copy that came to the platform of its receiver from another one: the stamp before the
    /// newest.
    pub(crate) fn of_copy(envelope: &Envelope) -> Option<LetterId> {
        let [.., stamped, _] = &envelope.overlays[..] else {
            return None;
        };
        LetterId::read(stamped.received.as_ref()?.id.as_deref()?)
    }
}

/// Copies that are remembered.
const REMEMBERED: usize = 16_384;

/// Which copies which agents have got.
#[derive(Debug, Default)]
pub(crate) struct Copies {
    got: HashSet<(LetterId, Text)>,
    order: VecDeque<(LetterId, Text)>,
}

impl Copies {
    /// Whether an agent has got this copy.
    pub(crate) fn has(&self, agent: &Text, copy: Option<LetterId>) -> bool {
        copy.is_some_and(|copy| self.got.contains(&(copy, agent.clone())))
    }

    /// Remembers that an agent has got this copy.
    pub(crate) fn put(&mut self, agent: &Text, copy: Option<LetterId>) {
        let Some(copy) = copy.map(|copy| (copy, agent.clone())) else {
            return;
        };
        self.got.insert(copy.clone());
        self.order.push_back(copy);
        if self.order.len() > REMEMBERED
            && let Some(oldest) = self.order.pop_front()
        {
            self.got.remove(&oldest);
        }
    }
}
