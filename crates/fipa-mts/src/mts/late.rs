//! Letters that a peer had stored, and sends again: answered, not delivered twice.
//!
//! A letter that its service sends for the first time bears that service's id and the letter's
//! number on the link in its newest stamp. One that comes with other numbers was stored, perhaps by
//! an earlier run of the service, and may have come before, under the numbers in its stamp.

use std::collections::{HashMap, VecDeque};

use fipa_acl::Envelope;
use fipa_directory::{InstanceId, Now};

use super::Mts;
use super::deliveries::Origin;
use super::seen::{Seen, SeenLetter};
use crate::machine::ConnId;
use crate::outbox::LetterId;

/// Letters that are remembered.
const REMEMBERED: usize = 65_536;

/// Letters of a run that is forgotten which are remembered here: those that came last, of whose
/// receipts the sender may not know.
const OF_A_RUN: usize = 4096;

/// What became of letters that had been stored.
#[derive(Debug, Default)]
pub(super) struct Late {
    letters: HashMap<LetterId, SeenLetter>,
    order: VecDeque<LetterId>,
}

impl Late {
    pub(super) fn set(&mut self, id: LetterId, letter: SeenLetter) {
        if self.letters.insert(id, letter).is_none() {
            self.order.push_back(id);
            if self.order.len() > REMEMBERED
                && let Some(oldest) = self.order.pop_front()
            {
                self.letters.remove(&oldest);
            }
        }
    }

    /// Remembers what a run has sent last that arrived.
    pub(super) fn take_over(&mut self, instance: InstanceId, seen: &Seen) {
        let mut arrived: Vec<(u64, SeenLetter)> = seen.arrived().take(OF_A_RUN).collect();
        arrived.reverse();
        for (number, letter) in arrived {
            self.set(LetterId { instance, number }, letter);
        }
    }
}

impl Mts {
    /// The letter that a peer sends again, if it is one that was stored.
    pub(super) fn late_letter(
        instance: InstanceId,
        number: u64,
        envelope: &Envelope,
    ) -> Option<LetterId> {
        let stamp = envelope.overlays.last()?.received.as_ref()?;
        let id = LetterId::read(stamp.id.as_deref()?)?;
        (id != LetterId { instance, number }).then_some(id)
    }

    /// Whether a letter that was stored has arrived before, or is on its way; then its receipt is
    /// given again, now or as soon as it is known.
    pub(super) fn arrived_before(
        &mut self,
        now: Now,
        letter: LetterId,
        (instance, conn, id): (InstanceId, ConnId, u64),
    ) -> bool {
        let first = || self.seen.get(&letter.instance)?.get(letter.number);
        let known = self.late.letters.get(&letter).or_else(first).cloned();
        match known.map(|known| self.unfolded(known)) {
            Some(SeenLetter::Done(outcomes)) if outcomes.iter().all(|o| o.outcome.is_success()) => {
                self.send_receipt(now, conn, id, &outcomes);
                true
            }
            Some(SeenLetter::Pending(pending)) => {
                let origin = Origin::Peer {
                    instance,
                    conn,
                    id,
                    late: Some(letter),
                };
                self.repoint(pending, origin)
            }
            _ => false,
        }
    }
}
