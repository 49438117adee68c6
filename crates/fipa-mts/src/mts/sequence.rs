//! What has numbers that are given in their order, and is taken out in nearly the same one: it lies
//! side by side, where a table would scatter it over the memory.

use std::collections::VecDeque;

use super::Numbered;

/// Between two numbers that are given.
const STEP: u64 = 2;

/// Places that are kept for numbers, at most; whatever stays longer than so many others is put away.
const PLACES: usize = 1 << 15;

/// Places without anything that an empty sequence keeps.
const IDLE_PLACES: usize = 1024;

/// Values by their numbers. Of two numbers the greater one is greater by two at least.
#[derive(Debug)]
pub(super) struct Sequence<T> {
    /// Begins at this number, with a place for each [`STEP`].
    begin: u64,
    places: VecDeque<Option<(u64, T)>>,
    put_away: Numbered<T>,
    len: usize,
}

impl<T> Default for Sequence<T> {
    fn default() -> Sequence<T> {
        Sequence {
            begin: 0,
            places: VecDeque::new(),
            put_away: Numbered::default(),
            len: 0,
        }
    }
}

impl<T> Sequence<T> {
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Adds what has a greater number than all before it.
    pub(super) fn push(&mut self, number: u64, value: T) {
        if self.places.is_empty() {
            self.begin = number;
        }
        let place = (number.saturating_sub(self.begin) / STEP) as usize;
        if place >= self.places.len() + PLACES {
            self.put_away(self.places.len());
            self.begin = number;
        } else if place >= PLACES {
            self.put_away(place + 1 - PLACES);
        }
        let place = (number.saturating_sub(self.begin) / STEP) as usize;
        while self.places.len() < place {
            self.places.push_back(None);
        }
        self.places.push_back(Some((number, value)));
        self.len += 1;
    }

    /// Frees the first places.
    fn put_away(&mut self, places: usize) {
        let places = places.min(self.places.len());
        self.begin += places as u64 * STEP;
        let first = self.places.drain(..places).flatten();
        self.put_away.extend(first);
    }

    pub(super) fn contains(&self, number: u64) -> bool {
        self.get(number).is_some()
    }

    pub(super) fn get(&self, number: u64) -> Option<&T> {
        let place = self.place(number).and_then(|at| self.places.get(at));
        match place {
            Some(Some((known, value))) if *known == number => Some(value),
            _ => self.put_away.get(&number),
        }
    }

    pub(super) fn get_mut(&mut self, number: u64) -> Option<&mut T> {
        let place = self.place(number);
        match place.and_then(|at| self.places.get_mut(at)) {
            Some(Some((known, value))) if *known == number => Some(value),
            _ => self.put_away.get_mut(&number),
        }
    }

    /// Takes out a value if it is so.
    pub(super) fn remove_if(&mut self, number: u64, is_so: impl FnOnce(&T) -> bool) -> Option<T> {
        let at = self.place(number);
        let place = at.and_then(|at| self.places.get_mut(at));
        let value = match place {
            Some(place) if place.as_ref().is_some_and(|(known, _)| *known == number) => place
                .take_if(|(_, value)| is_so(value))
                .map(|(_, value)| value),
            _ => match self.put_away.get(&number) {
                Some(value) if is_so(value) => self.put_away.remove(&number),
                _ => None,
            },
        }?;
        self.len -= 1;
        while let Some(None) = self.places.front() {
            self.places.pop_front();
            self.begin += STEP;
        }
        if self.places.is_empty() && self.places.capacity() > IDLE_PLACES {
            self.places = VecDeque::new();
        }
        Some(value)
    }

    pub(super) fn remove(&mut self, number: u64) -> Option<T> {
        self.remove_if(number, |_| true)
    }

    /// All, in no order.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u64, &T)> {
        let places = self.places.iter().flatten();
        let away = self.put_away.iter().map(|(number, value)| (*number, value));
        places.map(|(number, value)| (*number, value)).chain(away)
    }

    fn place(&self, number: u64) -> Option<usize> {
        Some((number.checked_sub(self.begin)? / STEP) as usize)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    #[derive(Clone, Debug)]
    enum Act {
        Push(u64),
        Remove(usize),
    }

    fn acts() -> impl Strategy<Value = Vec<Act>> {
        let far = PLACES as u64 * STEP;
        let step = prop_oneof![9 => 2_u64..6, 1 => far - 3..far + 3, 1 => 3 * far..4 * far];
        let act =
            prop_oneof![3 => step.prop_map(Act::Push), 2 => (0_usize..8).prop_map(Act::Remove)];
        proptest::collection::vec(act, 0..60)
    }

    proptest! {
        #[test]
        fn whatever_is_put_in_is_found_until_it_is_taken_out(acts in acts()) {
            let (mut sequence, mut known) = (Sequence::default(), BTreeMap::new());
            let mut number = 7;
            for act in acts {
                match act {
                    Act::Push(step) => {
                        number += step;
                        sequence.push(number, number + 1);
                        known.insert(number, number + 1);
                    }
                    Act::Remove(nth) => {
                        let Some(number) = known.keys().copied().nth(nth) else {
                            continue;
                        };
                        prop_assert_eq!(sequence.remove_if(number, |_| false), None);
                        prop_assert_eq!(sequence.remove(number), known.remove(&number));
                        prop_assert_eq!(sequence.remove(number), None);
                    }
                }
                prop_assert_eq!(sequence.len(), known.len());
                let mut all: Vec<(u64, u64)> = sequence.iter().map(|(n, v)| (n, *v)).collect();
                all.sort_unstable();
                let expected: Vec<(u64, u64)> = known.iter().map(|(n, v)| (*n, *v)).collect();
                prop_assert_eq!(all, expected);
                for near in number.saturating_sub(9)..number + 9 {
                    prop_assert_eq!(sequence.get(near), known.get(&near));
                    prop_assert_eq!(sequence.get_mut(near), known.get_mut(&near));
                }
                prop_assert!(sequence.places.len() <= PLACES);
            }
        }
    }
}
