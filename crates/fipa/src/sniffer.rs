//! What passes a platform, for those who watch.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Weak};

use bytes::{Bytes, BytesMut};
use fipa_acl::{Letter, Message};
use fipa_codec::{Limits, bit_efficient};
use fipa_link::{Parts, Passed, Sniffed};
use tokio::sync::mpsc;

use crate::agent;
use crate::platform::Inner;

/// Octets that wait for a sniffer before it loses what comes.
const MAX_WAITING: usize = 64 << 20;

/// What an event takes beside the octets of its letter.
const EVENT: usize = 512;

/// What passes a platform, as it passes. Watching ends with it.
pub struct Sniffer {
    platform: Weak<Inner>,
    events: mpsc::UnboundedReceiver<Sniffed>,
    waiting: Arc<AtomicUsize>,
}

/// The platform's end of a sniffer. It never waits for the other end.
pub(crate) struct Tap {
    events: mpsc::UnboundedSender<Sniffed>,
    /// Octets that were not taken yet.
    waiting: Arc<AtomicUsize>,
    lost: u64,
}

impl Sniffer {
    pub(crate) fn new(platform: &Arc<Inner>) -> Sniffer {
        let (sender, events) = mpsc::unbounded_channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        let tap = Tap {
            events: sender,
            waiting: Arc::clone(&waiting),
            lost: 0,
        };
        platform.backend.with(|now, machine, hub| {
            hub.set_tap(tap);
            machine.sniff(now, true);
        });
        Sniffer {
            platform: Arc::downgrade(platform),
            events,
            waiting,
        }
    }

    /// The next that passes; `None` once the platform has ended. Cancel-safe.
    pub async fn next(&mut self) -> Option<Sniffed> {
        let event = self.events.recv().await?;
        Some(self.taken(event))
    }

    /// The next that passes, for threads outside of the runtime.
    pub fn blocking_next(&mut self) -> Option<Sniffed> {
        let event = self.events.blocking_recv()?;
        Some(self.taken(event))
    }

    /// What has passed already.
    pub fn try_next(&mut self) -> Option<Sniffed> {
        let event = self.events.try_recv().ok()?;
        Some(self.taken(event))
    }

    /// Ends the watch: letters that are under way come as they stand, then [`Passed::End`]. That
    /// does not come while the daemon of an attached platform is away.
    pub fn finish(&self) {
        if let Some(platform) = self.platform.upgrade() {
            platform.backend.with(|now, machine, hub| {
                if hub
                    .tap()
                    .is_some_and(|tap| Arc::ptr_eq(&tap.waiting, &self.waiting))
                {
                    machine.sniff(now, false);
                }
            });
        }
    }

    fn taken(&self, event: Sniffed) -> Sniffed {
        let octets = EVENT + event.octets();
        self.waiting.fetch_sub(octets, Ordering::Relaxed);
        event
    }
}

impl Drop for Sniffer {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Tap {
    /// Hands an event over, or counts it as lost.
    pub(crate) fn tell(&mut self, mut event: Sniffed) {
        let octets = EVENT + event.octets();
        let waiting = self.waiting.load(Ordering::Relaxed);
        let is_mark = matches!(event.passed, Passed::Begin | Passed::End);
        if waiting > 0 && waiting + octets > MAX_WAITING && !is_mark {
            self.lost += 1 + event.lost;
            return;
        }
        event.lost += std::mem::take(&mut self.lost);
        self.waiting.fetch_add(octets, Ordering::Relaxed);
        // Whoever does not watch any more has said so, or is about to.
        let _ = self.events.send(event);
    }
}

/// Reads the octets of a letter that passed: the letter, and the message in it unless that cannot
/// be read.
///
/// # Errors
/// Why the envelope cannot be read, in words.
pub fn open_letter(parts: &Parts) -> Result<(Letter, Result<Message, String>), String> {
    let octets = joined(parts);
    let (envelope, payload) = bit_efficient::decode_envelope(&octets, &Limits::default())
        .map_err(|error| error.to_string())?;
    let letter = Letter {
        envelope,
        payload: octets.slice(payload..),
    };
    let message = agent::read(&letter);
    Ok((letter, message))
}

fn joined(parts: &Parts) -> Bytes {
    let mut whole = BytesMut::with_capacity(parts.octets());
    parts.iter().for_each(|part| whole.extend_from_slice(part));
    whole.freeze()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sniffer_that_does_not_read_loses_events_and_is_told_how_many() {
        let (sender, mut events) = mpsc::unbounded_channel();
        let mut tap = Tap {
            events: sender,
            waiting: Arc::default(),
            lost: 0,
        };
        let half = Bytes::from(vec![0; MAX_WAITING / 2]);
        let event = |passed| Sniffed {
            number: 0,
            unix_millis: 0,
            lost: 0,
            passed,
        };
        let letter = || {
            event(Passed::Letter {
                from: "".into(),
                via: "".into(),
                outcomes: Vec::new(),
                parts: half.clone().into(),
            })
        };
        (0..4).for_each(|_| tap.tell(letter()));
        tap.tell(event(Passed::End));
        assert_eq!(events.try_recv().unwrap().lost, 0);
        let end = events.try_recv().unwrap();
        assert_eq!((end.passed, end.lost), (Passed::End, 3));
        assert!(events.try_recv().is_err());
    }
}
