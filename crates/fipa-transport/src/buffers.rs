use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use bytes::BytesMut;

/// Octets of a buffer: the more are read at once, the seldomer others are woken.
pub(crate) const CHUNK: usize = 256 << 10;

/// A buffer with less room than this is full.
pub(crate) const ROOM: usize = 32 << 10;

/// Full buffers that are kept: 64 MiB. Where slices of so many are in use, which may be small ones,
/// further buffers have no more than [`ROOM`].
const KEPT: usize = 256;

/// Full buffers that are looked at when one is wanted.
const TRIES: usize = 4;

/// The buffers that connections read into, one at a time.
///
/// What is read is handed on in slices of such a buffer and never copied. A connection has a
/// buffer only while it reads; the next one reads into what room is left. A buffer that is full
/// comes back as soon as no slice of it is in use any more.
///
/// The length of a buffer is the room that it has left: what was read is split off.
#[derive(Debug, Default)]
pub struct Buffers(Mutex<Pool>);

#[derive(Debug, Default)]
struct Pool {
    open: Vec<BytesMut>,
    /// Slices of these may be in use; those that are full longest come first.
    full: VecDeque<BytesMut>,
}

/// A buffer that was taken.
#[derive(Debug)]
pub(crate) struct Taken {
    pub(crate) octets: BytesMut,
    is_kept: bool,
}

impl Buffers {
    /// A buffer with [`ROOM`] at least.
    pub(crate) fn take(&self) -> Taken {
        let kept = |octets| Taken {
            octets,
            is_kept: true,
        };
        let mut pool = self.lock();
        if let Some(open) = pool.open.pop() {
            return kept(open);
        }
        for _ in 0..TRIES.min(pool.full.len()) {
            let Some(mut buffer) = pool.full.pop_front() else {
                break;
            };
            if buffer.try_reclaim(CHUNK) {
                return kept(buffer);
            }
            pool.full.push_back(buffer);
        }
        let is_kept = pool.full.len() < KEPT;
        drop(pool);
        Taken {
            octets: BytesMut::with_capacity(if is_kept { CHUNK } else { ROOM }),
            is_kept,
        }
    }

    /// Takes a buffer back of which nothing is used but the slices that were split off.
    pub(crate) fn give(&self, taken: Taken) {
        let Taken {
            octets: mut buffer,
            is_kept,
        } = taken;
        if !is_kept {
            return;
        }
        buffer.clear();
        let open = buffer.capacity() >= ROOM || buffer.try_reclaim(CHUNK);
        let mut pool = self.lock();
        if open {
            pool.open.push(buffer);
            return;
        }
        pool.full.push_back(buffer);
        if pool.full.len() > KEPT {
            pool.full.pop_front();
        }
    }

    fn lock(&self) -> MutexGuard<'_, Pool> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads so many octets of this value: all of them are split off.
    fn read(buffers: &Buffers, octets: usize, value: u8) -> bytes::Bytes {
        let mut buffer = buffers.take();
        buffer.octets.resize(octets, value);
        let slice = buffer.octets.split().freeze();
        buffers.give(buffer);
        slice
    }

    #[test]
    fn the_room_that_one_reading_left_is_used_by_the_next() {
        let buffers = Buffers::default();
        let (first, second) = (read(&buffers, 100, 1), read(&buffers, 50, 2));
        assert_eq!(second.as_ptr(), first.as_ptr().wrapping_add(100));
        assert!(first.iter().all(|octet| *octet == 1));
    }

    #[test]
    fn a_full_buffer_comes_back_once_no_slice_is_in_use() {
        let buffers = Buffers::default();
        let first = read(&buffers, CHUNK, 1);
        let place = first.as_ptr();
        let second = read(&buffers, CHUNK, 2);
        assert_ne!(second.as_ptr(), place);
        drop(first);
        assert_eq!(read(&buffers, CHUNK, 3).as_ptr(), place);
        assert!(second.iter().all(|octet| *octet == 2));
    }

    #[test]
    fn where_many_buffers_stay_in_use_further_ones_are_small_and_not_kept() {
        let buffers = Buffers::default();
        let mut held: Vec<_> = (0..KEPT).map(|_| read(&buffers, CHUNK, 1)).collect();
        held.extend((0..KEPT).map(|_| read(&buffers, ROOM, 1)));
        assert_eq!(buffers.lock().full.len(), KEPT);
        assert_eq!(buffers.take().octets.capacity(), ROOM);
        held.clear();
        assert_eq!(buffers.take().octets.capacity(), CHUNK);
    }
}
