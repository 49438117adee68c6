//! Who watches what passes.

use std::fmt;

use crate::edcp::{Decoder, Event};
use crate::{Growing, Mask};

/// Octets of a packet that is shown, at most.
const LONGEST: usize = 65_536;

/// Somebody to whom the packets of a [`Node`](super::Node) are shown as they pass, those included
/// that go through it from one station to another.
pub trait Watcher: fmt::Debug + Send {
    /// Whether packets are wanted now. While they are not, none is looked for.
    fn is_watching(&self) -> bool;

    /// A packet came, or is about to be written, on the stream to or from this place. `mask` is that
    /// of the stream before this packet.
    fn passed(&mut self, incoming: bool, place: &str, packet: Event<'_>, mask: Option<Mask>);
}

/// The packets in the octets of one direction, which are looked for while somebody watches.
#[derive(Debug, Default)]
pub(super) struct Heard(Option<Decoder<Growing>>);

impl Heard {
    pub(super) fn show(
        &mut self,
        watcher: &mut dyn Watcher,
        incoming: bool,
        place: &str,
        mask: Option<Mask>,
        octets: &[u8],
    ) {
        if !watcher.is_watching() {
            // What has begun is not going to be whole when somebody watches again.
            self.0 = None;
            return;
        }
        let decoder = self
            .0
            .get_or_insert_with(|| Decoder::new(Growing::new(LONGEST)));
        for octet in octets {
            if let Some(event) = decoder.push(*octet) {
                watcher.passed(incoming, place, event, mask);
            }
        }
    }
}
