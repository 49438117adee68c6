//! Notices of failure to senders behind other services: the only way to tell who is given no
//! receipt.
//!
//! A notice goes where its letter came from: to the addresses in the envelope's `from`, else to
//! where the directory knows the sender, in the representation and dialect of the letter. It is a
//! letter like any other but for one thing: nobody is told when it fails, except the log.

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Message, Representation, Slots, Text};
use fipa_codec::{
    Dialect, Output as Encoded, bit_efficient, decode_payload, encode_message_as, payload_encoding,
    payload_representation,
};
use fipa_directory::Now;
use fipa_link::{Outcome, ReceiverOutcome};
use smallvec::smallvec;

use super::Mts;
use super::callers::TIMEOUT;
use super::deliveries::Origin;
use super::fleet::is_ruled_out;
use super::patterns::Names;
use super::routing::{Inbound, LOOP, Terms};
use crate::failure;
use crate::pieces::joined;

/// Notices about one letter, at most: a letter that names more receivers is no letter to people who
/// want to know.
const MAX_NOTICES: usize = 256;

/// A letter as it came, for as long as its sender may have to be told that it failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Returnable {
    envelope: Envelope,
    payload: Bytes,
    dialect: Dialect,
}

impl Returnable {
    /// A letter that came, written in this dialect.
    pub(super) fn new(inbound: &Inbound, dialect: Dialect) -> Returnable {
        Returnable {
            envelope: inbound.envelope.clone(),
            payload: joined(&inbound.parts, inbound.payload),
            dialect,
        }
    }

    /// A letter out of the store, which does not tell how it came.
    pub(super) fn stored(envelope: Envelope, payload: Bytes) -> Returnable {
        Returnable {
            envelope,
            payload,
            dialect: Dialect::Standard,
        }
    }
}

impl Mts {
    /// Tells the sender of a letter of each receiver that it did not get to: one notice each. Not
    /// where it travelled in circles or is stored, nor where a notice is not wanted. One notice in all
    /// of those that its sender may not send to: they would be a stranger's way to have much written
    /// to whomever it names as the sender.
    pub(super) fn return_letter(
        &mut self,
        now: Now,
        letter: &Returnable,
        outcomes: &[ReceiverOutcome],
    ) {
        self.return_letter_of(now, letter, outcomes, None);
    }

    /// The same for a stored letter, which waits until its notice has its outcome. Whether there is
    /// a notice.
    pub(super) fn return_letter_of(
        &mut self,
        now: Now,
        letter: &Returnable,
        outcomes: &[ReceiverOutcome],
        stored: Option<u64>,
    ) -> bool {
        let ruled_out = outcomes.iter().position(is_ruled_out);
        let failed: Vec<(Text, Text)> = outcomes
            .iter()
            .enumerate()
            .filter(|(at, told)| ruled_out == Some(*at) || !is_ruled_out(told))
            .map(|(_, told)| told)
            .filter(|told| !told.outcome.is_success() && !told.reason.starts_with(LOOP))
            .filter(|told| !Mts::is_stored(told))
            .flat_map(|told| failures(&letter.envelope, told))
            .take(MAX_NOTICES)
            .collect();
        let Some(sender) = letter.envelope.from().filter(|_| !failed.is_empty()) else {
            return false;
        };
        let message = decode_payload(&letter.envelope, &letter.payload, &self.config.limits);
        let message = match message {
            Ok(message) if failure::is_wanted(&message) => message,
            Ok(_) => return false,
            Err(error) => {
                let reason =
                    format!("its sender is not told, as its payload is unreadable: {error}");
                self.notice_lost(sender, letter.payload.len(), &reason);
                return false;
            }
        };
        let service = self.teller(letter.dialect);
        for (receiver, why) in failed {
            let told = failure::notice(&service, sender, &message, &receiver, &why);
            self.send_notice(now, letter, (sender, stored), &told);
        }
        true
    }

    /// Who tells: the AMS, in whose name services speak (SC00067F section 4); to links and
    /// `fipa_services` the service itself, as that does.
    fn teller(&self, dialect: Dialect) -> Text {
        match dialect {
            Dialect::Jade => Text::from(format!("ams@{}", self.config.name)),
            Dialect::Standard | Dialect::Cpp | Dialect::JadeBridge => self.config.name.clone(),
        }
    }

    fn send_notice(
        &mut self,
        now: Now,
        letter: &Returnable,
        (to, stored): (&AgentId, Option<u64>),
        notice: &Message,
    ) {
        let given = payload_representation(&letter.envelope, &letter.payload);
        let representation = given.unwrap_or(Representation::String);
        match self.notice_letter(now, letter.dialect, representation, to, notice) {
            Ok(inbound) => {
                let origin = Origin::Notice {
                    to: to.name.clone(),
                    stored,
                };
                self.take_in(now, origin, inbound, Terms::patient_within(TIMEOUT));
            }
            Err(reason) => {
                self.notice_lost(to, 0, &reason);
                if let Some(key) = stored {
                    self.dropped_told(now, key, true);
                }
            }
        }
    }

    fn notice_letter(
        &self,
        now: Now,
        dialect: Dialect,
        representation: Representation,
        to: &AgentId,
        notice: &Message,
    ) -> Result<Inbound, String> {
        let mut payload = Encoded::new();
        encode_message_as(dialect, &representation, notice, &mut payload)
            .map_err(|error| error.to_string())?;
        let payload = payload.take_bytes();
        let to = self.known_as(to);
        let envelope = Envelope::new(Slots {
            to: vec![to.clone()],
            from: notice.sender.clone(),
            payload_encoding: payload_encoding(&representation, &payload, None),
            acl_representation: Some(representation),
            payload_length: Some(payload.len() as u64),
            date: Some(FipaTime::from_unix_millis(now.unix_millis)),
            intended_receiver: vec![to],
            ..Slots::default()
        });
        let mut head = Encoded::new();
        bit_efficient::encode_envelope(&envelope, &mut head).map_err(|e| e.to_string())?;
        let head = head.take_bytes();
        Ok(Inbound {
            payload: head.len(),
            parts: smallvec![head, payload],
            envelope,
            from: None,
            via: None,
            names: Names::Exact,
        })
    }

    /// The sender under the name by which the directory knows it, if it does.
    fn known_as(&self, sender: &AgentId) -> AgentId {
        let known = match self.route_to(&sender.name) {
            Some(_) => None,
            None => self.announced_as(&sender.name),
        };
        AgentId {
            name: known.unwrap_or_else(|| sender.name.clone()),
            ..sender.clone()
        }
    }

    /// What became of a notice. Nobody is told of a failure to tell of a failure.
    pub(super) fn tell_of_notice(
        &mut self,
        now: Now,
        (to, stored): (&Text, Option<u64>),
        outcomes: &[ReceiverOutcome],
    ) {
        let arrives = |told: &ReceiverOutcome| told.outcome.is_success() || Mts::is_stored(told);
        let arrived = outcomes.iter().all(arrives);
        if let Some(key) = stored
            && !self.dropped_told(now, key, arrived)
        {
            return;
        }
        for told in outcomes.iter().filter(|told| !told.outcome.is_success()) {
            let reason = format!("its sender could not be told: {}", told.reason);
            self.notice_lost(&AgentId::new(to.clone()), 0, &reason);
        }
    }

    fn notice_lost(&mut self, from: &AgentId, octets: usize, reason: &str) {
        self.caller_notice(from.name.clone(), octets, reason);
    }
}

/// The receivers that an outcome is about, and why each did not get the letter.
fn failures(envelope: &Envelope, told: &ReceiverOutcome) -> Vec<(Text, Text)> {
    let why = match told.outcome {
        Outcome::Unknown | Outcome::Refused => told.reason.clone(),
        // Somebody may have it all the same.
        outcome => Text::from(format!("{outcome}: {}", told.reason)),
    };
    if !told.to.is_empty() {
        return vec![(told.to.clone(), why)];
    }
    let receivers = envelope.intended_receiver().iter();
    receivers.map(|r| (r.name.clone(), why.clone())).collect()
}
