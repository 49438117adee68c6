//! Addresses in a hierarchy, and the masks that say which part of them a link speaks of.

use core::fmt;
use core::str::FromStr;

/// A HIAC address: 32 bits, written `3C:12:F8:00`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address(pub u32);

/// The part of an address that a mask selects, shifted down to bit 0. Level 0 is the employer of a
/// subnetwork, the highest value its broadcast.
pub type Level = u32;

/// Which bits of an address tell the stations of a subnetwork apart: contiguous, two at least.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Mask(u32);

/// Bits that are no mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaskError(
    /// The bits.
    pub u32,
);

/// A text that is no address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AddressError;

impl Address {
    /// From its four octets, the most significant first.
    pub const fn from_octets(octets: [u8; 4]) -> Address {
        Address(u32::from_be_bytes(octets))
    }

    /// Its four octets, the most significant first.
    pub const fn octets(self) -> [u8; 4] {
        self.0.to_be_bytes()
    }
}

impl Mask {
    /// A mask of these bits.
    ///
    /// # Errors
    /// If they are not contiguous, or fewer than two.
    pub const fn new(bits: u32) -> Result<Mask, MaskError> {
        let count = bits.count_ones();
        let contiguous = bits.leading_zeros() + count + bits.trailing_zeros() == 32;
        if contiguous && count >= 2 {
            Ok(Mask(bits))
        } else {
            Err(MaskError(bits))
        }
    }

    /// Its bits.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// How many octets a level address has under it: 1 to 4.
    pub const fn level_octets(self) -> usize {
        self.0.count_ones().div_ceil(8) as usize
    }

    /// The level of an address.
    pub const fn level(self, address: Address) -> Level {
        (address.0 & self.0) >> self.0.trailing_zeros()
    }

    /// The highest level: the broadcast.
    pub const fn broadcast(self) -> Level {
        self.0 >> self.0.trailing_zeros()
    }

    /// The address with this level in the subnetwork of `employer`, or `None` if the mask has too
    /// few bits for it. The bits below the mask are zero.
    pub const fn address(self, employer: Address, level: Level) -> Option<Address> {
        if level > self.broadcast() {
            return None;
        }
        Some(Address(
            (employer.0 & self.above()) | (level << self.0.trailing_zeros()),
        ))
    }

    /// Whether two addresses are of one subnetwork: they agree above the mask.
    pub const fn same_subnetwork(self, one: Address, other: Address) -> bool {
        (one.0 ^ other.0) & self.above() == 0
    }

    /// Whether `address` is of the block of `station`: they agree in the mask and above it. A
    /// station's own employees have their addresses from its block.
    pub const fn same_block(self, station: Address, address: Address) -> bool {
        (station.0 ^ address.0) & (self.above() | self.0) == 0
    }

    /// The bits above it.
    const fn above(self) -> u32 {
        match self.0.leading_zeros() {
            0 => 0,
            zeros => u32::MAX << (32 - zeros),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c, d] = self.octets();
        write!(f, "{a:02X}:{b:02X}:{c:02X}:{d:02X}")
    }
}

impl fmt::Display for Mask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Address(self.0).fmt(f)
    }
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Address, AddressError> {
        let mut octets = [0; 4];
        let mut parts = text.split(':');
        for octet in &mut octets {
            let digits = parts.next().ok_or(AddressError)?;
            let hexadecimal = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
            if digits.len() != 2 || !hexadecimal {
                return Err(AddressError);
            }
            *octet = u8::from_str_radix(digits, 16).map_err(|_| AddressError)?;
        }
        match parts.next() {
            None => Ok(Address::from_octets(octets)),
            Some(_) => Err(AddressError),
        }
    }
}

impl fmt::Display for AddressError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an address is four octets in hexadecimal, such as 20:C4:D2:05")
    }
}

impl fmt::Display for MaskError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bits = Address(self.0);
        write!(
            f,
            "{bits} is no mask: its bits are contiguous, and two at least"
        )
    }
}

impl core::error::Error for AddressError {}

impl core::error::Error for MaskError {}
