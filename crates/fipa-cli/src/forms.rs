//! The representations as the commands name them, and what is read and written in them.
//!
//! Reading takes a position in the whole input, so that errors name octets of it.

mod layers;
mod reading;
mod writing;

use clap::ValueEnum;
use fipa_acl::Representation;
use fipa_codec::EnvelopeRepresentation;
use fipa_codec::bit_efficient::{CodeTable, InvalidTableSize};

pub use reading::{Decoder, Expected, Item, behind_blanks};
pub use writing::Encoder;

/// A representation of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Rep {
    /// SC00069G
    BitEfficient,
    /// SC00071E
    Xml,
    /// SC00070I
    String,
}

/// A representation of envelopes; there is none as a string.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EnvelopeRep {
    /// SC00088D
    BitEfficient,
    /// SC00085J
    Xml,
}

impl From<Rep> for Representation {
    fn from(rep: Rep) -> Representation {
        match rep {
            Rep::BitEfficient => Representation::BitEfficient,
            Rep::String => Representation::String,
            Rep::Xml => Representation::Xml,
        }
    }
}

impl From<EnvelopeRep> for EnvelopeRepresentation {
    fn from(rep: EnvelopeRep) -> EnvelopeRepresentation {
        match rep {
            EnvelopeRep::BitEfficient => EnvelopeRepresentation::BitEfficient,
            EnvelopeRep::Xml => EnvelopeRepresentation::Xml,
        }
    }
}

/// The option for a code table.
#[derive(Clone, Debug, clap::Args)]
pub struct TableArgs {
    /// Keep one code table of so many entries over all bit-efficient messages
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(256..=65_536))]
    code_table: Option<u32>,
}

impl TableArgs {
    /// The table, empty, if one is wanted.
    ///
    /// # Errors
    /// No table can have so many entries.
    pub fn table(&self) -> Result<Option<CodeTable>, InvalidTableSize> {
        self.code_table
            .map(|entries| CodeTable::new(usize::try_from(entries).unwrap_or(usize::MAX)))
            .transpose()
    }
}
