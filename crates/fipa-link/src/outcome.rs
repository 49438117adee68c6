use std::fmt;
use std::ops::Deref;

use bytes::{BufMut, Bytes, BytesMut};
use fipa_acl::Text;

use crate::wire::{FrameError, Reader, put_list, put_text};

/// What became of a letter for one receiver, as far as was seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// The receiver's program has it.
    Delivered,
    /// A peer that gives no receipts has it.
    Sent,
    /// Nobody of that name is known.
    Unknown,
    /// Somebody on the way would not take it.
    Refused,
    /// Nobody said what became of it in time.
    Timeout,
    /// It was not sent on: the time by which an answer was wanted had passed.
    Expired,
}

impl Outcome {
    const ALL: [Outcome; 6] = [
        Outcome::Delivered,
        Outcome::Sent,
        Outcome::Unknown,
        Outcome::Refused,
        Outcome::Timeout,
        Outcome::Expired,
    ];

    /// The word that people and programs are shown.
    pub fn as_str(self) -> &'static str {
        match self {
            Outcome::Delivered => "delivered",
            Outcome::Sent => "sent",
            Outcome::Unknown => "unknown",
            Outcome::Refused => "refused",
            Outcome::Timeout => "timeout",
            Outcome::Expired => "expired",
        }
    }

    /// Whether the letter arrived, or was handed on to a peer that gives no receipts.
    pub fn is_success(self) -> bool {
        matches!(self, Outcome::Delivered | Outcome::Sent)
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// The outcome for one receiver that a name or pattern resolved to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReceiverOutcome {
    /// The receiver's name.
    pub to: Text,
    /// What became of its letter.
    pub outcome: Outcome,
    /// The address to which the first message transport service handed it; `None` where it went
    /// nowhere.
    pub via: Option<Text>,
    /// Why it did not arrive; empty when it did.
    pub reason: Text,
}

/// What became of a letter, receiver by receiver. Most have one, which takes no memory of its own.
#[derive(Clone, Debug)]
pub struct Outcomes(Held);

#[derive(Clone, Debug)]
enum Held {
    One([ReceiverOutcome; 1]),
    Many(Vec<ReceiverOutcome>),
}

impl Outcomes {
    /// Adds the outcome for one more receiver.
    pub fn push(&mut self, outcome: ReceiverOutcome) {
        self.0 = match std::mem::take(self).0 {
            Held::One([first]) => Held::Many(vec![first, outcome]),
            Held::Many(none) if none.is_empty() => Held::One([outcome]),
            Held::Many(mut outcomes) => {
                outcomes.push(outcome);
                Held::Many(outcomes)
            }
        };
    }
}

impl Default for Outcomes {
    fn default() -> Outcomes {
        Outcomes(Held::Many(Vec::new()))
    }
}

impl Deref for Outcomes {
    type Target = [ReceiverOutcome];

    fn deref(&self) -> &[ReceiverOutcome] {
        match &self.0 {
            Held::One(one) => one,
            Held::Many(outcomes) => outcomes,
        }
    }
}

impl PartialEq for Outcomes {
    fn eq(&self, other: &Outcomes) -> bool {
        **self == **other
    }
}

impl Eq for Outcomes {}

impl From<ReceiverOutcome> for Outcomes {
    fn from(outcome: ReceiverOutcome) -> Outcomes {
        Outcomes(Held::One([outcome]))
    }
}

impl From<Outcomes> for Vec<ReceiverOutcome> {
    fn from(outcomes: Outcomes) -> Vec<ReceiverOutcome> {
        match outcomes.0 {
            Held::One(one) => Vec::from(one),
            Held::Many(outcomes) => outcomes,
        }
    }
}

impl FromIterator<ReceiverOutcome> for Outcomes {
    fn from_iter<I: IntoIterator<Item = ReceiverOutcome>>(outcomes: I) -> Outcomes {
        let mut all = Outcomes::default();
        outcomes.into_iter().for_each(|outcome| all.push(outcome));
        all
    }
}

/// Outcomes as they stand in receipts: for who gives the same one again and again.
#[derive(Clone, Debug)]
pub struct WrittenOutcomes(pub(crate) Bytes);

impl WrittenOutcomes {
    /// These outcomes.
    pub fn new(outcomes: &[ReceiverOutcome]) -> WrittenOutcomes {
        let mut out = BytesMut::new();
        put_list(&mut out, outcomes, ReceiverOutcome::put);
        WrittenOutcomes(out.freeze())
    }
}

impl ReceiverOutcome {
    pub(crate) fn put(out: &mut BytesMut, item: &ReceiverOutcome) {
        put_text(out, &item.to);
        out.put_u8(item.outcome as u8);
        put_text(out, item.via.as_deref().unwrap_or_default());
        put_text(out, &item.reason);
    }

    pub(crate) fn read(reader: &mut Reader) -> Result<ReceiverOutcome, FrameError> {
        let to = reader.text()?;
        let outcome = *Outcome::ALL
            .get(usize::from(reader.u8()?))
            .ok_or(reader.undefined())?;
        let via = Some(reader.text()?).filter(|via| !via.is_empty());
        let reason = reader.text()?;
        Ok(ReceiverOutcome {
            to,
            outcome,
            via,
            reason,
        })
    }
}
