//! Letters that are too large to wait for in one piece.

use bytes::{Buf, BytesMut};

use crate::{Frame, LetterFrame, Parts};

/// Octets from which on a piece is taken as it lies. Smaller ones are left where they are until
/// more has come: a piece keeps the whole buffer alive in which it arrived.
const PIECE: usize = 16 << 10;

/// A letter of which the first pieces have been taken.
#[derive(Debug)]
pub(crate) struct Incoming {
    id: u64,
    ttl_millis: u32,
    parts: Parts,
    missing: usize,
}

impl Incoming {
    /// Takes the beginning of a letter's frame, of which not all is there. `length` counts the kind
    /// and the body: more than what was received.
    pub(crate) fn begin(length: usize, received: &mut BytesMut) -> Option<Incoming> {
        if received.len() < PIECE {
            return None;
        }
        received.advance(5);
        let (id, ttl_millis) = (received.get_u64(), received.get_u32());
        let missing = length - 1 - LetterFrame::HEAD - received.len();
        Some(Incoming {
            id,
            ttl_millis,
            parts: received.split().freeze().into(),
            missing,
        })
    }

    /// Takes the next piece. Whether it was the last.
    pub(crate) fn take(&mut self, received: &mut BytesMut) -> bool {
        let octets = self.missing.min(received.len());
        if octets == self.missing || octets >= PIECE {
            self.missing -= octets;
            self.parts.push(received.split_to(octets).freeze());
        }
        self.missing == 0
    }

    /// The letter, once it is whole.
    pub(crate) fn finish(self) -> Frame {
        Frame::Letter(LetterFrame {
            id: self.id,
            ttl_millis: self.ttl_millis,
            parts: self.parts,
        })
    }
}
