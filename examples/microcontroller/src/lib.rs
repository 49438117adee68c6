//! HIAC on a microcontroller: a port that reads and writes packets of up to 64 octets, without an
//! allocator. Its memory is all that is needed but the stack.
//!
//! Built for the target it shows how much code that is; how much memory is checked below.

#![no_std]

use hiac::edcp::{Decoder, Event, escaped};
use hiac::{Fixed, Mask, Packet, WriteError};

/// Octets of the largest packet.
const LARGEST: usize = 64;

/// One end of a link.
pub struct Port {
    decoder: Decoder<Fixed<LARGEST>>,
    mask: Option<Mask>,
}

impl Port {
    /// A port whose level addresses are those under a mask.
    pub const fn new(mask: Option<Mask>) -> Port {
        Port {
            decoder: Decoder::new(Fixed::new()),
            mask,
        }
    }

    /// An octet came; the packet that it completes is shown, unless it cannot be read.
    pub fn receive(&mut self, octet: u8, show: &mut dyn FnMut(&Packet<'_>)) {
        if let Some(Event::Packet(octets)) = self.decoder.push(octet)
            && let Ok(packet) = Packet::decode(octets, self.mask)
        {
            show(&packet);
        }
    }

    /// Writes a packet, octet by octet.
    ///
    /// # Errors
    /// The packet says something that cannot be written.
    pub fn send(&self, packet: &Packet<'_>, put: &mut dyn FnMut(u8)) -> Result<(), WriteError> {
        let encoded = packet.encode(self.mask)?;
        escaped(encoded.octets()).for_each(put);
        Ok(())
    }
}

/// The RAM of a port, and what a packet takes on the stack while it is read or written.
#[cfg(target_pointer_width = "32")]
const _: () = {
    assert!(size_of::<Port>() <= LARGEST + 36);
    assert!(size_of::<Packet<'_>>() <= 28);
    assert!(size_of::<hiac::Encoded<'_>>() <= 36);
};

/// The RAM of a station and of what it tells, without what it keeps on the heap.
#[cfg(all(target_pointer_width = "32", feature = "station"))]
const _: () = {
    assert!(size_of::<hiac::Station>() <= 448);
    assert!(size_of::<hiac::station::Event>() <= 40);
};
