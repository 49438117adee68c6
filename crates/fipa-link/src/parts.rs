use std::iter::{Chain, Once, once};

use bytes::Bytes;

/// Octets in parts that follow each other. One part takes no memory of its own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    first: Bytes,
    more: Vec<Bytes>,
}

impl Parts {
    /// How many octets there are.
    pub fn octets(&self) -> usize {
        self.iter().map(Bytes::len).sum()
    }

    /// Appends a part.
    pub fn push(&mut self, part: Bytes) {
        match self.first.is_empty() {
            true => self.first = part,
            false => self.more.push(part),
        }
    }

    /// The parts in their order.
    pub fn iter(&self) -> impl Iterator<Item = &Bytes> {
        once(&self.first).chain(&self.more)
    }

    /// Takes the first part if it is not the last and has no more octets than this.
    pub(crate) fn take_small(&mut self, octets: usize) -> Option<Bytes> {
        if self.first.len() > octets || self.more.is_empty() {
            return None;
        }
        let next = self.more.remove(0);
        Some(std::mem::replace(&mut self.first, next))
    }
}

impl From<Bytes> for Parts {
    fn from(part: Bytes) -> Parts {
        Parts {
            first: part,
            more: Vec::new(),
        }
    }
}

impl FromIterator<Bytes> for Parts {
    fn from_iter<I: IntoIterator<Item = Bytes>>(parts: I) -> Parts {
        let mut all = Parts::default();
        parts.into_iter().for_each(|part| all.push(part));
        all
    }
}

impl IntoIterator for Parts {
    type Item = Bytes;
    type IntoIter = Chain<Once<Bytes>, std::vec::IntoIter<Bytes>>;

    fn into_iter(self) -> Self::IntoIter {
        once(self.first).chain(self.more)
    }
}
