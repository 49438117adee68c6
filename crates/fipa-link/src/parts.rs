use std::iter::{Chain, once};
use std::option;
use std::vec;

use bytes::Bytes;

/// Octets in parts that follow each other. Up to two parts take no memory of their own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    first: Bytes,
    second: Option<Bytes>,
    more: Vec<Bytes>,
}

impl Parts {
    /// How many octets there are.
    pub fn octets(&self) -> usize {
        self.iter().map(Bytes::len).sum()
    }

    /// Appends a part.
    pub fn push(&mut self, part: Bytes) {
        if self.first.is_empty() {
            self.first = part;
        } else if self.second.is_none() {
            self.second = Some(part);
        } else {
            self.more.push(part);
        }
    }

    /// The parts in their order.
    pub fn iter(&self) -> impl Iterator<Item = &Bytes> {
        once(&self.first).chain(&self.second).chain(&self.more)
    }

    /// Takes the first part if it is not the last and has no more octets than this.
    pub(crate) fn take_small(&mut self, octets: usize) -> Option<Bytes> {
        if self.first.len() > octets {
            return None;
        }
        let next = self.second.take()?;
        if !self.more.is_empty() {
            self.second = Some(self.more.remove(0));
        }
        Some(std::mem::replace(&mut self.first, next))
    }
}

impl From<Bytes> for Parts {
    fn from(part: Bytes) -> Parts {
        Parts {
            first: part,
            ..Parts::default()
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
    type IntoIter =
        Chain<Chain<option::IntoIter<Bytes>, option::IntoIter<Bytes>>, vec::IntoIter<Bytes>>;

    fn into_iter(self) -> Self::IntoIter {
        Some(self.first)
            .into_iter()
            .chain(self.second)
            .chain(self.more)
    }
}
