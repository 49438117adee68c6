//! What waits for a receiver that cannot keep up.

use std::collections::VecDeque;

use crate::Message;

/// Messages that wait for one receiver: the most urgent first, equal ones as they came.
///
/// When it is full, the latest of the least urgent ones is dropped, be it the new one.
#[derive(Clone, Debug)]
pub struct UrgencyQueue {
    /// One queue for each urgency.
    waiting: [VecDeque<Message>; 10],
    capacity: usize,
    dropped: u64,
}

impl Default for UrgencyQueue {
    fn default() -> Self {
        UrgencyQueue::new(64)
    }
}

impl UrgencyQueue {
    /// An empty queue for so many messages.
    pub fn new(capacity: usize) -> UrgencyQueue {
        UrgencyQueue {
            waiting: Default::default(),
            capacity,
            dropped: 0,
        }
    }

    /// Adds a message. Returns the one that had to be dropped for it, or it itself.
    #[must_use = "a dropped message has a sender who may want to know"]
    pub fn push(&mut self, message: Message) -> Option<Message> {
        let urgency = usize::from(message.urgency.unwrap_or(0)).min(self.waiting.len() - 1);
        self.waiting[urgency].push_back(message);
        if self.len() <= self.capacity {
            return None;
        }
        self.dropped += 1;
        self.waiting.iter_mut().find_map(VecDeque::pop_back)
    }

    /// Takes out the one that is next.
    pub fn pop(&mut self) -> Option<Message> {
        self.waiting.iter_mut().rev().find_map(VecDeque::pop_front)
    }

    /// How many wait.
    pub fn len(&self) -> usize {
        self.waiting.iter().map(VecDeque::len).sum()
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many were dropped so far.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}
