//! What waits to be written to a link.

use std::collections::VecDeque;

use bytes::{Bytes, BytesMut};

use crate::frame::COPIED;
use crate::{Frame, LetterFrame, Parts, ReceiverOutcome};

/// Octets of the buffer in which frames and small letters are written: of a link at rest, and of one
/// that is at work.
const SMALL: usize = 1 << 10;
const WIDE: usize = 64 << 10;

/// Octets of the buffer for a heartbeat, which is all that most links write most of the time.
const HEARTBEAT: usize = 32;

/// Room that a frame finds; a larger one makes its own.
const FRAME: usize = 256;

/// Parts for which a link at rest keeps room.
const IDLE_PARTS: usize = 32;

/// Frames that wait, in parts that are written one after the other.
#[derive(Debug, Default)]
pub(crate) struct Outgoing {
    parts: VecDeque<Bytes>,
    /// What follows the parts: frames side by side, until a letter comes between.
    tail: BytesMut,
    wide: bool,
    octets: usize,
    /// Whether frames are written with checksums.
    pub(crate) checked: bool,
}

impl Outgoing {
    pub(crate) fn push_octets(&mut self, octets: &[u8]) {
        self.make_room(FRAME);
        self.tail.extend_from_slice(octets);
        self.octets += octets.len();
    }

    pub(crate) fn push(&mut self, frame: Frame) {
        self.make_room(FRAME);
        let before = self.tail.len();
        let letter = frame.encode_as(&mut self.tail, self.checked);
        self.pushed(before, letter);
    }

    /// A letter with something in front of it.
    pub(crate) fn push_letter(&mut self, head: (u64, u32), front: &[u8], letter: &Bytes) {
        let copied = if letter.len() <= COPIED {
            letter.len()
        } else {
            0
        };
        self.make_room(FRAME + front.len() + copied);
        let before = self.tail.len();
        let letter = Frame::encode_letter(head, front, letter, &mut self.tail, self.checked);
        self.pushed(before, letter);
    }

    /// A letter that is copied if it is small: on a stream that is cut into packets every part takes
    /// time in each of them.
    pub(crate) fn push_packed(&mut self, letter: LetterFrame) {
        let octets = letter.parts.octets();
        if octets > COPIED {
            return self.push(Frame::Letter(letter));
        }
        self.make_room(FRAME + octets);
        let before = self.tail.len();
        Frame::encode_copied(&letter, &mut self.tail, self.checked);
        self.pushed(before, Parts::default());
    }

    /// Counts what was written behind those octets, and puts the parts behind it that follow.
    fn pushed(&mut self, before: usize, parts: Parts) {
        self.octets += self.tail.len() - before;
        self.wide |= self.tail.len() > SMALL;
        let octets = parts.octets();
        if octets > 0 {
            self.parts.push_back(self.tail.split().freeze());
            self.parts.extend(parts);
            self.octets += octets;
        }
    }

    /// Pushes a heartbeat. Where nothing else waits, that is a time to keep little memory.
    pub(crate) fn push_heartbeat(&mut self, frame: Frame) {
        if self.octets > 0 {
            return self.push(frame);
        }
        self.tail = BytesMut::with_capacity(HEARTBEAT);
        frame.encode_as(&mut self.tail, self.checked);
        self.octets = self.tail.len();
    }

    pub(crate) fn push_receipt(&mut self, id: u64, outcomes: &[ReceiverOutcome]) {
        self.make_room(FRAME);
        let before = self.tail.len();
        Frame::encode_receipt(id, outcomes, &mut self.tail, self.checked);
        self.octets += self.tail.len() - before;
    }

    pub(crate) fn push_written_receipt(&mut self, id: u64, outcomes: &[u8]) {
        self.make_room(FRAME + outcomes.len());
        let before = self.tail.len();
        Frame::encode_written_receipt(id, outcomes, &mut self.tail, self.checked);
        self.octets += self.tail.len() - before;
    }

    /// The next octets to write.
    pub(crate) fn pop(&mut self) -> Option<Bytes> {
        let part = match self.parts.pop_front() {
            Some(part) => part,
            None if self.tail.is_empty() => {
                self.rest();
                return None;
            }
            None => self.tail.split().freeze(),
        };
        self.octets -= part.len();
        Some(part)
    }

    /// Octets that wait.
    pub(crate) fn octets(&self) -> usize {
        self.octets
    }

    /// A buffer whose parts are all written is used again; else the next one is larger the more
    /// there is to do.
    fn make_room(&mut self, room: usize) {
        if self.tail.try_reclaim(room) {
            return;
        }
        if !self.tail.is_empty() {
            self.parts.push_back(self.tail.split().freeze());
        }
        self.wide = self.octets > SMALL;
        let usual = if self.wide { WIDE } else { SMALL };
        self.tail = BytesMut::with_capacity(usual.max(room));
    }

    /// A link without work keeps next to nothing.
    fn rest(&mut self) {
        if std::mem::take(&mut self.wide) {
            self.tail = BytesMut::new();
        }
        if self.parts.capacity() > IDLE_PARTS {
            self.parts = VecDeque::new();
        }
    }
}
