//! Checksums of frames: what was changed on its way is not taken for what was said.
//!
//! The checksum of TCP has 16 bits, and is made anew by whatever stands between.

use bytes::BytesMut;
use crc32fast::Hasher;

use crate::{LinkError, Parts};

/// Octets of the length and the kind.
const PLAIN: usize = 5;

/// Octets of the head of a frame with checksums: one of the body, and one of the head before it.
const CHECKED: usize = PLAIN + 8;

/// The bit in the kind that says that checksums follow.
const MARK: u8 = 0x80;

/// The head of a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Head {
    pub(crate) kind: u8,
    /// Octets of the head.
    pub(crate) size: usize,
    /// What the frame says its length is: all behind the length itself.
    pub(crate) length: usize,
    /// The checksum of the body, if there is one.
    pub(crate) sum: Option<u32>,
}

impl Head {
    /// The head at the beginning of what was received, once it is whole.
    pub(crate) fn read(received: &[u8]) -> Result<Option<Head>, LinkError> {
        let Some((&[l0, l1, l2, l3, kind], more)) = received.split_first_chunk::<PLAIN>() else {
            return Ok(None);
        };
        let length = u32::from_be_bytes([l0, l1, l2, l3]) as usize;
        if kind & MARK == 0 {
            return Ok(Some(Head {
                kind,
                size: PLAIN,
                length,
                sum: None,
            }));
        }
        let Some((sum, rest)) = more.split_first_chunk::<4>() else {
            return Ok(None);
        };
        let Some(own) = rest.first_chunk::<4>() else {
            return Ok(None);
        };
        let summed = received.get(..CHECKED - 4).unwrap_or_default();
        if crc32fast::hash(summed) != u32::from_be_bytes(*own) {
            return Err(LinkError::Corrupt);
        }
        Ok(Some(Head {
            kind: kind & !MARK,
            size: CHECKED,
            length,
            sum: Some(u32::from_be_bytes(*sum)),
        }))
    }

    /// The head at the beginning of a frame that was found whole before, and the octets of both.
    pub(crate) fn read_again(octets: &[u8]) -> Option<(Head, usize)> {
        let (&[l0, l1, l2, l3, kind], more) = octets.split_first_chunk::<PLAIN>()?;
        let sum = match kind & MARK {
            0 => None,
            _ => Some(u32::from_be_bytes(*more.first_chunk()?)),
        };
        let head = Head {
            kind: kind & !MARK,
            size: if sum.is_some() { CHECKED } else { PLAIN },
            length: u32::from_be_bytes([l0, l1, l2, l3]) as usize,
            sum,
        };
        let frame = head.frame()?;
        Some((head, frame))
    }

    /// Octets of the frame with its head; `None`: the length is none that a frame has.
    pub(crate) fn frame(&self) -> Option<usize> {
        (self.length + 4 >= self.size).then_some(self.length + 4)
    }
}

/// Whether a body has this sum, if there is one.
pub(crate) fn fits(sum: Option<u32>, body: &[u8]) -> Result<(), LinkError> {
    let fits = sum.is_none_or(|sum| crc32fast::hash(body) == sum);
    fits.then_some(()).ok_or(LinkError::Corrupt)
}

/// The sum of a body as it arrives, and what it is to be.
#[derive(Clone, Debug)]
pub(crate) struct Check(Option<(Hasher, u32)>);

impl Check {
    pub(crate) fn new(sum: Option<u32>) -> Check {
        Check(sum.map(|sum| (Hasher::new(), sum)))
    }

    pub(crate) fn add(&mut self, octets: &[u8]) {
        if let Some((hasher, _)) = &mut self.0 {
            hasher.update(octets);
        }
    }

    pub(crate) fn finish(self) -> Result<(), LinkError> {
        let fits = self.0.is_none_or(|(hasher, sum)| hasher.finalize() == sum);
        fits.then_some(()).ok_or(LinkError::Corrupt)
    }
}

/// Leaves room for the head of a frame of a kind at the end of a buffer; where its body begins.
pub(crate) fn begin(out: &mut BytesMut, kind: u8, checked: bool) -> usize {
    let size = if checked { CHECKED } else { PLAIN };
    let begin = out.len();
    out.resize(begin + size, 0);
    if let Some(at) = out.get_mut(begin + 4) {
        *at = if checked { kind | MARK } else { kind };
    }
    begin + size
}

/// Writes the head of a frame whose body follows: the rest of the buffer, and further parts.
pub(crate) fn finish(out: &mut BytesMut, body: usize, checked: bool, parts: &Parts) {
    let size = if checked { CHECKED } else { PLAIN };
    let Some((head, beginning)) = out.split_at_mut_checked(body) else {
        return;
    };
    let Some(head) = head
        .len()
        .checked_sub(size)
        .and_then(|at| head.get_mut(at..))
    else {
        return;
    };
    let octets = size - 4 + beginning.len() + parts.octets();
    let length = u32::try_from(octets).unwrap_or(u32::MAX).to_be_bytes();
    head[..4].copy_from_slice(&length);
    if checked {
        let mut hasher = Hasher::new();
        hasher.update(beginning);
        parts.iter().for_each(|part| hasher.update(part));
        head[PLAIN..PLAIN + 4].copy_from_slice(&hasher.finalize().to_be_bytes());
        let own = crc32fast::hash(&head[..CHECKED - 4]);
        head[CHECKED - 4..].copy_from_slice(&own.to_be_bytes());
    }
}
