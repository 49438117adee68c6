//! Where the octets of an unfinished packet are kept.

/// A place for the octets of one packet.
pub trait Buffer {
    /// Adds an octet. Whether there was room for it.
    #[must_use]
    fn push(&mut self, octet: u8) -> bool;
    /// What was added.
    fn octets(&self) -> &[u8];
    /// Takes out everything.
    fn clear(&mut self);
}

/// Room for `N` octets, in itself.
#[derive(Clone, Debug)]
pub struct Fixed<const N: usize> {
    octets: [u8; N],
    len: usize,
}

impl<const N: usize> Fixed<N> {
    /// An empty buffer.
    pub const fn new() -> Fixed<N> {
        Fixed {
            octets: [0; N],
            len: 0,
        }
    }
}

impl<const N: usize> Default for Fixed<N> {
    fn default() -> Self {
        Fixed::new()
    }
}

impl<const N: usize> Buffer for Fixed<N> {
    fn push(&mut self, octet: u8) -> bool {
        match self.octets.get_mut(self.len) {
            Some(place) => {
                *place = octet;
                self.len += 1;
                true
            }
            None => false,
        }
    }

    fn octets(&self) -> &[u8] {
        &self.octets[..self.len]
    }

    fn clear(&mut self) {
        self.len = 0;
    }
}

/// Grows with what arrives, up to a limit.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug)]
pub struct Growing {
    octets: alloc::vec::Vec<u8>,
    limit: usize,
}

#[cfg(feature = "alloc")]
impl Growing {
    /// An empty buffer for at most `limit` octets.
    pub const fn new(limit: usize) -> Growing {
        Growing {
            octets: alloc::vec::Vec::new(),
            limit,
        }
    }

    pub(crate) fn into_octets(self) -> alloc::vec::Vec<u8> {
        self.octets
    }
}

#[cfg(feature = "alloc")]
impl Buffer for Growing {
    fn push(&mut self, octet: u8) -> bool {
        let room = self.octets.len() < self.limit;
        if room {
            self.octets.push(octet);
        }
        room
    }

    fn octets(&self) -> &[u8] {
        &self.octets
    }

    fn clear(&mut self) {
        self.octets.clear();
    }
}
