//! Letters that are too large to wait for in one piece.

use bytes::{Buf, BytesMut};

use crate::check::{Check, Head};
use crate::{Frame, LetterFrame, LinkError, Parts};

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
    check: Check,
}

impl Incoming {
    /// Takes the beginning of a letter's frame, of which not all of its so many octets are there.
    pub(crate) fn begin(head: &Head, frame: usize, received: &mut BytesMut) -> Option<Incoming> {
        if received.len() < PIECE {
            return None;
        }
        let missing = frame - received.len();
        received.advance(head.size);
        let mut check = Check::new(head.sum);
        check.add(received);
        let (id, ttl_millis) = (received.get_u64(), received.get_u32());
        Some(Incoming {
            id,
            ttl_millis,
            parts: received.split().freeze().into(),
            missing,
            check,
        })
    }

    /// Takes the next piece. Whether it was the last.
    pub(crate) fn take(&mut self, received: &mut BytesMut) -> bool {
        let octets = self.missing.min(received.len());
        if octets == self.missing || octets >= PIECE {
            self.missing -= octets;
            let piece = received.split_to(octets).freeze();
            self.check.add(&piece);
            self.parts.push(piece);
        }
        self.missing == 0
    }

    /// The letter, once it is whole.
    pub(crate) fn finish(self) -> Result<Frame, LinkError> {
        self.check.finish()?;
        Ok(Frame::Letter(LetterFrame {
            id: self.id,
            ttl_millis: self.ttl_millis,
            parts: self.parts,
        }))
    }
}
