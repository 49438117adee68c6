//! Inputs that are nearly valid, and limits that ordinary ones exceed.

use bytes::Bytes;
use fipa_codec::Limits;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::{Index, select};

/// The default ones, and small ones.
pub(crate) fn limits() -> [Limits; 2] {
    let small = Limits {
        max_octets: 100,
        max_depth: 2,
        max_items: 5,
        max_layers: 2,
    };
    [Limits::default(), small]
}

/// Some octets of a valid input replaced, removed or inserted: by any, or by those that have a
/// meaning in the form.
pub(crate) fn mutated(
    octets: impl Strategy<Value = Bytes>,
    meaning: &'static [u8],
) -> impl Strategy<Value = Vec<u8>> {
    let octet = prop_oneof![any::<u8>(), select(meaning)];
    let changes = vec((any::<Index>(), octet, 0..3), 1..4);
    (octets, changes).prop_map(|(octets, changes)| {
        let mut octets = octets.to_vec();
        for (index, octet, kind) in changes {
            let at = index.index(octets.len());
            match kind {
                0 => octets[at] = octet,
                1 if octets.len() > 1 => drop(octets.remove(at)),
                _ => octets.insert(at, octet),
            }
        }
        octets
    })
}
