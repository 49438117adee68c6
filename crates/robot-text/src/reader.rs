//! Messages out of a stream of octets.

use std::collections::VecDeque;
use std::mem;

use crate::Message;
use crate::message::MAX_OCTETS;
use crate::parse::{Fault, parse};

/// Something that began like a message and cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a message cannot be read: {fault}")]
pub struct Unreadable {
    /// What is wrong.
    pub fault: Fault,
    /// Its octets from the opening brace on: to the closing one, as far as they came, or the first
    /// [`MAX_OCTETS`] of one that is too long.
    pub octets: Vec<u8>,
}

/// Reads the messages of a serial line, a TCP stream or a datagram, however they are cut.
///
/// Octets between messages are passed over. What cannot be read is told in its place, and the
/// reading goes on with the next opening brace. Never holds more than [`MAX_OCTETS`] of an
/// unfinished message.
#[derive(Clone, Debug, Default)]
pub struct Reader {
    /// The message that has begun; empty between messages.
    open: Vec<u8>,
    ready: VecDeque<Result<Message, Unreadable>>,
}

impl Reader {
    /// A reader at the beginning of a stream.
    pub fn new() -> Reader {
        Reader::default()
    }

    /// Takes in the octets that came next.
    pub fn push(&mut self, octets: &[u8]) {
        octets.iter().for_each(|octet| self.push_one(*octet));
    }

    /// The stream has ended: what has begun is unfinished.
    pub fn end(&mut self) {
        if !self.open.is_empty() {
            self.give_up(Fault::Unfinished);
        }
    }

    fn push_one(&mut self, octet: u8) {
        match (octet, self.open.len()) {
            (b'{', 0) => self.open.push(octet),
            (b'{', _) => {
                self.give_up(Fault::Unfinished);
                self.open.push(octet);
            }
            (_, 0) => {}
            (_, MAX_OCTETS) => self.give_up(Fault::Length),
            (b'}', _) => {
                self.open.push(octet);
                let octets = mem::take(&mut self.open);
                let read = parse(&octets).map_err(|fault| Unreadable { fault, octets });
                self.ready.push_back(read);
            }
            _ => self.open.push(octet),
        }
    }

    fn give_up(&mut self, fault: Fault) {
        let octets = mem::take(&mut self.open);
        self.ready.push_back(Err(Unreadable { fault, octets }));
    }
}

impl Iterator for Reader {
    type Item = Result<Message, Unreadable>;

    /// The next message that is whole, or what stood in its place; `None` until more is pushed.
    fn next(&mut self) -> Option<Self::Item> {
        self.ready.pop_front()
    }
}
