//! Letters that wait for one peer: whose turn is next.
//!
//! The most urgent go first. Among equally urgent ones each sender has its turn, measured in octets
//! (start-time fair queueing: Goyal, Vin, Cheng 1996), so that whoever floods delays itself. The
//! letters of one sender keep their order. A sender may take as much room as is left free (dynamic
//! thresholds: Choudhury, Hahne 1998): however many flood, there is room for one more.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};

use fipa_acl::Text;

use super::Numbered;
use crate::Urgency;

/// What a letter costs its sender beside its octets.
const LETTER: u64 = 256;

/// Letters that wait for one peer.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    letters: BTreeMap<Turn, Letter>,
    turns: Numbered<Turn>,
    senders: HashMap<Text, Share>,
    octets: usize,
    /// How far each urgency has got.
    now: [u64; Urgency::COUNT],
    next: u64,
}

/// Letters that were sent before go first; then urgency, fairness and the order of coming decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Turn {
    new: bool,
    urgency: Reverse<Urgency>,
    start: u64,
    number: u64,
}

#[derive(Debug)]
struct Letter {
    id: u64,
    sender: Text,
    octets: usize,
}

/// What waits from one sender.
#[derive(Debug, Default)]
struct Share {
    letters: usize,
    octets: usize,
    /// When its next letter of each urgency has its turn.
    next: [u64; Urgency::COUNT],
}

impl Waiting {
    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.letters.is_empty()
    }

    /// Whether a letter of this sender is taken where so many letters and octets may wait. One
    /// always is where nothing waits.
    pub(super) fn has_room(
        &self,
        sender: &Text,
        octets: usize,
        max_letters: usize,
        max_octets: usize,
    ) -> bool {
        let free = max_letters.saturating_sub(self.letters.len());
        let free_octets = max_octets.saturating_sub(self.octets);
        let share = self.senders.get(sender);
        let (letters, held) = share.map_or((0, 0), |share| (share.letters, share.octets));
        self.is_empty() || letters < free && held + octets <= free_octets
    }

    /// Puts a letter behind those of its sender.
    pub(super) fn push(&mut self, urgency: Urgency, sender: Text, id: u64, octets: usize) {
        let class = urgency.number();
        let (start, next) = {
            let share = self.senders.entry(sender.clone()).or_default();
            let (Some(now), Some(next)) = (self.now.get(class), share.next.get_mut(class)) else {
                return;
            };
            let start = (*next).max(*now);
            *next = start + LETTER + octets as u64;
            (start, self.next)
        };
        self.next += 1;
        let turn = Turn {
            new: true,
            urgency: Reverse(urgency),
            start,
            number: next,
        };
        self.insert(turn, id, sender, octets);
    }

    /// Puts a letter in front that was sent before; those with smaller numbers first.
    pub(super) fn push_again(&mut self, sender: Text, id: u64, octets: usize) {
        let turn = Turn {
            new: false,
            urgency: Reverse(Urgency::default()),
            start: 0,
            number: id,
        };
        self.insert(turn, id, sender, octets);
    }

    fn insert(&mut self, turn: Turn, id: u64, sender: Text, octets: usize) {
        let share = self.senders.entry(sender.clone()).or_default();
        share.letters += 1;
        share.octets += octets;
        self.octets += octets;
        self.turns.insert(id, turn);
        self.letters.insert(turn, Letter { id, sender, octets });
    }

    /// The letter whose turn it is.
    pub(super) fn first(&self) -> Option<u64> {
        self.letters.values().next().map(|letter| letter.id)
    }

    /// Takes out the letter whose turn it is.
    pub(super) fn pop(&mut self) -> Option<u64> {
        let (turn, letter) = self.letters.first_key_value()?;
        let (turn, id) = (*turn, letter.id);
        if let Some(now) = self.now.get_mut(turn.urgency.0.number()) {
            *now = turn.start.max(*now);
        }
        self.remove(id);
        Some(id)
    }

    /// Takes out a letter that is not to be sent any more.
    pub(super) fn remove(&mut self, id: u64) {
        let Some(letter) = self.turns.remove(&id).and_then(|t| self.letters.remove(&t)) else {
            return;
        };
        self.octets -= letter.octets;
        if let Some(share) = self.senders.get_mut(&letter.sender) {
            share.letters -= 1;
            share.octets -= letter.octets;
            if share.letters == 0 {
                self.senders.remove(&letter.sender);
            }
        }
    }

    /// Takes all out, in the order of their turns.
    pub(super) fn take_all(&mut self) -> Vec<u64> {
        let waiting = std::mem::take(self);
        waiting.letters.into_values().map(|l| l.id).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn urgency(number: u8) -> Urgency {
        let text = Text::from(number.to_string());
        Urgency::of(&fipa_acl::Envelope::new(fipa_acl::Slots {
            user_defined: vec![(Text::from("Priority"), text)],
            ..Default::default()
        }))
    }

    fn order(waiting: &mut Waiting) -> Vec<u64> {
        std::iter::from_fn(|| waiting.pop()).collect()
    }

    #[test]
    fn each_sender_has_its_turn_and_keeps_its_order() {
        let mut waiting = Waiting::default();
        (0..4).for_each(|id| waiting.push(urgency(0), "flood".into(), id, 100));
        (10..12).for_each(|id| waiting.push(urgency(0), "calm".into(), id, 100));
        assert_eq!(order(&mut waiting), [0, 10, 1, 11, 2, 3]);
    }

    #[test]
    fn large_letters_cost_turns() {
        let mut waiting = Waiting::default();
        (0..2).for_each(|id| waiting.push(urgency(0), "large".into(), id, 1024));
        (10..14).for_each(|id| waiting.push(urgency(0), "small".into(), id, 0));
        assert_eq!(order(&mut waiting), [0, 10, 11, 12, 13, 1]);
    }

    #[test]
    fn urgent_letters_pass_and_those_sent_before_go_first() {
        let mut waiting = Waiting::default();
        waiting.push(urgency(0), "a".into(), 5, 1);
        waiting.push(urgency(1), "a".into(), 6, 1);
        waiting.push(urgency(2), "b".into(), 7, 1);
        waiting.push(urgency(2), "b".into(), 8, 1);
        waiting.push_again("c".into(), 2, 1);
        waiting.push_again("a".into(), 1, 1);
        assert_eq!(order(&mut waiting), [1, 2, 7, 8, 6, 5]);
    }

    #[test]
    fn who_floods_leaves_room_for_others() {
        let mut waiting = Waiting::default();
        let mut fill = |name: &str, octets: usize| {
            let sender = Text::from(name);
            let mut taken = 0;
            while waiting.has_room(&sender, octets, 12, 1000) {
                waiting.push(urgency(0), sender.clone(), waiting.next + 1, octets);
                taken += 1;
            }
            taken
        };
        assert_eq!(fill("a", 1), 6);
        assert_eq!(fill("b", 1), 3);
        assert_eq!(fill("c", 1), 2);
    }

    #[test]
    fn one_letter_always_fits_and_what_is_removed_makes_room() {
        let mut waiting = Waiting::default();
        assert!(waiting.has_room(&"a".into(), 5000, 10, 1000));
        waiting.push(urgency(0), "a".into(), 1, 5000);
        assert!(!waiting.has_room(&"b".into(), 1, 10, 1000));
        waiting.remove(1);
        assert!(waiting.is_empty() && waiting.senders.is_empty());
        assert!(waiting.has_room(&"b".into(), 1, 10, 1000));
    }
}
