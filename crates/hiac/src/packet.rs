//! What a HIACP packet says.

use crate::{Address, Level};

/// A HIACP packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// PT, what its data means.
    pub kind: PacketType,
    /// PRI, 0 (the most urgent) to 7.
    pub priority: u8,
    /// CR, whether a confirmation is asked for; only of a numbered packet.
    pub confirm: bool,
    /// CT, by what it is checked.
    pub check: Check,
    /// Its number and its place in a message of several packets, if it has them (MP).
    pub numbered: Option<Numbered>,
    /// From whom to whom (FA, TRG, SRC).
    pub addressing: Addressing,
    /// DATA, without the fragment octet.
    pub data: &'a [u8],
}

/// PT, the type of a packet: 0 to 15.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PacketType(u8);

/// How a packet is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Check {
    /// The sum of the octets modulo 256.
    Sum,
    /// CRC-32 (IEEE 802.3).
    Crc32,
}

/// The number of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Numbered {
    /// PSN, which counts the numbered packets of a sender to a target in a priority.
    pub psn: u8,
    /// Its place in the message.
    pub fragment: Fragment,
}

/// The place of a packet in a message of several packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fragment {
    /// Its index, 0 to 127.
    pub index: u8,
    /// Whether more packets follow.
    pub more: bool,
}

/// Sender and receiver of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Addressing {
    /// By their addresses.
    Full {
        /// The receiver.
        target: Address,
        /// The sender.
        source: Address,
    },
    /// By their levels under the mask of the link.
    Level {
        /// The receiver.
        target: Level,
        /// The sender.
        source: Level,
    },
}

impl<'a> Packet<'a> {
    /// A packet that is not numbered and checked by its sum.
    pub const fn new(
        kind: PacketType,
        priority: u8,
        addressing: Addressing,
        data: &'a [u8],
    ) -> Packet<'a> {
        Packet {
            kind,
            priority,
            confirm: false,
            check: Check::Sum,
            numbered: None,
            addressing,
            data,
        }
    }
}

impl PacketType {
    /// A signal.
    pub const SIG: PacketType = PacketType(1);
    /// Semaphores.
    pub const SMPH: PacketType = PacketType(2);
    /// A message.
    pub const MSG: PacketType = PacketType(3);
    /// Shared memory, written.
    pub const SHMW: PacketType = PacketType(4);
    /// Shared memory, read.
    pub const SHMR: PacketType = PacketType(5);
    /// Barriers.
    pub const SYNC: PacketType = PacketType(8);
    /// The system: connection, confirmation, transfer.
    pub const SYS: PacketType = PacketType(14);

    const NAMED: [(PacketType, &'static str); 7] = [
        (PacketType::SIG, "SIG"),
        (PacketType::SMPH, "SMPH"),
        (PacketType::MSG, "MSG"),
        (PacketType::SHMW, "SHMW"),
        (PacketType::SHMR, "SHMR"),
        (PacketType::SYNC, "SYNC"),
        (PacketType::SYS, "SYS"),
    ];

    /// The type with this number, if it is one: 0 to 15.
    pub const fn new(number: u8) -> Option<PacketType> {
        match number {
            0..=15 => Some(PacketType(number)),
            _ => None,
        }
    }

    /// Its number.
    pub const fn number(self) -> u8 {
        self.0
    }

    /// Its name, if it has one.
    pub fn name(self) -> Option<&'static str> {
        let named = Self::NAMED.iter().find(|(kind, _)| *kind == self);
        named.map(|(_, name)| *name)
    }

    /// The type with this name.
    pub fn from_name(name: &str) -> Option<PacketType> {
        let named = Self::NAMED.iter().find(|(_, known)| *known == name);
        named.map(|(kind, _)| *kind)
    }
}

impl Check {
    /// How many octets it has.
    pub const fn octets(self) -> usize {
        match self {
            Check::Sum => 1,
            Check::Crc32 => 4,
        }
    }

    /// The check of these octets, which follow each other: its last [`octets`](Self::octets) are
    /// those that stand in the packet.
    pub(crate) fn of(self, parts: [&[u8]; 2]) -> [u8; 4] {
        match self {
            Check::Sum => {
                let octets = parts.into_iter().flatten();
                let sum = octets.fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
                [0, 0, 0, sum]
            }
            Check::Crc32 => {
                let mut crc = crc32fast::Hasher::new();
                parts.into_iter().for_each(|part| crc.update(part));
                crc.finalize().to_be_bytes()
            }
        }
    }
}

/// The bits of the flags octet.
pub(crate) mod flags {
    pub(crate) const RESERVED: u8 = 1 << 7;
    pub(crate) const CONFIRM: u8 = 1 << 3;
    pub(crate) const NUMBERED: u8 = 1 << 2;
    pub(crate) const CRC32: u8 = 1 << 1;
    pub(crate) const FULL: u8 = 1;
    /// How far PRI is shifted.
    pub(crate) const PRIORITY: u8 = 4;
}

/// The bit of the fragment octet that says that more follow.
pub(crate) const MORE: u8 = 1 << 7;

/// The version of the protocol.
pub(crate) const VERSION: u8 = 1;

/// The longest LNG, in octets of seven bits.
pub(crate) const MAX_LENGTH_OCTETS: usize = 3;
