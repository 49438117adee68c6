//! Which questions wait for an answer.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use crate::Message;

/// Why a question stays without an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unanswered {
    /// The asked one did not answer in time.
    #[error("it gave no answer in time")]
    Silent,
    /// The asked one is gone.
    #[error("it is gone")]
    Gone,
}

/// Why a question is not passed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    Repeated,
    Full,
}

/// Asker and asked.
type Pair = (String, String);

#[derive(Clone, Debug)]
struct Open {
    question: Message,
    expires: Duration,
}

/// The open questions, of each pair in the order in which they were asked.
#[derive(Clone, Debug)]
pub(super) struct Questions {
    open: BTreeMap<Pair, VecDeque<Open>>,
    count: usize,
    patience: Duration,
    capacity: usize,
    last_reference: u32,
}

impl Questions {
    pub(super) fn new(patience: Duration, capacity: usize) -> Questions {
        Questions {
            open: BTreeMap::new(),
            count: 0,
            patience,
            capacity,
            last_reference: 0,
        }
    }

    pub(super) fn open(&mut self, now: Duration, question: Message) -> Result<(), Refusal> {
        if self.count >= self.capacity {
            return Err(Refusal::Full);
        }
        let reference = question.reference.clone();
        let open = self.open.entry(pair_of(&question)).or_default();
        // Without a reference the order ties answers to questions.
        let repeated = |open: &Open| reference.is_some() && open.question.reference == reference;
        if open.iter().any(repeated) {
            return Err(Refusal::Repeated);
        }
        open.push_back(Open {
            question,
            expires: now + self.patience,
        });
        self.count += 1;
        Ok(())
    }

    /// Closes the question that this answers. Whether there was one.
    pub(super) fn close(&mut self, answer: &Message) -> bool {
        let (asked, asker) = pair_of(answer);
        self.take(&(asker, asked), answer.reference.as_deref())
    }

    pub(super) fn forget(&mut self, asker: &str, asked: &str, reference: &str) {
        self.take(&(asker.to_owned(), asked.to_owned()), Some(reference));
    }

    /// Whether this one waits for an answer.
    pub(super) fn asks(&self, asker: &str) -> bool {
        let from = (asker.to_owned(), String::new());
        let mut behind = self.open.range(from..);
        behind.next().is_some_and(|(pair, _)| pair.0 == asker)
    }

    pub(super) fn free_reference(&mut self, asker: &str, asked: &str) -> String {
        let open = self.open.get(&(asker.to_owned(), asked.to_owned()));
        loop {
            self.last_reference = self.last_reference.wrapping_add(1);
            let reference = self.last_reference.to_string();
            let taken = |open: &Open| open.question.reference.as_deref() == Some(&reference);
            if !open.into_iter().flatten().any(taken) {
                return reference;
            }
        }
    }

    pub(super) fn next_expiry(&self) -> Option<Duration> {
        self.all().map(|open| open.expires).min()
    }

    /// Takes out what was waited for long enough.
    pub(super) fn expire(&mut self, now: Duration) -> Vec<Message> {
        self.take_all(|_, open| open.expires <= now)
    }

    /// Takes out what one that is gone was asked, or asked.
    pub(super) fn abandon(&mut self, name: &str) -> Vec<Message> {
        let gone = self.take_all(|(asker, asked), _| asked == name || asker == name);
        let asked_by_others = |question: &Message| question.origin.as_deref() != Some(name);
        gone.into_iter().filter(asked_by_others).collect()
    }

    fn all(&self) -> impl Iterator<Item = &Open> {
        self.open.values().flatten()
    }

    fn take(&mut self, pair: &Pair, reference: Option<&str>) -> bool {
        let Some(open) = self.open.get_mut(pair) else {
            return false;
        };
        let Some(at) = open
            .iter()
            .position(|open| open.question.reference.as_deref() == reference)
        else {
            return false;
        };
        open.remove(at);
        if open.is_empty() {
            self.open.remove(pair);
        }
        self.count -= 1;
        true
    }

    fn take_all(&mut self, which: impl Fn(&Pair, &Open) -> bool) -> Vec<Message> {
        let mut taken = Vec::new();
        self.open.retain(|pair, open| {
            open.retain(|open| {
                let take = which(pair, open);
                if take {
                    taken.push(open.question.clone());
                }
                !take
            });
            !open.is_empty()
        });
        self.count -= taken.len();
        taken
    }
}

fn pair_of(message: &Message) -> Pair {
    let name = |name: &Option<String>| name.clone().unwrap_or_default();
    (name(&message.origin), name(&message.destination))
}
