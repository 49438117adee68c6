//! The representations: the one place that says which codec reads and writes which of them.
//!
//! Reading takes a position in the whole input, so that errors name octets of it.

mod reading;
mod writing;

use clap::ValueEnum;
use fipa_acl::{Envelope, Representation, Slots};
use fipa_codec::Form;

pub use reading::{Expected, Item, decode_next, decode_payload};
pub use writing::{encode_letter, encode_message};

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

impl Rep {
    /// The representation of this name; `None` for one that nobody here knows.
    pub fn of(name: &Representation) -> Option<Rep> {
        match name {
            Representation::BitEfficient => Some(Rep::BitEfficient),
            Representation::String => Some(Rep::String),
            Representation::Xml => Some(Rep::Xml),
            Representation::Other(_) => None,
        }
    }

    /// The representation of the message that these octets begin with, or look like.
    fn detected(octets: &[u8]) -> Option<Rep> {
        match fipa_codec::detect(octets) {
            Form::BitEfficientMessage => Some(Rep::BitEfficient),
            Form::Xml => Some(Rep::Xml),
            Form::String => Some(Rep::String),
            Form::BitEfficientEnvelope | Form::Unknown => None,
        }
    }
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

/// The layers of an envelope in the order in which its representation writes them.
pub fn layers_on_the_wire(envelope: &Envelope, rep: EnvelopeRep) -> impl Iterator<Item = &Slots> {
    match rep {
        // The newest overlay is in front. Nobody reads the other representation yet.
        EnvelopeRep::BitEfficient | EnvelopeRep::Xml => envelope.layers(),
    }
}

/// Layers in the order in which they stand on the wire, as an envelope.
fn envelope_of_layers(mut layers: Vec<Slots>, rep: EnvelopeRep) -> Envelope {
    match rep {
        // The base is last, and in front of it are the overlays, the newest first.
        EnvelopeRep::BitEfficient | EnvelopeRep::Xml => {
            let base = layers.pop().unwrap_or_default();
            layers.reverse();
            Envelope {
                base,
                overlays: layers,
            }
        }
    }
}

const XML: &str = "the xml representation is not supported yet";
const STRING: &str = "the string representation is not supported yet";
