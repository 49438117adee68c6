//! What waits for a receiver that cannot keep up.

use std::collections::VecDeque;

/// How many urgencies there are.
const URGENCIES: usize = 10;

/// What waits for one receiver: the most urgent first, equally urgent as it came.
///
/// When it is full, the latest of the least urgent is dropped, be it the new one.
#[derive(Clone, Debug)]
pub struct UrgencyQueue<T> {
    /// One queue for each urgency.
    waiting: [VecDeque<T>; URGENCIES],
    capacity: usize,
    dropped: u64,
}

impl<T> Default for UrgencyQueue<T> {
    fn default() -> Self {
        UrgencyQueue::new(64)
    }
}

impl<T> UrgencyQueue<T> {
    /// An empty queue for so many.
    pub fn new(capacity: usize) -> UrgencyQueue<T> {
        UrgencyQueue {
            waiting: Default::default(),
            capacity,
            dropped: 0,
        }
    }

    /// Adds what has this urgency; above 9 counts as 9. Returns what had to be dropped for it, or
    /// itself.
    #[must_use = "what is dropped has a sender who may want to know"]
    pub fn push(&mut self, urgency: u8, item: T) -> Option<T> {
        self.waiting[usize::from(urgency).min(URGENCIES - 1)].push_back(item);
        if self.len() <= self.capacity {
            return None;
        }
        self.dropped += 1;
        self.waiting.iter_mut().find_map(VecDeque::pop_back)
    }

    /// Takes out what is next.
    pub fn pop(&mut self) -> Option<T> {
        self.waiting.iter_mut().rev().find_map(VecDeque::pop_front)
    }

    /// How much waits.
    pub fn len(&self) -> usize {
        self.waiting.iter().map(VecDeque::len).sum()
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How much was dropped so far.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}
