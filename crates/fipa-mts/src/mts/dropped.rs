//! Stored letters that are given up, until their senders know: the disk keeps them as long, so that
//! a crash does not swallow the notice.

use std::collections::BTreeMap;
use std::time::Duration;

use fipa_acl::Text;
use fipa_codec::bit_efficient;
use fipa_directory::Now;
use fipa_link::{Outcome, ReceiverOutcome};

use super::Mts;
use super::notices::Returnable;
use crate::StoredLetter;
use crate::machine::{Notice, Output};

/// How long the sender of a letter is looked for: a program that lost its daemon is back by then.
const PATIENCE: Duration = Duration::from_secs(60);

/// Letters whose senders are looked for, at most.
const MAX_DROPPED: usize = 10_000;

/// Letters that were given up, by their keys.
pub(super) type AllDropped = BTreeMap<u64, Dropped>;

/// A letter that was given up.
#[derive(Debug)]
pub(super) struct Dropped {
    letter: Returnable,
    told: ReceiverOutcome,
    until: Duration,
    /// A notice is on its way.
    telling: bool,
}

impl Mts {
    /// The one place at which a letter is lost whose sender was told that it is stored.
    pub(super) fn stored_letter_dropped(
        &mut self,
        now: Now,
        stored: StoredLetter,
        outcome: Outcome,
        reason: Text,
    ) {
        let StoredLetter {
            key, to, octets, ..
        } = stored;
        let read = bit_efficient::decode_envelope(&octets, &self.config.limits).ok();
        let from = read
            .as_ref()
            .and_then(|(e, _)| Some(e.from()?.name.detached()));
        self.notice(Notice::StoredLetterDropped {
            from: from.unwrap_or_default(),
            to: to.clone(),
            octets: octets.len(),
            reason: reason.clone(),
        });
        let Some((envelope, at)) = read else {
            self.outputs.push_back(Output::Unstore(key));
            return;
        };
        let dropped = Dropped {
            letter: Returnable::stored(envelope, octets.slice(at..)),
            told: ReceiverOutcome {
                to,
                outcome,
                via: None,
                reason,
            },
            until: now.mono + PATIENCE,
            telling: false,
        };
        if self.dropped.len() >= MAX_DROPPED {
            self.forget_oldest();
        }
        self.dropped.insert(key, dropped);
        self.tell_dropped(now, key);
    }

    fn forget_oldest(&mut self) {
        if let Some((key, _)) = self.dropped.pop_first() {
            self.outputs.push_back(Output::Unstore(key));
        }
    }

    fn tell_dropped(&mut self, now: Now, key: u64) {
        let Some(dropped) = self.dropped.get_mut(&key) else {
            return;
        };
        if std::mem::replace(&mut dropped.telling, true) {
            return;
        }
        let (letter, told) = (dropped.letter.clone(), dropped.told.clone());
        if !self.return_letter_of(now, &letter, &[told], Some(key)) {
            self.dropped.remove(&key);
            self.outputs.push_back(Output::Unstore(key));
        }
    }

    /// A notice of a letter that was given up has its outcome; whether that is the end of it.
    pub(super) fn dropped_told(&mut self, now: Now, key: u64, arrived: bool) -> bool {
        let Some(dropped) = self.dropped.get_mut(&key) else {
            return true;
        };
        dropped.telling = false;
        let ends = arrived || dropped.until <= now.mono;
        if ends {
            self.dropped.remove(&key);
            self.outputs.push_back(Output::Unstore(key));
        } else {
            self.tick_outbox(now);
        }
        ends
    }

    /// Tries again to tell whoever could not be told.
    pub(super) fn tell_all_dropped(&mut self, now: Now) {
        let keys: Vec<u64> = self.dropped.keys().copied().collect();
        keys.into_iter().for_each(|key| self.tell_dropped(now, key));
    }
}
