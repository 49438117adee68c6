//! Our stamps, as they are written in front of letters.

use std::fmt::Write;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Slots, Text};
use fipa_codec::{EncodeError, Output as Encoded, bit_efficient};
use fipa_directory::InstanceId;

/// Octets that memory is taken for at once: several stamps lie in it. A letter that waits keeps all
/// of it, which is little beside the buffer that it was read into.
const ROOM: usize = 4096;

/// Octets of an ordinary overlay.
const OVERLAY: usize = 256;

/// Writes stamps side by side.
#[derive(Debug)]
pub(super) struct Stamps {
    /// What the numbers of our stamps begin with.
    prefix: String,
    ids: BytesMut,
    overlays: Encoded,
    /// Octets that `overlays` has room for.
    left: usize,
}

impl Stamps {
    pub(super) fn new(instance: InstanceId) -> Stamps {
        Stamps {
            prefix: format!("{instance}:"),
            ids: BytesMut::new(),
            overlays: Encoded::new(),
            left: 0,
        }
    }

    /// Whether the number of a stamp is one of ours.
    pub(super) fn is_own(&self, id: &str) -> bool {
        id.starts_with(&self.prefix)
    }

    /// The number of the stamp on a copy.
    pub(super) fn id(&mut self, number: u64) -> Text {
        if self.ids.capacity() < OVERLAY {
            self.ids.reserve(ROOM);
        }
        self.ids.extend_from_slice(self.prefix.as_bytes());
        // Nothing that is written to memory fails.
        let _ = write!(self.ids, "{number}");
        Text::from_utf8_lossy(self.ids.split().freeze())
    }

    /// The octets of an overlay.
    pub(super) fn encode(&mut self, overlay: &Slots) -> Result<Bytes, EncodeError> {
        if self.left < OVERLAY {
            self.overlays.reserve(ROOM);
            self.left = ROOM;
        }
        bit_efficient::encode_overlay(overlay, &mut self.overlays)?;
        let octets = self.overlays.take_bytes();
        self.left = self.left.saturating_sub(octets.len());
        Ok(octets)
    }
}
