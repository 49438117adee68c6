use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Letter, Text};
use fipa_codec::{Limits, Output as Encoded, bit_efficient};

use crate::Urgency;

/// Octets of a payload that is copied where the letter waits. A larger one fills most of the buffer
/// that it was read into.
const SMALL: usize = 16 << 10;

/// The letters that wait for one agent, bounded in number and octets: the most urgent first,
/// equally urgent ones as they came.
#[derive(Debug)]
pub struct Mailbox {
    letters: [VecDeque<Waiting>; Urgency::COUNT],
    count: usize,
    octets: usize,
    max_letters: usize,
    max_octets: usize,
}

#[derive(Debug)]
struct Waiting {
    letter: Letter,
    /// It has no part in the buffer that it was read into.
    detached: bool,
}

/// How long a letter may wait in the buffer that it came in.
pub(crate) const TIDY: Duration = Duration::from_millis(500);

/// Agents in whose mailboxes letters came since they were tidied last.
#[derive(Debug, Default)]
pub(crate) struct Lately(BTreeSet<Text>);

impl Lately {
    /// Notes an agent. Whether it is the first one.
    pub(crate) fn note(&mut self, name: &Text) -> bool {
        if self.0.contains(name) {
            return false;
        }
        let first = self.0.is_empty();
        self.0.insert(name.detached());
        first
    }

    /// All that were noted.
    pub(crate) fn take(&mut self) -> BTreeSet<Text> {
        std::mem::take(&mut self.0)
    }
}

/// A mailbox does not take the letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the agent's mailbox is full")]
pub struct MailboxFull;

impl Mailbox {
    /// An empty mailbox for so many letters and octets of payload.
    pub fn new(max_letters: usize, max_octets: usize) -> Mailbox {
        Mailbox {
            letters: Default::default(),
            count: 0,
            octets: 0,
            max_letters,
            max_octets,
        }
    }

    /// Puts a letter in. One letter always fits into an empty mailbox.
    pub fn push(&mut self, letter: Letter) -> Result<(), MailboxFull> {
        if !self.has_room_for(letter.payload.len()) {
            return Err(MailboxFull);
        }
        self.count += 1;
        self.octets += letter.payload.len();
        let urgency = Urgency::of(&letter.envelope).number();
        if let Some(letters) = self.letters.get_mut(urgency) {
            letters.push_back(Waiting {
                letter,
                detached: false,
            });
        }
        Ok(())
    }

    /// Whether a letter with so many octets of payload fits in.
    pub(crate) fn has_room_for(&self, octets: usize) -> bool {
        let full = self.count >= self.max_letters || self.octets + octets > self.max_octets;
        !full || self.count == 0
    }

    /// All letters, the oldest of the most urgent first.
    pub fn into_letters(self) -> Vec<Letter> {
        let letters = self.letters.into_iter().rev().flatten();
        letters.map(|waiting| waiting.letter).collect()
    }

    /// Takes the oldest letter of the most urgent out.
    pub fn pop(&mut self) -> Option<Letter> {
        let mut letters = self.letters.iter_mut().rev();
        let Waiting { letter, .. } = letters.find_map(VecDeque::pop_front)?;
        self.count -= 1;
        self.octets -= letter.payload.len();
        Some(letter)
    }

    /// Copies what waits out of the buffers that it was read into, so that a small letter does not
    /// keep a large buffer.
    pub(crate) fn detach(&mut self) {
        for letters in &mut self.letters {
            // Those that came last are the ones that are not copied yet.
            let fresh = letters.iter_mut().rev().take_while(|w| !w.detached);
            for waiting in fresh {
                waiting.detached = true;
                detach(&mut waiting.letter);
            }
        }
    }
}

/// Copies a letter into memory of its own.
fn detach(letter: &mut Letter) {
    if letter.payload.len() > SMALL {
        return;
    }
    let mut head = Encoded::new();
    if bit_efficient::encode_envelope(&letter.envelope, &mut head).is_err() {
        return;
    }
    let head = head.take_bytes();
    let mut whole = BytesMut::with_capacity(head.len() + letter.payload.len());
    whole.extend_from_slice(&head);
    whole.extend_from_slice(&letter.payload);
    let whole: Bytes = whole.freeze();
    if let Ok((envelope, payload)) = bit_efficient::decode_envelope(&whole, &Limits::default())
        && envelope == letter.envelope
    {
        letter.envelope = envelope;
        letter.payload = whole.slice(payload..);
    }
}

#[cfg(test)]
mod tests {
    use fipa_acl::{AgentId, Envelope, FipaTime, Representation, Slots};

    use super::*;

    fn letter(content: &str, priority: Option<&str>) -> Letter {
        let priority = priority.map(|value| (Text::from("priority"), Text::from(value)));
        let envelope = Envelope::new(Slots {
            to: vec![AgentId::new("b")],
            acl_representation: Some(Representation::BitEfficient),
            date: Some(FipaTime::from_unix_millis(0)),
            user_defined: priority.into_iter().collect(),
            ..Slots::default()
        });
        let payload = Bytes::from(content.to_owned());
        Letter { envelope, payload }
    }

    fn contents(mailbox: &mut Mailbox) -> Vec<Bytes> {
        std::iter::from_fn(|| mailbox.pop())
            .map(|letter| letter.payload)
            .collect()
    }

    #[test]
    fn urgent_letters_pass_others_and_each_urgency_keeps_its_order() {
        let mut mailbox = Mailbox::new(10, 1000);
        let given = [
            ("a", None),
            ("b", Some("1")),
            ("c", Some("2")),
            ("d", Some("0")),
            ("e", Some("9")),
            ("f", Some("high")),
            ("g", Some("1")),
        ];
        for (content, priority) in given {
            mailbox.push(letter(content, priority)).unwrap();
        }
        assert_eq!(contents(&mut mailbox), ["c", "e", "b", "g", "a", "d", "f"]);
    }

    #[test]
    fn a_letter_that_waits_is_moved_out_of_the_buffer_that_it_came_in() {
        let buffer = Bytes::from(vec![b'x'; 64 << 10]);
        let mut mailbox = Mailbox::new(10, 1 << 20);
        for payload in [buffer.slice(100..200), buffer.slice(..32 << 10)] {
            let letter = Letter {
                payload,
                ..letter("", Some("0"))
            };
            mailbox.push(letter).unwrap();
        }
        mailbox.detach();
        let (small, large) = (mailbox.pop().unwrap(), mailbox.pop().unwrap());
        assert_eq!(small.payload, buffer.slice(100..200));
        assert_ne!(small.payload.as_ptr(), buffer.slice(100..).as_ptr());
        assert_eq!(small.envelope, letter("", Some("0")).envelope);
        assert_eq!(large.payload.as_ptr(), buffer.as_ptr());
    }
}
