//! Letters that wait for one peer: whose turn is next.
//!
//! The most urgent go first. Among equally urgent ones each sender has its turn, measured in octets
//! (start-time fair queueing: Goyal, Vin, Cheng 1996), so that whoever floods delays itself. The
//! letters of one sender keep their order. A sender may take as much room as is left free (dynamic
//! thresholds: Choudhury, Hahne 1998): however many flood, there is room for one more.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap, VecDeque};

use fipa_acl::Text;

use crate::Urgency;

/// What a letter costs its sender beside its octets.
const LETTER: u64 = 256;

/// Letters that wait for one peer.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    /// Those that were sent before, by their numbers.
    again: BTreeMap<u64, (Text, usize)>,
    senders: HashMap<Text, Share, foldhash::quality::RandomState>,
    /// The first letter of each sender and urgency.
    first: BTreeMap<Turn, Text>,
    letters: usize,
    octets: usize,
    /// How far each urgency has got.
    now: [u64; Urgency::COUNT],
    next: u64,
}

/// Urgency, fairness and the order of coming decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Turn {
    urgency: Reverse<Urgency>,
    start: u64,
    number: u64,
}

#[derive(Clone, Copy, Debug)]
struct Letter {
    id: u64,
    turn: Turn,
    octets: usize,
}

/// What waits from one sender.
#[derive(Debug, Default)]
struct Share {
    letters: usize,
    octets: usize,
    /// By urgency; each in its order.
    queues: [VecDeque<Letter>; Urgency::COUNT],
    /// When its next letter of each urgency has its turn.
    next: [u64; Urgency::COUNT],
}

impl Waiting {
    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.letters == 0
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
        let free = max_letters.saturating_sub(self.letters);
        let free_octets = max_octets.saturating_sub(self.octets);
        let share = self.senders.get(sender);
        let (letters, held) = share.map_or((0, 0), |share| (share.letters, share.octets));
        self.is_empty() || letters < free && held + octets <= free_octets
    }

    /// Puts a letter behind those of its sender.
    pub(super) fn push(&mut self, urgency: Urgency, sender: &Text, id: u64, octets: usize) {
        let class = urgency.number();
        let now = self.now.get(class).copied().unwrap_or_default();
        let number = self.next;
        let share = self.share(sender, octets);
        let (Some(queue), Some(next)) = (share.queues.get_mut(class), share.next.get_mut(class))
        else {
            return;
        };
        let start = (*next).max(now);
        *next = start + LETTER + octets as u64;
        let turn = Turn {
            urgency: Reverse(urgency),
            start,
            number,
        };
        queue.push_back(Letter { id, turn, octets });
        if queue.len() == 1 {
            self.first.insert(turn, sender.detached());
        }
        self.next += 1;
    }

    /// Puts a letter in front that was sent before; those with smaller numbers first.
    pub(super) fn push_again(&mut self, sender: &Text, id: u64, octets: usize) {
        self.share(sender, octets);
        self.again.insert(id, (sender.detached(), octets));
    }

    /// The share of a sender, which becomes larger by a letter.
    fn share(&mut self, sender: &Text, octets: usize) -> &mut Share {
        self.letters += 1;
        self.octets += octets;
        if !self.senders.contains_key(sender) {
            self.senders.insert(sender.detached(), Share::default());
        }
        let share = self.senders.entry(sender.clone()).or_default();
        share.letters += 1;
        share.octets += octets;
        share
    }

    /// The letter whose turn it is.
    pub(super) fn first(&self) -> Option<u64> {
        if let Some((id, _)) = self.again.first_key_value() {
            return Some(*id);
        }
        let (turn, sender) = self.first.first_key_value()?;
        let queue = self
            .senders
            .get(sender)?
            .queues
            .get(turn.urgency.0.number());
        queue?.front().map(|letter| letter.id)
    }

    /// Takes out the letter whose turn it is.
    pub(super) fn pop(&mut self) -> Option<u64> {
        if let Some((id, (sender, octets))) = self.again.pop_first() {
            self.took(&sender, octets);
            return Some(id);
        }
        let (turn, sender) = self.first.pop_first()?;
        let class = turn.urgency.0.number();
        if let Some(now) = self.now.get_mut(class) {
            *now = turn.start.max(*now);
        }
        let queue = self.senders.get_mut(&sender)?.queues.get_mut(class)?;
        let letter = queue.pop_front()?;
        let next = queue.front().map(|next| next.turn);
        self.took(&sender, letter.octets);
        if let Some(next) = next {
            self.first.insert(next, sender);
        }
        Some(letter.id)
    }

    /// Takes out a letter that is not to be sent any more.
    pub(super) fn remove(&mut self, urgency: Urgency, sender: &Text, id: u64) {
        if let Some((sender, octets)) = self.again.remove(&id) {
            return self.took(&sender, octets);
        }
        let share = self.senders.get_mut(sender);
        let queue = share.and_then(|share| share.queues.get_mut(urgency.number()));
        let Some(queue) = queue else {
            return;
        };
        let Some(at) = queue.iter().position(|letter| letter.id == id) else {
            return;
        };
        let Some(letter) = queue.remove(at) else {
            return;
        };
        let first = queue.front().map(|next| next.turn);
        if let Some(sender) = self.first.remove(&letter.turn)
            && let Some(first) = first
        {
            self.first.insert(first, sender);
        }
        self.took(sender, letter.octets);
    }

    /// The share of a sender becomes smaller by a letter.
    fn took(&mut self, sender: &Text, octets: usize) {
        self.letters -= 1;
        self.octets -= octets;
        if let Some(share) = self.senders.get_mut(sender) {
            share.letters -= 1;
            share.octets -= octets;
            if share.letters == 0 {
                self.senders.remove(sender);
            }
        }
    }

    /// Takes all out, in the order of their turns.
    pub(super) fn take_all(&mut self) -> Vec<u64> {
        let mut waiting = std::mem::take(self);
        std::iter::from_fn(|| waiting.pop()).collect()
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
        (0..4).for_each(|id| waiting.push(urgency(0), &"flood".into(), id, 100));
        (10..12).for_each(|id| waiting.push(urgency(0), &"calm".into(), id, 100));
        assert_eq!(order(&mut waiting), [0, 10, 1, 11, 2, 3]);
    }

    #[test]
    fn large_letters_cost_turns() {
        let mut waiting = Waiting::default();
        (0..2).for_each(|id| waiting.push(urgency(0), &"large".into(), id, 1024));
        (10..14).for_each(|id| waiting.push(urgency(0), &"small".into(), id, 0));
        assert_eq!(order(&mut waiting), [0, 10, 11, 12, 13, 1]);
    }

    #[test]
    fn urgent_letters_pass_and_those_sent_before_go_first() {
        let mut waiting = Waiting::default();
        waiting.push(urgency(0), &"a".into(), 5, 1);
        waiting.push(urgency(1), &"a".into(), 6, 1);
        waiting.push(urgency(2), &"b".into(), 7, 1);
        waiting.push(urgency(2), &"b".into(), 8, 1);
        waiting.push_again(&"c".into(), 2, 1);
        waiting.push_again(&"a".into(), 1, 1);
        assert_eq!(order(&mut waiting), [1, 2, 7, 8, 6, 5]);
    }

    #[test]
    fn who_floods_leaves_room_for_others() {
        let mut waiting = Waiting::default();
        let mut fill = |name: &str, octets: usize| {
            let sender = Text::from(name);
            let mut taken = 0;
            while waiting.has_room(&sender, octets, 12, 1000) {
                waiting.push(urgency(0), &sender, waiting.next + 1, octets);
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
        waiting.push(urgency(0), &"a".into(), 1, 5000);
        assert!(!waiting.has_room(&"b".into(), 1, 10, 1000));
        waiting.remove(urgency(0), &"a".into(), 1);
        assert!(waiting.is_empty() && waiting.senders.is_empty());
        assert!(waiting.has_room(&"b".into(), 1, 10, 1000));
    }
}
