//! From a [`Packet`] to its octets.

use core::fmt;

use crate::packet::{MAX_LENGTH_OCTETS, MORE, VERSION, flags};
use crate::{Address, Addressing, Check, Mask, Packet};

/// The most octets before the data: PV to LNG and the fragment octet.
const MAX_HEAD: usize = 2 + 1 + 4 + 4 + MAX_LENGTH_OCTETS + 1;

/// Why a packet cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WriteError {
    /// The priority is above 7.
    Priority,
    /// A confirmation is asked for without a number.
    Confirm,
    /// The index of the fragment is above 127.
    Fragment,
    /// It has level addresses, and the mask is not known.
    Mask,
    /// A level address has more bits than the mask.
    Address,
    /// The data is longer than LNG can say.
    Length,
}

impl fmt::Display for WriteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            WriteError::Priority => "a priority is 0 to 7",
            WriteError::Confirm => "only a numbered packet is confirmed",
            WriteError::Fragment => "the index of a fragment is 0 to 127",
            WriteError::Mask => "it has level addresses, and the mask is not known",
            WriteError::Address => "a level address has more bits than the mask",
            WriteError::Length => "its data is too long",
        })
    }
}

impl core::error::Error for WriteError {}

/// The octets of a packet from PV to CHK: its data stays where it is.
#[derive(Clone, Debug)]
pub struct Encoded<'a> {
    head: Head,
    data: &'a [u8],
    check: [u8; 4],
    check_octets: usize,
}

#[derive(Clone, Debug)]
struct Head {
    octets: [u8; MAX_HEAD],
    len: usize,
}

impl Head {
    fn put(&mut self, octets: &[u8]) {
        // There is room for the longest of each field.
        for octet in octets {
            if let Some(place) = self.octets.get_mut(self.len) {
                *place = *octet;
                self.len += 1;
            }
        }
    }

    fn octets(&self) -> &[u8] {
        &self.octets[..self.len]
    }
}

impl<'a> Encoded<'a> {
    /// The octets in three parts that follow each other.
    pub fn parts(&self) -> [&[u8]; 3] {
        let check = &self.check[self.check.len() - self.check_octets..];
        [self.head.octets(), self.data, check]
    }

    /// The octets one by one.
    pub fn octets(&self) -> impl Iterator<Item = u8> + '_ {
        self.parts().into_iter().flatten().copied()
    }

    /// How many octets there are.
    pub fn count(&self) -> usize {
        self.parts().iter().map(|part| part.len()).sum()
    }
}

impl<'a> Packet<'a> {
    /// The octets from PV to CHK; `mask` is that of the link, needed for level addresses.
    ///
    /// # Errors
    /// What a packet cannot say, see [`WriteError`].
    pub fn encode(&self, mask: Option<Mask>) -> Result<Encoded<'a>, WriteError> {
        if self.priority > 7 {
            return Err(WriteError::Priority);
        }
        if self.confirm && self.numbered.is_none() {
            return Err(WriteError::Confirm);
        }
        let mut head = Head {
            octets: [0; MAX_HEAD],
            len: 0,
        };
        head.put(&[VERSION << 4 | self.kind.number(), self.flags()]);
        if let Some(numbered) = self.numbered {
            head.put(&[numbered.psn]);
        }
        match self.addressing {
            Addressing::Full { target, source } => {
                head.put(&target.octets());
                head.put(&source.octets());
            }
            Addressing::Level { target, source } => {
                let mask = mask.ok_or(WriteError::Mask)?;
                if target.max(source) > mask.broadcast() {
                    return Err(WriteError::Address);
                }
                let spare = 4 - mask.level_octets();
                head.put(&Address(target).octets()[spare..]);
                head.put(&Address(source).octets()[spare..]);
            }
        }
        put_length(
            &mut head,
            self.data.len() + usize::from(self.numbered.is_some()),
        )?;
        if let Some(numbered) = self.numbered {
            let fragment = numbered.fragment;
            if fragment.index & MORE != 0 {
                return Err(WriteError::Fragment);
            }
            head.put(&[fragment.index | if fragment.more { MORE } else { 0 }]);
        }
        Ok(Encoded {
            check: self.check.of([head.octets(), self.data]),
            check_octets: self.check.octets(),
            data: self.data,
            head,
        })
    }

    fn flags(&self) -> u8 {
        let flag = |set: bool, flag: u8| if set { flag } else { 0 };
        self.priority << flags::PRIORITY
            | flag(self.confirm, flags::CONFIRM)
            | flag(self.numbered.is_some(), flags::NUMBERED)
            | flag(self.check == Check::Crc32, flags::CRC32)
            | flag(
                matches!(self.addressing, Addressing::Full { .. }),
                flags::FULL,
            )
    }
}

/// LNG in its shortest form.
fn put_length(head: &mut Head, length: usize) -> Result<(), WriteError> {
    let septet = |place: usize| (length >> (7 * place) & 0x7F) as u8;
    if length >> (7 * MAX_LENGTH_OCTETS) != 0 {
        return Err(WriteError::Length);
    }
    for place in (1..MAX_LENGTH_OCTETS).rev() {
        if length >> (7 * place) != 0 {
            head.put(&[septet(place) | 0x80]);
        }
    }
    head.put(&[septet(0)]);
    Ok(())
}
