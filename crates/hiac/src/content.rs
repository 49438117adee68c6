//! What the data of each packet type says.

use crate::sys::{Parameters, Subtype};
use crate::{Buffer, PacketType};

/// The data of a packet, or of the fragments of one message put together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content<'a> {
    /// SIG.
    Signal {
        /// Its number; [`STATION_LOST`] has a meaning.
        number: u8,
        /// What goes with it.
        arguments: &'a [u8],
    },
    /// SMPH.
    Semaphore {
        /// What is wanted, or how it stands.
        operation: SemaphoreOperation,
        /// Which one of its keeper's.
        number: u16,
    },
    /// MSG.
    Message {
        /// What it is.
        kind: MessageKind,
        /// What ties an answer to its question; 0: nothing.
        reference: u8,
        /// The text, or whatever both sides understand.
        octets: &'a [u8],
    },
    /// SHMW, or the answer to a SHMR.
    Write {
        /// Where the octets begin.
        address: u32,
        /// The octets.
        octets: &'a [u8],
    },
    /// SHMR.
    Read {
        /// Where the octets begin.
        address: u32,
        /// How many.
        length: u16,
    },
    /// SYNC.
    Barrier {
        /// What happens there.
        operation: BarrierOperation,
        /// Which one of its keeper's.
        number: u16,
        /// How many parties meet.
        parties: u8,
    },
    /// SYS.
    System {
        /// What it is for.
        subtype: Subtype,
        /// The parameters.
        parameters: Parameters<'a>,
    },
}

/// The signal by which an employer tells its workgroup that an employee is lost; the argument is
/// the address.
pub const STATION_LOST: u8 = 0;

/// What a SMPH packet says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum SemaphoreOperation {
    /// Wants it.
    Take = 0,
    /// Gives it back, or waits no longer.
    Give = 1,
    /// Asks how it stands.
    Test = 2,
    /// It is the receiver's.
    Granted = 0x80,
    /// The receiver waits for it.
    Waiting = 0x81,
    /// Nobody has it.
    Free = 0x82,
    /// Somebody has it.
    Taken = 0x83,
}

/// What a MSG packet is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum MessageKind {
    /// Something to know.
    Information = 0,
    /// Something to do, from above alone.
    Command = 1,
    /// Something to answer.
    Question = 2,
    /// The answer.
    Answer = 3,
    /// Something that is wrong.
    Warning = 4,
}

/// What a SYNC packet says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum BarrierOperation {
    /// The sender is there.
    Arrive = 0,
    /// All are there.
    Release = 1,
    /// The sender is not there any more.
    Leave = 2,
}

/// Data that has not the form of its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContentError {
    /// The type has no meaning.
    Type,
    /// It is malformed.
    Malformed,
}

impl core::fmt::Display for ContentError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            ContentError::Type => "the packet type has no meaning",
            ContentError::Malformed => "the data has not the form of its type",
        })
    }
}

impl core::error::Error for ContentError {}

impl SemaphoreOperation {
    const ALL: [SemaphoreOperation; 7] = [
        SemaphoreOperation::Take,
        SemaphoreOperation::Give,
        SemaphoreOperation::Test,
        SemaphoreOperation::Granted,
        SemaphoreOperation::Waiting,
        SemaphoreOperation::Free,
        SemaphoreOperation::Taken,
    ];
}

impl MessageKind {
    const ALL: [MessageKind; 5] = [
        MessageKind::Information,
        MessageKind::Command,
        MessageKind::Question,
        MessageKind::Answer,
        MessageKind::Warning,
    ];
}

impl BarrierOperation {
    const ALL: [BarrierOperation; 3] = [
        BarrierOperation::Arrive,
        BarrierOperation::Release,
        BarrierOperation::Leave,
    ];
}

impl<'a> Content<'a> {
    /// Reads the data of a packet of this type, without its fragment octet.
    ///
    /// # Errors
    /// For a type without meaning, and data without the form of its type.
    pub fn decode(kind: PacketType, data: &'a [u8]) -> Result<Content<'a>, ContentError> {
        let content = match kind {
            PacketType::SIG => signal(data),
            PacketType::SMPH => semaphore(data),
            PacketType::MSG => message(data),
            PacketType::SHMW => write(data),
            PacketType::SHMR => read(data),
            PacketType::SYNC => barrier(data),
            PacketType::SYS => system(data),
            _ => return Err(ContentError::Type),
        };
        content.ok_or(ContentError::Malformed)
    }

    /// The type of a packet with this content.
    pub fn kind(&self) -> PacketType {
        match self {
            Content::Signal { .. } => PacketType::SIG,
            Content::Semaphore { .. } => PacketType::SMPH,
            Content::Message { .. } => PacketType::MSG,
            Content::Write { .. } => PacketType::SHMW,
            Content::Read { .. } => PacketType::SHMR,
            Content::Barrier { .. } => PacketType::SYNC,
            Content::System { .. } => PacketType::SYS,
        }
    }

    /// Writes the data. Whether there was room, and every parameter could be written.
    #[must_use]
    pub fn encode(&self, to: &mut impl Buffer) -> bool {
        match *self {
            Content::Signal { number, arguments } => put(to, &[&[number], arguments]),
            Content::Semaphore { operation, number } => {
                put(to, &[&[operation as u8], &number.to_be_bytes()])
            }
            Content::Message {
                kind,
                reference,
                octets,
            } => put(to, &[&[kind as u8, reference], octets]),
            Content::Write { address, octets } => put(to, &[&address.to_be_bytes(), octets]),
            Content::Read { address, length } => {
                put(to, &[&address.to_be_bytes(), &length.to_be_bytes()])
            }
            Content::Barrier {
                operation,
                number,
                parties,
            } => put(to, &[&[operation as u8], &number.to_be_bytes(), &[parties]]),
            Content::System {
                subtype,
                parameters,
            } => to.push(subtype as u8) && parameters.encode(to),
        }
    }
}

fn put(to: &mut impl Buffer, parts: &[&[u8]]) -> bool {
    let mut octets = parts.iter().copied().flatten();
    octets.all(|octet| to.push(*octet))
}

fn signal(data: &[u8]) -> Option<Content<'_>> {
    let [number, arguments @ ..] = data else {
        return None;
    };
    let number = *number;
    Some(Content::Signal { number, arguments })
}

fn semaphore(data: &[u8]) -> Option<Content<'_>> {
    let [operation, high, low] = *data else {
        return None;
    };
    let mut known = SemaphoreOperation::ALL.into_iter();
    Some(Content::Semaphore {
        operation: known.find(|known| *known as u8 == operation)?,
        number: u16::from_be_bytes([high, low]),
    })
}

fn message(data: &[u8]) -> Option<Content<'_>> {
    let [kind, reference, octets @ ..] = data else {
        return None;
    };
    let mut known = MessageKind::ALL.into_iter();
    Some(Content::Message {
        kind: known.find(|known| *known as u8 == *kind)?,
        reference: *reference,
        octets,
    })
}

fn write(data: &[u8]) -> Option<Content<'_>> {
    let (address, octets) = data.split_first_chunk()?;
    let address = u32::from_be_bytes(*address);
    Some(Content::Write { address, octets })
}

fn read(data: &[u8]) -> Option<Content<'_>> {
    let (address, length) = data.split_first_chunk()?;
    Some(Content::Read {
        address: u32::from_be_bytes(*address),
        length: u16::from_be_bytes(length.try_into().ok()?),
    })
}

fn barrier(data: &[u8]) -> Option<Content<'_>> {
    let [operation, high, low, parties] = *data else {
        return None;
    };
    let mut known = BarrierOperation::ALL.into_iter();
    Some(Content::Barrier {
        operation: known.find(|known| *known as u8 == operation)?,
        number: u16::from_be_bytes([high, low]),
        parties,
    })
}

fn system(data: &[u8]) -> Option<Content<'_>> {
    let [subtype, parameters @ ..] = data else {
        return None;
    };
    Some(Content::System {
        subtype: Subtype::new(*subtype)?,
        parameters: Parameters::decode(parameters).ok()?,
    })
}
