//! How much of one sender may be under way at once.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Letters of one agent that may be under way at once, if they are small.
const LETTERS: u32 = 1024;

/// Octets for which a letter counts as one more.
const OCTETS: usize = 64 << 10;

/// Room for the letters of one sender: each takes some of it until its outcomes are known. A letter
/// that is larger than all of it takes all.
#[derive(Clone, Debug)]
pub(crate) struct Room(Arc<Semaphore>);

/// The part of it that a letter takes.
pub(crate) type Place = OwnedSemaphorePermit;

impl Default for Room {
    fn default() -> Room {
        Room(Arc::new(Semaphore::new(LETTERS as usize)))
    }
}

impl Room {
    /// Waits for room for so many octets; who came first is first.
    pub(crate) async fn wait(&self, octets: usize) -> Option<Place> {
        let room = Arc::clone(&self.0);
        room.acquire_many_owned(cost(octets)).await.ok()
    }

    /// Room for so many octets, if there is any.
    pub(crate) fn take(&self, octets: usize) -> Option<Place> {
        let room = Arc::clone(&self.0);
        room.try_acquire_many_owned(cost(octets)).ok()
    }
}

fn cost(octets: usize) -> u32 {
    let more = u32::try_from(octets / OCTETS).unwrap_or(u32::MAX);
    more.saturating_add(1).min(LETTERS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn so_many_small_letters_or_octets_have_room_and_one_always_has() {
        let room = Room::default();
        let places: Vec<_> = (0..LETTERS).map_while(|_| room.take(100)).collect();
        assert_eq!(places.len(), LETTERS as usize);
        assert!(room.take(0).is_none());
        drop(places);
        let places: Vec<_> = (0..).map_while(|_: u32| room.take(1 << 20)).collect();
        assert_eq!(places.len(), 60);
        drop(places);
        assert!(room.take(usize::MAX).is_some());
    }
}
