//! The parameters of SYS packets: tag, length and value.

use crate::{Address, Buffer, Check, Mask, PacketType};

/// What a SYS packet is for: its subtype.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Subtype {
    /// PKGCNF, what became of a packet.
    Confirmation = 1,
    /// INCON, the wish to connect.
    Initialize = 2,
    /// ACCON, the consent.
    Accept = 3,
    /// REFCON, the refusal, or the removal of an employee.
    Refuse = 4,
    /// RECON, another position in the hierarchy.
    Reinitialize = 5,
    /// EMPTRF, an employee passes over to another employer.
    EmployeeTransfer = 6,
    /// WKGTRF, a workgroup passes over.
    WorkgroupTransfer = 7,
    /// EMPREQ, an employee is asked for.
    EmployeeRequest = 8,
    /// WKGREQ, a workgroup is asked for.
    WorkgroupRequest = 9,
}

impl Subtype {
    const ALL: [Subtype; 9] = [
        Subtype::Confirmation,
        Subtype::Initialize,
        Subtype::Accept,
        Subtype::Refuse,
        Subtype::Reinitialize,
        Subtype::EmployeeTransfer,
        Subtype::WorkgroupTransfer,
        Subtype::EmployeeRequest,
        Subtype::WorkgroupRequest,
    ];

    /// The subtype with this number.
    pub fn new(number: u8) -> Option<Subtype> {
        let known = Self::ALL.into_iter();
        known.into_iter().find(|known| *known as u8 == number)
    }
}

/// What became of a packet, or of a wish to connect (tag 9).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Outcome(pub u8);

impl Outcome {
    /// Whole, allowed, taken over.
    pub const ACCEPTED: Outcome = Outcome(0);
    /// Refused.
    pub const REFUSED: Outcome = Outcome(1);
    /// The check is wrong; never sent, since such a packet cannot be answered.
    pub const CHECKSUM: Outcome = Outcome(2);
    /// A fragment is missing.
    pub const INCOMPLETE: Outcome = Outcome(3);
    /// The hierarchy or a right forbids it.
    pub const NOT_PERMITTED: Outcome = Outcome(4);
    /// There is no such target, semaphore, region or barrier.
    pub const NO_SUCH_TARGET: Outcome = Outcome(5);
    /// A type, a check or an ability that is not there.
    pub const UNSUPPORTED: Outcome = Outcome(6);
    /// The data does not have the form of its type.
    pub const MALFORMED: Outcome = Outcome(7);
    /// Longer than the next partner takes.
    pub const TOO_LONG: Outcome = Outcome(8);
}

impl core::fmt::Display for Outcome {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match *self {
            Outcome::ACCEPTED => "accepted",
            Outcome::REFUSED => "refused",
            Outcome::CHECKSUM => "the checksum was wrong",
            Outcome::INCOMPLETE => "a part of it was missing",
            Outcome::NOT_PERMITTED => "not permitted in the hierarchy",
            Outcome::NO_SUCH_TARGET => "there is no such target or object",
            Outcome::UNSUPPORTED => "not supported there",
            Outcome::MALFORMED => "malformed",
            Outcome::TOO_LONG => "too long",
            Outcome(other) => return write!(f, "result {other}"),
        })
    }
}

/// Which checks a station can (tag 5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checks(pub u8);

impl Checks {
    /// The sum alone.
    pub const SUM: Checks = Checks(1);
    /// CRC-32 alone.
    pub const CRC32: Checks = Checks(2);
    /// Both.
    pub const BOTH: Checks = Checks(3);

    /// Whether this check is among them.
    pub const fn has(self, check: Check) -> bool {
        let bit = match check {
            Check::Sum => 1,
            Check::Crc32 => 2,
        };
        self.0 & bit != 0
    }

    /// The best check among both: CRC-32 before the sum.
    pub const fn common(self, other: Checks) -> Option<Check> {
        let both = Checks(self.0 & other.0);
        if both.has(Check::Crc32) {
            Some(Check::Crc32)
        } else if both.has(Check::Sum) {
            Some(Check::Sum)
        } else {
            None
        }
    }
}

/// Which packet types a station understands (tag 6): a bit for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Types(pub u16);

impl Types {
    /// All that have a meaning.
    pub const ALL: Types = Types(0x413E);

    /// Whether this type is among them.
    pub const fn has(self, kind: PacketType) -> bool {
        self.0 & 1 << kind.number() != 0
    }
}

/// Tag 12: MP and CR.
pub const NUMBERS: u8 = 1;
/// Tag 12: fragments.
pub const FRAGMENTS: u8 = 2;

/// Tag 7: the sender is the employer.
pub const EMPLOYER: u8 = 0;
/// Tag 7: the sender is a colleague.
pub const COLLEAGUE: u8 = 1;
/// Tag 7: the sender is an employee.
pub const EMPLOYEE: u8 = 2;

/// The parameters of a SYS packet; absent ones are `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parameters<'a> {
    /// Tag 1.
    pub address: Option<Address>,
    /// Tag 2.
    pub mask: Option<Mask>,
    /// Tag 3, the longest silence in milliseconds.
    pub period: Option<u16>,
    /// Tag 4, the octets of the largest packet.
    pub largest: Option<u32>,
    /// Tag 5.
    pub checks: Option<Checks>,
    /// Tag 6.
    pub types: Option<Types>,
    /// Tag 7, the role that the sender takes.
    pub role: Option<u8>,
    /// Tag 8, the number of the packet that is confirmed.
    pub psn: Option<u8>,
    /// Tag 9.
    pub result: Option<Outcome>,
    /// Tag 10.
    pub name: Option<&'a str>,
    /// Tag 11.
    pub reason: Option<&'a str>,
    /// Tag 12, [`NUMBERS`] and [`FRAGMENTS`].
    pub abilities: Option<u8>,
    /// Tag 13, the new employer.
    pub employer: Option<Address>,
    /// Tag 14, where to reach it.
    pub place: Option<&'a str>,
    /// Tag 15, addresses of four octets each.
    pub members: Option<&'a [u8]>,
}

/// Parameters that break off, or a value that has not the form of its tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParametersError;

impl core::fmt::Display for ParametersError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("a parameter breaks off or has not the form of its tag")
    }
}

impl core::error::Error for ParametersError {}

impl<'a> Parameters<'a> {
    /// Reads them in any order, the first of each tag; unknown ones are ignored.
    ///
    /// # Errors
    /// If they break off, or a value has not the form of its tag.
    pub fn decode(mut octets: &'a [u8]) -> Result<Parameters<'a>, ParametersError> {
        let mut read = Parameters::default();
        let mut seen = 0_u16;
        while let [tag, length, rest @ ..] = octets {
            let length = usize::from(*length);
            let (value, behind) = rest.split_at_checked(length).ok_or(ParametersError)?;
            octets = behind;
            if *tag < 16 && seen & 1 << tag == 0 {
                seen |= 1 << tag;
                read.take(*tag, value).ok_or(ParametersError)?;
            }
        }
        match octets {
            [] => Ok(read),
            _ => Err(ParametersError),
        }
    }

    fn take(&mut self, tag: u8, value: &'a [u8]) -> Option<()> {
        let one = || match value {
            [octet] => Some(*octet),
            _ => None,
        };
        let two = || Some(u16::from_be_bytes(value.try_into().ok()?));
        let four = || Some(u32::from_be_bytes(value.try_into().ok()?));
        let text = || core::str::from_utf8(value).ok();
        match tag {
            1 => self.address = Some(Address(four()?)),
            2 => self.mask = Some(Mask::new(four()?).ok()?),
            3 => self.period = Some(two()?),
            4 => self.largest = Some(four()?),
            5 => self.checks = Some(Checks(one()?)),
            6 => self.types = Some(Types(two()?)),
            7 => self.role = Some(one()?),
            8 => self.psn = Some(one()?),
            9 => self.result = Some(Outcome(one()?)),
            10 => self.name = Some(text()?),
            11 => self.reason = Some(text()?),
            12 => self.abilities = Some(one()?),
            13 => self.employer = Some(Address(four()?)),
            14 => self.place = Some(text()?),
            15 => self.members = Some(value).filter(|value| value.len().is_multiple_of(4)),
            _ => {}
        }
        (tag != 15 || self.members.is_some()).then_some(())
    }

    /// Writes those that are there, by ascending tags. Whether there was room, and no value was
    /// longer than 255 octets.
    #[must_use]
    pub fn encode(&self, to: &mut impl Buffer) -> bool {
        let mut put = |tag: u8, value: Option<&[u8]>| match value {
            None => true,
            Some(value) => {
                let Ok(length) = u8::try_from(value.len()) else {
                    return false;
                };
                let head = [tag, length];
                let mut octets = head.iter().chain(value);
                octets.all(|octet| to.push(*octet))
            }
        };
        put(1, self.address.map(Address::octets).as_ref().map(slice))
            && put(2, self.mask.map(mask_octets).as_ref().map(slice))
            && put(3, self.period.map(u16::to_be_bytes).as_ref().map(slice))
            && put(4, self.largest.map(u32::to_be_bytes).as_ref().map(slice))
            && put(5, self.checks.map(|checks| [checks.0]).as_ref().map(slice))
            && put(6, self.types.map(|t| t.0.to_be_bytes()).as_ref().map(slice))
            && put(7, self.role.map(|role| [role]).as_ref().map(slice))
            && put(8, self.psn.map(|psn| [psn]).as_ref().map(slice))
            && put(9, self.result.map(|result| [result.0]).as_ref().map(slice))
            && put(10, self.name.map(str::as_bytes))
            && put(11, self.reason.map(str::as_bytes))
            && put(12, self.abilities.map(|able| [able]).as_ref().map(slice))
            && put(13, self.employer.map(Address::octets).as_ref().map(slice))
            && put(14, self.place.map(str::as_bytes))
            && put(15, self.members)
    }

    /// The members, if there are any.
    pub fn members(&self) -> impl Iterator<Item = Address> + 'a {
        let (members, _) = self.members.unwrap_or_default().as_chunks::<4>();
        members.iter().map(|member| Address::from_octets(*member))
    }
}

fn slice<const N: usize>(octets: &[u8; N]) -> &[u8] {
    octets
}

fn mask_octets(mask: Mask) -> [u8; 4] {
    Address(mask.bits()).octets()
}
