use std::io::IoSlice;

use bytes::{Buf, BufMut, Bytes, BytesMut};

/// Contents from this size on are passed on by reference.
const SHARED_FROM: usize = 4096;

/// Where encoders write: a buffer that is used again and again, with large contents in between by
/// reference.
///
/// ```
/// use bytes::{Buf, Bytes};
/// use fipa_codec::Output;
///
/// let content = Bytes::from(vec![7; 1 << 20]);
/// let mut output = Output::new();
/// output.put_slice(b"head");
/// output.put_shared(&content);
/// let parts = output.take();
/// assert_eq!(parts.remaining(), 4 + (1 << 20));
/// assert_eq!(parts.parts()[1].as_ptr(), content.as_ptr());
/// ```
#[derive(Debug, Default)]
pub struct Output {
    /// What is complete, in order.
    parts: Vec<Bytes>,
    /// Octets in `parts`.
    octets: usize,
    /// What is being written behind them.
    buffer: BytesMut,
}

/// A place in an [`Output`], to go back to.
#[derive(Clone, Copy, Debug)]
struct Mark {
    parts: usize,
    octets: usize,
    buffer: usize,
}

impl Output {
    /// An output without octets.
    pub fn new() -> Output {
        Output::default()
    }

    /// Octets that were written.
    pub fn len(&self) -> usize {
        self.octets + self.buffer.len()
    }

    /// Whether nothing was written.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Makes room for so many octets that are written, not shared.
    pub fn reserve(&mut self, octets: usize) {
        self.buffer.reserve(octets);
    }

    /// Writes an octet.
    #[inline]
    pub fn put_u8(&mut self, octet: u8) {
        self.buffer.put_u8(octet);
    }

    /// Writes octets.
    #[inline]
    pub fn put_slice(&mut self, octets: &[u8]) {
        self.buffer.extend_from_slice(octets);
    }

    /// Writes octets, by reference if they are many.
    pub fn put_shared(&mut self, octets: &Bytes) {
        if octets.len() < SHARED_FROM {
            self.put_slice(octets);
            return;
        }
        self.complete();
        self.octets += octets.len();
        self.parts.push(octets.clone());
    }

    /// What was written, as parts; the buffer is kept for what is written next.
    pub fn take(&mut self) -> Parts {
        self.octets = 0;
        let pieces = if self.parts.is_empty() {
            Pieces::One(self.buffer.split().freeze())
        } else {
            self.complete();
            self.octets = 0;
            Pieces::Many(std::mem::take(&mut self.parts))
        };
        Parts { pieces, at: 0 }
    }

    /// What was written, in one piece; large contents are copied into it.
    pub fn take_bytes(&mut self) -> Bytes {
        let mut parts = self.take();
        parts.copy_to_bytes(parts.remaining())
    }

    /// What is being written, for what is small and not shared.
    #[inline]
    pub(crate) fn buffer(&mut self) -> &mut BytesMut {
        &mut self.buffer
    }

    /// Lets `write` write; what it wrote before it failed is forgotten.
    pub(crate) fn all_or_nothing<E>(
        &mut self,
        write: impl FnOnce(&mut Output) -> Result<(), E>,
    ) -> Result<(), E> {
        let mark = self.mark();
        let written = write(self);
        if written.is_err() {
            self.go_back(mark);
        }
        written
    }

    fn mark(&self) -> Mark {
        Mark {
            parts: self.parts.len(),
            octets: self.octets,
            buffer: self.buffer.len(),
        }
    }

    /// Forgets what was written since a mark.
    fn go_back(&mut self, mark: Mark) {
        if self.parts.len() > mark.parts {
            // What stood in the buffer at the mark begins the part that was completed next.
            let first = self.parts.drain(mark.parts..).next().unwrap_or_default();
            self.buffer.clear();
            self.buffer
                .extend_from_slice(&first[..mark.buffer.min(first.len())]);
        } else {
            self.buffer.truncate(mark.buffer);
        }
        self.octets = mark.octets;
    }

    fn complete(&mut self) {
        if !self.buffer.is_empty() {
            self.octets += self.buffer.len();
            self.parts.push(self.buffer.split().freeze());
        }
    }
}

/// Encoded octets as parts that follow each other, for a vectored write.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    pieces: Pieces,
    /// Pieces that are used up.
    at: usize,
}

/// Nearly always it is one, which needs no vector.
#[derive(Clone, Debug)]
enum Pieces {
    One(Bytes),
    Many(Vec<Bytes>),
}

impl Default for Pieces {
    fn default() -> Pieces {
        Pieces::Many(Vec::new())
    }
}

impl Parts {
    /// The parts that are left.
    pub fn parts(&self) -> &[Bytes] {
        let pieces = match &self.pieces {
            Pieces::One(piece) if piece.is_empty() => &[],
            Pieces::One(piece) => std::slice::from_ref(piece),
            Pieces::Many(pieces) => pieces.as_slice(),
        };
        pieces.get(self.at..).unwrap_or_default()
    }

    /// The parts that are left.
    pub fn into_parts(self) -> Vec<Bytes> {
        match self.pieces {
            Pieces::One(piece) if piece.is_empty() || self.at > 0 => Vec::new(),
            Pieces::One(piece) => vec![piece],
            Pieces::Many(mut pieces) => {
                pieces.drain(..self.at);
                pieces
            }
        }
    }

    /// The first part that is left.
    fn first_mut(&mut self) -> Option<&mut Bytes> {
        let pieces = match &mut self.pieces {
            Pieces::One(piece) if piece.is_empty() => &mut [],
            Pieces::One(piece) => std::slice::from_mut(piece),
            Pieces::Many(pieces) => pieces.as_mut_slice(),
        };
        pieces.get_mut(self.at)
    }
}

impl Buf for Parts {
    fn remaining(&self) -> usize {
        self.parts().iter().map(Bytes::len).sum()
    }

    fn chunk(&self) -> &[u8] {
        self.parts().first().map_or(&[], |part| part)
    }

    fn chunks_vectored<'a>(&'a self, slices: &mut [IoSlice<'a>]) -> usize {
        let filled = slices.iter_mut().zip(self.parts());
        filled
            .map(|(slice, part)| *slice = IoSlice::new(part))
            .count()
    }

    fn advance(&mut self, mut count: usize) {
        while let Some(part) = self.first_mut() {
            if count < part.len() {
                part.advance(count);
                return;
            }
            count -= part.len();
            self.at += 1;
        }
    }

    fn copy_to_bytes(&mut self, count: usize) -> Bytes {
        if let Some(part) = self.first_mut()
            && part.len() >= count
        {
            let octets = part.split_to(count);
            if part.is_empty() {
                self.at += 1;
            }
            return octets;
        }
        let mut octets = BytesMut::with_capacity(count);
        octets.put(self.take(count));
        octets.freeze()
    }
}
