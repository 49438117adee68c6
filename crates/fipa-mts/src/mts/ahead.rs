//! Letters that are posted behind others for the same receiver before those are answered, where a
//! place says that it takes them so.
//!
//! They leave in their order, and the place reads them in that order. One that comes back waits
//! until it is the first again, and no other is posted behind it before.

use std::collections::HashMap;
use std::sync::Arc;

use fipa_acl::Text;
use fipa_directory::{Address, Now};

use super::Mts;

/// Octets of the largest letter that has others behind or in front of it; what is larger would keep
/// those for other receivers waiting.
pub(super) const MAX_LETTER: usize = 128 << 10;

/// Octets of the letters for one receiver that are not answered.
const MAX_OCTETS: usize = 1 << 20;

/// Places that are remembered.
const MAX_PLACES: usize = 1024;

/// How many letters the places take before they have answered the first one.
#[derive(Debug, Default)]
pub(super) struct Ahead(HashMap<Arc<Address>, usize, foldhash::fast::RandomState>);

impl Ahead {
    /// 1 where each letter waits for the answer to the one in front.
    pub(super) fn at(&self, address: &Address) -> usize {
        self.0.get(address).copied().unwrap_or(1)
    }

    pub(super) fn is_told_by_nobody(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn set(&mut self, address: &Arc<Address>, letters: usize) {
        if letters < 2 {
            self.0.remove(address);
        } else if self.at(address) != letters {
            if self.0.len() >= MAX_PLACES {
                self.0.clear();
            }
            self.0.insert(Arc::clone(address), letters);
        }
    }
}

impl Mts {
    /// Posts letters behind those for this receiver that are on their way, as far as their place
    /// takes them.
    pub(super) fn begin_behind(&mut self, now: Now, name: &Text) {
        while let Some((id, address)) = self.next_behind(name) {
            let foreign = self.deliveries.get(&id).and_then(|d| d.foreign.as_deref());
            let Some(mut attempt) = foreign.map(|foreign| self.attempt(foreign)) else {
                return;
            };
            match attempt.places.front_mut() {
                Some((place, _)) if *place == address => *place = Arc::clone(&address),
                _ => return,
            }
            self.post.attempts.insert(id, attempt);
            if let Err(reason) = self.post_over_http(now, id, &address) {
                self.place_refused(now, id, format!("{address}: {reason}"));
            }
        }
    }

    /// The first letter for this receiver that is not on its way, if all in front of it are on one
    /// connection on which it may follow.
    fn next_behind(&self, name: &str) -> Option<(u64, Arc<Address>)> {
        if self.closing {
            return None;
        }
        let waiting = &self.post.boxes.get(name)?.waiting;
        let first = self.post.attempts.get(waiting.front()?)?;
        let (address, _) = first.places.front()?;
        let ahead = self.post.ahead.at(address);
        if ahead < 2 || self.post.busy.get(address)?.behind >= ahead {
            return None;
        }
        let mut octets = 0;
        for id in waiting.iter().take(ahead) {
            let letter = self.deliveries.get(id)?.octets();
            octets += letter;
            if letter > MAX_LETTER || octets > MAX_OCTETS {
                return None;
            }
            match self.post.attempts.get(id) {
                None => return Some((*id, Arc::clone(address))),
                Some(attempt) if !attempt.in_series => return None,
                Some(attempt) => {
                    let (place, _) = attempt.places.front()?;
                    if place != address {
                        return None;
                    }
                }
            }
        }
        None
    }
}
