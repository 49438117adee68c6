//! From the octets of a packet to a [`Packet`].

use core::fmt;

use crate::packet::{MAX_LENGTH_OCTETS, MORE, VERSION, flags};
use crate::{Address, Addressing, Check, Fragment, Level, Mask, Numbered, Packet, PacketType};

/// Why the octets of a packet cannot be read. Where several hold, the first that is looked for is
/// told: in the order of these, but that a length may be wrong before the version is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadError {
    /// It is too short, or LNG is not in its shortest form or not what is there.
    Length,
    /// PV is not 1.
    Version,
    /// The reserved bit is set, or a confirmation is asked for without a number.
    Flags,
    /// It has level addresses, and the mask is not known.
    Mask,
    /// CHK is not what its octets give.
    Checksum,
    /// A level address has more bits than the mask.
    Address,
}

impl ReadError {
    /// The word that programs are told.
    pub fn word(self) -> &'static str {
        match self {
            ReadError::Length => "length",
            ReadError::Version => "version",
            ReadError::Flags => "flags",
            ReadError::Mask => "mask",
            ReadError::Checksum => "checksum",
            ReadError::Address => "address",
        }
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ReadError::Length => "it is not as long as it says",
            ReadError::Version => "it has another version than 1",
            ReadError::Flags => "its flags contradict each other or have the reserved bit",
            ReadError::Mask => "it has level addresses, and the mask is not known",
            ReadError::Checksum => "its checksum is wrong",
            ReadError::Address => "an address has more bits than the mask",
        })
    }
}

impl core::error::Error for ReadError {}

impl<'a> Packet<'a> {
    /// Reads the octets from PV to CHK; `mask` is that of the link, needed for level addresses.
    ///
    /// # Errors
    /// The first fault, see [`ReadError`].
    pub fn decode(octets: &'a [u8], mask: Option<Mask>) -> Result<Packet<'a>, ReadError> {
        let [head, flags, ..] = *octets else {
            return Err(ReadError::Length);
        };
        if head >> 4 != VERSION {
            return Err(ReadError::Version);
        }
        let has = |flag| flags & flag != 0;
        if has(flags::RESERVED) || (has(flags::CONFIRM) && !has(flags::NUMBERED)) {
            return Err(ReadError::Flags);
        }
        let width = match (has(flags::FULL), mask) {
            (true, _) => 4,
            (false, Some(mask)) => mask.level_octets(),
            (false, None) => return Err(ReadError::Mask),
        };
        let check = match has(flags::CRC32) {
            true => Check::Crc32,
            false => Check::Sum,
        };
        let mut rest = &octets[2..];
        let psn = match has(flags::NUMBERED) {
            true => Some(number(&mut rest, 1)? as u8),
            false => None,
        };
        let target = number(&mut rest, width)?;
        let source = number(&mut rest, width)?;
        let length = length(&mut rest)?;
        if rest.len() != length + check.octets() {
            return Err(ReadError::Length);
        }
        let (data, told) = rest.split_at(length);
        let (numbered, data) = match (psn, data) {
            (None, data) => (None, data),
            (Some(_), []) => return Err(ReadError::Length),
            (Some(psn), [fragment, data @ ..]) => {
                let fragment = Fragment {
                    index: fragment & !MORE,
                    more: fragment & MORE != 0,
                };
                (Some(Numbered { psn, fragment }), data)
            }
        };
        let checked = &octets[..octets.len() - told.len()];
        if !check.of([checked, &[]]).ends_with(told) {
            return Err(ReadError::Checksum);
        }
        let addressing = match has(flags::FULL) {
            true => Addressing::Full {
                target: Address(target),
                source: Address(source),
            },
            false => level_addressing(target, source, mask)?,
        };
        Ok(Packet {
            kind: PacketType::new(head & 0x0F).ok_or(ReadError::Version)?,
            priority: (flags >> flags::PRIORITY) & 7,
            confirm: has(flags::CONFIRM),
            check,
            numbered,
            addressing,
            data,
        })
    }
}

fn level_addressing(
    target: Level,
    source: Level,
    mask: Option<Mask>,
) -> Result<Addressing, ReadError> {
    let highest = mask.ok_or(ReadError::Mask)?.broadcast();
    if target > highest || source > highest {
        return Err(ReadError::Address);
    }
    Ok(Addressing::Level { target, source })
}

/// The next number of `width` octets, the most significant first.
fn number(rest: &mut &[u8], width: usize) -> Result<u32, ReadError> {
    let (octets, behind) = rest.split_at_checked(width).ok_or(ReadError::Length)?;
    *rest = behind;
    let shift = |number: u32, octet: &u8| number << 8 | u32::from(*octet);
    Ok(octets.iter().fold(0, shift))
}

/// LNG: groups of seven bits, bit 7 set on all but the last octet, none too many.
fn length(rest: &mut &[u8]) -> Result<usize, ReadError> {
    let mut length = 0;
    for place in 0..MAX_LENGTH_OCTETS {
        let octet = number(rest, 1)? as usize;
        if place == 0 && octet == 0x80 {
            return Err(ReadError::Length);
        }
        length = length << 7 | (octet & 0x7F);
        if octet & 0x80 == 0 {
            return Ok(length);
        }
    }
    Err(ReadError::Length)
}
