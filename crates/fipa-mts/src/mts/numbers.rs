//! Sets of small numbers, a bit each: what each of a thousand peers knows of the others is a million
//! facts.

/// A set of small numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct Numbers(Vec<u64>);

impl Numbers {
    pub(super) fn insert(&mut self, number: u32) {
        let (word, bit) = place(number);
        if self.0.len() <= word {
            self.0.resize(word + 1, 0);
        }
        if let Some(word) = self.0.get_mut(word) {
            *word |= bit;
        }
    }

    pub(super) fn remove(&mut self, number: u32) {
        let (word, bit) = place(number);
        if let Some(word) = self.0.get_mut(word) {
            *word &= !bit;
        }
    }

    pub(super) fn contains(&self, number: u32) -> bool {
        let (word, bit) = place(number);
        self.0.get(word).is_some_and(|word| word & bit != 0)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.iter().all(|word| *word == 0)
    }

    pub(super) fn clear(&mut self) {
        self.0 = Vec::new();
    }

    /// Takes out all that another set has.
    pub(super) fn subtract(&mut self, other: &Numbers) {
        for (word, out) in self.0.iter_mut().zip(&other.0) {
            *word &= !out;
        }
    }
}

fn place(number: u32) -> (usize, u64) {
    (number as usize / 64, 1 << (number % 64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_holds_what_was_put_and_not_taken_out() {
        let mut numbers = Numbers::default();
        for number in [0, 63, 64, 1000] {
            numbers.insert(number);
        }
        numbers.remove(63);
        numbers.remove(5000);
        let held: Vec<u32> = (0..2000).filter(|n| numbers.contains(*n)).collect();
        assert_eq!(held, [0, 64, 1000]);
        let mut others = Numbers::default();
        for number in [0, 1, 1000, 7000] {
            others.insert(number);
        }
        numbers.subtract(&others);
        assert!(!numbers.is_empty() && numbers.contains(64));
        numbers.remove(64);
        assert!(numbers.is_empty());
    }
}
