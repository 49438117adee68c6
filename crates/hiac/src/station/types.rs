//! What a station is told and tells.

use alloc::string::String;
use alloc::vec::Vec;
use core::time::Duration;

use super::rights::Direction;
use crate::content::MessageKind;
use crate::sys::{Checks, FRAGMENTS, NUMBERS, Outcome, Types};
use crate::{Address, Mask};

/// A link, numbered by whoever opens it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LinkId(pub u64);

/// Something that was sent, until it is known what became of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(pub u64);

/// A subnetwork that a station employs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Workgroup {
    /// The station's own address in it: level 0.
    pub address: Address,
    /// Its mask.
    pub mask: Mask,
}

/// Who may do something with a region of memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rights {
    /// The employer.
    pub employer: bool,
    /// The colleagues.
    pub colleagues: bool,
    /// The employees.
    pub employees: bool,
}

/// A region of the memory that a station shares.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Region {
    /// The address of its first octet.
    pub address: u32,
    /// Its octets.
    pub octets: Vec<u8>,
    /// Who may read it.
    pub read: Rights,
    /// Who may write it.
    pub write: Rights,
}

impl Region {
    /// Zeros that all may read and only the employer may write.
    pub fn new(address: u32, length: usize) -> Region {
        Region {
            address,
            octets: alloc::vec![0; length],
            read: Rights {
                employer: true,
                colleagues: true,
                employees: true,
            },
            write: Rights {
                employer: true,
                colleagues: false,
                employees: false,
            },
        }
    }
}

/// How a station behaves.
#[derive(Clone, Debug)]
pub struct StationConfig {
    /// What it is called in INCON and ACCON; cut to 14 octets, 11 where CRC-32 is used.
    pub name: Option<String>,
    /// Its address, until an employer gives it another.
    pub address: Option<Address>,
    /// What it employs, each in its own block.
    pub workgroups: Vec<Workgroup>,
    /// Addresses of its workgroups that it plays itself, as colleagues of its employees.
    pub aliases: Vec<Address>,
    /// The longest silence of a partner; 20 ms to 65.535 s.
    pub period: Duration,
    /// The octets of the largest packet that it takes; 64 at least.
    pub largest: u32,
    /// The checks that it can.
    pub checks: Checks,
    /// The packet types that it understands.
    pub types: Types,
    /// [`NUMBERS`] and [`FRAGMENTS`].
    pub abilities: u8,
    /// How often a packet is sent before it has failed.
    pub sendings: u32,
    /// How long an answer is waited for.
    pub patience: Duration,
    /// Its semaphores: 0 to one less than this.
    pub semaphores: u16,
    /// The memory that it shares.
    pub memory: Vec<Region>,
    /// Whether others can open streams to it.
    pub listens: bool,
    /// The longest message that is put together from fragments; a longer one is refused.
    pub longest_message: usize,
    /// How many packets and messages may wait on a link in each priority; what comes then is
    /// refused.
    pub queue: usize,
}

impl Default for StationConfig {
    fn default() -> Self {
        StationConfig {
            name: None,
            address: None,
            workgroups: Vec::new(),
            aliases: Vec::new(),
            period: Duration::from_millis(1000),
            largest: 65_536,
            checks: Checks::BOTH,
            types: Types::ALL,
            abilities: NUMBERS | FRAGMENTS,
            sendings: 16,
            patience: Duration::from_secs(5),
            semaphores: 0,
            memory: Vec::new(),
            listens: false,
            longest_message: 1 << 20,
            queue: 256,
        }
    }
}

/// What a station takes its own end of a link for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It employs whoever is at the other end.
    Employer,
    /// It waits for whoever employs it.
    Employee,
}

/// A link as it is opened.
#[derive(Clone, Debug)]
pub struct LinkConfig {
    /// What this end is.
    pub role: Role,
    /// Whether the stream is closed when its connection is lost; a serial line stays.
    pub closes: bool,
    /// Where the other end listens, if it was dialled.
    pub place: Option<String>,
    /// The address that the employee at the other end gets; else the lowest free one.
    pub address: Option<Address>,
}

impl LinkConfig {
    /// A stream that is closed when its connection is lost.
    pub fn stream(role: Role) -> LinkConfig {
        LinkConfig {
            role,
            closes: true,
            place: None,
            address: None,
        }
    }
}

/// How something is sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// PRI; else 0 for SYS, 1 for SIG, 4 for the rest.
    pub priority: Option<u8>,
    /// Whether a confirmation is asked for, where the receiver has that ability.
    pub confirm: bool,
    /// Whether whole addresses are used also where levels would do.
    pub full: bool,
    /// Whether the sum is used also where CRC-32 could be.
    pub sum: bool,
}

impl Options {
    /// With a confirmation.
    pub const CONFIRMED: Options = Options {
        priority: None,
        confirm: true,
        full: false,
        sum: false,
    };
}

/// Why something is not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SendError {
    /// The hierarchy forbids it.
    NotPermitted,
    /// There is no such station, or no connection on the way to it.
    NoSuchTarget,
    /// The partner does not understand the type.
    Unsupported,
    /// It does not fit the packets that the receiver takes.
    TooLong,
    /// Too much waits on the link.
    Full,
    /// A memory request to this station is open.
    Open,
}

impl core::fmt::Display for SendError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            SendError::NotPermitted => "not permitted in the hierarchy",
            SendError::NoSuchTarget => "there is no such station, or no connection to it",
            SendError::Unsupported => "the partner does not support this type",
            SendError::TooLong => "it is too long for the receiver",
            SendError::Full => "too much waits on the link",
            SendError::Open => "such a request is still open",
        })
    }
}

impl core::error::Error for SendError {}

/// Why something that was sent has failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// It was refused.
    Refused(Outcome, Option<String>),
    /// It was not confirmed; whether it arrived is unknown.
    Unconfirmed,
    /// No answer came in time.
    Unanswered,
    /// The connection was lost.
    Lost,
}

impl core::fmt::Display for Failure {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Failure::Refused(outcome, None) => outcome.fmt(f),
            Failure::Refused(outcome, Some(reason)) => write!(f, "{outcome}: {reason}"),
            Failure::Unconfirmed => f.write_str("it was not confirmed"),
            Failure::Unanswered => f.write_str("no answer came in time"),
            Failure::Lost => f.write_str("the connection was lost"),
        }
    }
}

/// Why a connection is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The partner was silent, or the stream has ended.
    Lost,
    /// The employer removed this station, or this station its employee.
    Removed,
    /// The employee has passed over to another employer.
    Transferred,
}

/// Who asked something, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// The address of the sender.
    pub address: Address,
    /// The own address, or alias, to which it spoke.
    pub to: Address,
    /// What the own station is to the sender.
    pub direction: Direction,
    /// The link.
    pub link: LinkId,
    /// How it was sent, and how a reply is.
    pub options: Options,
    /// Whether it went to all.
    pub broadcast: bool,
}

/// Something that a station has to tell.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Event {
    /// There is a connection.
    Connected {
        /// The link.
        link: LinkId,
        /// What the own end is.
        role: Role,
        /// The own address there.
        own: Address,
        /// The address of the other end.
        partner: Address,
        /// The name of the other end.
        name: Option<String>,
    },
    /// A connection is over.
    Disconnected {
        /// The link.
        link: LinkId,
        /// What the own end was.
        role: Role,
        /// The address that the other end had.
        partner: Address,
        /// Why.
        reason: Ended,
    },
    /// The other end of a link does not want to be employed.
    ConnectionRefused {
        /// The link.
        link: LinkId,
        /// Why.
        outcome: Outcome,
        /// Why, in words.
        reason: Option<String>,
    },
    /// The partner on this link has another address, or this station has.
    Moved {
        /// The link.
        link: LinkId,
        /// The own address there.
        own: Address,
        /// The address of the other end.
        partner: Address,
    },
    /// A signal came.
    Signal {
        /// From whom.
        from: Sender,
        /// Which one.
        number: u8,
        /// What came with it.
        arguments: Vec<u8>,
    },
    /// A message came; answers to own questions come as [`Event::Answered`].
    Message {
        /// From whom.
        from: Sender,
        /// What it is.
        kind: MessageKind,
        /// What ties an answer to it; 0: nothing.
        reference: u8,
        /// What it says.
        octets: Vec<u8>,
    },
    /// The keeper of a semaphore says how it stands.
    Semaphore {
        /// The keeper.
        keeper: Address,
        /// Which one.
        number: u16,
        /// How it stands.
        state: crate::content::SemaphoreOperation,
    },
    /// All parties have arrived at a barrier.
    Released {
        /// Its keeper.
        keeper: Address,
        /// Which one.
        number: u16,
    },
    /// Somebody has written into the shared memory.
    MemoryWritten {
        /// Who.
        by: Address,
        /// Where.
        address: u32,
        /// How many octets.
        length: usize,
    },
    /// Its last octet is on the link.
    Written(Ticket),
    /// The receiver has confirmed it; where it cannot, it is written.
    Confirmed(Ticket),
    /// It has failed.
    Failed(Ticket, Failure),
    /// A question, or a command with a reference, is answered: by an answer, or a warning.
    Answered {
        /// The question.
        ticket: Ticket,
        /// What came.
        kind: MessageKind,
        /// What it says.
        octets: Vec<u8>,
    },
    /// The memory that was asked for.
    Memory {
        /// The request.
        ticket: Ticket,
        /// What is there.
        octets: Vec<u8>,
    },
    /// An employee is to be taken over: open a stream to it, or let it be one that comes.
    Expect {
        /// The address that it has had.
        employee: Address,
        /// Where it listens; open a stream there as employer.
        place: Option<String>,
    },
    /// This station is to pass over to another employer.
    PassOver {
        /// The new employer.
        employer: Address,
        /// Where it listens; open a stream there as employee.
        place: Option<String>,
    },
    /// What a transfer came to.
    Transferred {
        /// The employee.
        employee: Address,
        /// Its new employer.
        to: Address,
        /// Whether it has passed over.
        result: Result<(), Failure>,
    },
    /// Close the stream of this link, once what it still has to send is written.
    Close(LinkId),
}

/// What was dropped, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drops {
    /// Packets that cannot be read.
    pub unreadable: u64,
    /// Packets before the connection, and connection packets that belong to none.
    pub unconnected: u64,
    /// Packets of employees with another source than their own, and those of this station itself.
    pub misplaced: u64,
    /// Packets without wish for confirmation that are not permitted.
    pub not_permitted: u64,
    /// Packets without wish for confirmation that were refused for another reason.
    pub refused: u64,
    /// Packets that had come before.
    pub repeated: u64,
    /// Messages whose next fragment did not come.
    pub incomplete: u64,
    /// Confirmations, answers and replies that belong to nothing.
    pub unasked: u64,
}
