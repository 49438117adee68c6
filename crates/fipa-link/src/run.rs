//! Letters and receipts that came one after the other, read without making frames of them.

use bytes::{Buf, Bytes};

use crate::check::{self, Head};
use crate::{Frame, LinkError, Outcome};

/// Whole frames of letters and receipts, in the order in which they came.
#[derive(Debug)]
pub struct Run {
    octets: Bytes,
}

/// One of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// A letter in one part; see [`LetterFrame`](crate::LetterFrame).
    Letter {
        /// Its number.
        id: u64,
        /// Milliseconds within which the sender wants the receipt.
        ttl_millis: u32,
        /// The encoded letter.
        octets: Bytes,
    },
    /// The receipt for the letter with this number: its only receiver has got it.
    Delivered(u64),
    /// Any other receipt.
    Frame(Frame),
}

impl Run {
    pub(crate) fn new(octets: Bytes) -> Run {
        Run { octets }
    }

    /// Takes out the next one. After an error the link cannot go on.
    pub fn next_piece(&mut self) -> Result<Option<Piece>, LinkError> {
        let Some((head, frame)) = Head::read_again(&self.octets) else {
            return Ok(None);
        };
        let body = self.octets.get(head.size..frame).unwrap_or_default();
        check::fits(head.sum, body)?;
        let piece = match head.kind {
            Frame::LETTER => letter(body).map(|(id, ttl_millis, begin)| Piece::Letter {
                id,
                ttl_millis,
                octets: self.octets.slice(head.size + begin..frame),
            }),
            _ => delivered(body).map(Piece::Delivered),
        };
        let piece = match piece {
            Some(piece) => piece,
            None => {
                let body = self.octets.slice(head.size..frame);
                Piece::Frame(Frame::decode(head.kind, body)?)
            }
        };
        self.octets.advance(frame);
        Ok(Some(piece))
    }
}

/// The number and the time of a letter, and where it begins.
fn letter(body: &[u8]) -> Option<(u64, u32, usize)> {
    let (id, rest) = body.split_first_chunk()?;
    let (ttl_millis, rest) = rest.split_first_chunk()?;
    let begin = body.len() - rest.len();
    Some((
        u64::from_be_bytes(*id),
        u32::from_be_bytes(*ttl_millis),
        begin,
    ))
}

/// The number in a receipt which says that the letter was delivered to the one receiver that it
/// has, and nothing more.
fn delivered(body: &[u8]) -> Option<u64> {
    let (id, rest) = body.split_first_chunk()?;
    let (count, rest) = rest.split_first_chunk()?;
    let rest = behind_text(rest)?;
    let (outcome, rest) = rest.split_first()?;
    let rest = behind_text(rest)?;
    let (reason, _) = rest.split_first_chunk()?;
    let is = [u32::from_be_bytes(*count), u32::from_be_bytes(*reason)] == [1, 0];
    (is && *outcome == Outcome::Delivered as u8).then_some(u64::from_be_bytes(*id))
}

/// What follows a text.
fn behind_text(octets: &[u8]) -> Option<&[u8]> {
    let (length, rest) = octets.split_first_chunk()?;
    let length = u32::from_be_bytes(*length) as usize;
    let (text, rest) = rest.split_at_checked(length)?;
    std::str::from_utf8(text).ok().map(|_| rest)
}
