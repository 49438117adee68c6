use bytes::Bytes;

use crate::{AgentId, FipaTime, Text};

/// How a payload is represented (SC00067F `acl-representation`).
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Representation {
    /// `fipa.acl.rep.bitefficient.std` (SC00069G).
    BitEfficient,
    /// `fipa.acl.rep.string.std` (SC00070I).
    String,
    /// `fipa.acl.rep.xml.std` (SC00071E).
    Xml,
    /// Another name, kept as it came.
    Other(Text),
}

impl Representation {
    /// The component name that stands in an envelope.
    pub fn as_str(&self) -> &str {
        match self {
            Representation::BitEfficient => "fipa.acl.rep.bitefficient.std",
            Representation::String => "fipa.acl.rep.string.std",
            Representation::Xml => "fipa.acl.rep.xml.std",
            Representation::Other(name) => name,
        }
    }
}

impl From<Text> for Representation {
    fn from(name: Text) -> Representation {
        [
            Representation::BitEfficient,
            Representation::String,
            Representation::Xml,
        ]
        .into_iter()
        .find(|known| known.as_str().eq_ignore_ascii_case(&name))
        .unwrap_or(Representation::Other(name))
    }
}

/// A stamp (received-object): which message transport service took the letter in, and when.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Received {
    /// The service that stamps; an opaque text.
    pub by: Text,
    /// Where the letter came from.
    pub from: Option<Text>,
    /// When it was taken in.
    pub date: FipaTime,
    /// The stamp's number within the service.
    pub id: Option<Text>,
    /// The transport protocol by which it came.
    pub via: Option<Text>,
    /// Parameters outside the standard: name without `X-`, value.
    pub user_defined: Vec<(Text, Text)>,
}

/// The slots of one layer of an envelope: its base or one overlay (SC00067F section 4).
///
/// An absent slot is `None` or an empty list.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Slots {
    /// Primary receivers.
    pub to: Vec<AgentId>,
    /// The sending agent; notices of failure go to it.
    pub from: Option<AgentId>,
    /// For the final receiver.
    pub comments: Option<Text>,
    /// How the payload is represented.
    pub acl_representation: Option<Representation>,
    /// Octets of the payload.
    pub payload_length: Option<u64>,
    /// Charset of the payload.
    pub payload_encoding: Option<Text>,
    /// When the letter was made.
    pub date: Option<FipaTime>,
    /// Where this instance of the letter goes.
    pub intended_receiver: Vec<AgentId>,
    /// The stamp.
    pub received: Option<Received>,
    /// Reserved by the standard.
    pub transport_behaviour: Option<Bytes>,
    /// Parameters outside the standard: name without `X-`, value.
    pub user_defined: Vec<(Text, Text)>,
}

/// An envelope: a base that the sender wrote, and overlays that transport services added.
///
/// Nothing in a layer is ever changed; what an overlay holds wins over what is below it. The
/// methods give that flattened view.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Envelope {
    /// What the sender wrote.
    pub base: Slots,
    /// What was added on the way, in the order of travel: the newest is last.
    pub overlays: Vec<Slots>,
}

impl Envelope {
    /// An envelope with this base and no overlay.
    pub fn new(base: Slots) -> Envelope {
        Envelope {
            base,
            overlays: Vec::new(),
        }
    }

    /// Empties every slot. The lists of receivers keep their memory, for the next envelope that is
    /// read into this one.
    pub fn clear(&mut self) {
        let mut base = std::mem::take(&mut self.base);
        base.to.clear();
        base.intended_receiver.clear();
        self.base.to = base.to;
        self.base.intended_receiver = base.intended_receiver;
        self.overlays.clear();
    }

    /// The layers, newest first.
    pub fn layers(&self) -> impl DoubleEndedIterator<Item = &Slots> {
        std::iter::once(&self.base).chain(&self.overlays).rev()
    }

    /// The primary receivers.
    pub fn to(&self) -> &[AgentId] {
        self.list(|slots| &slots.to)
    }

    /// The sending agent.
    pub fn from(&self) -> Option<&AgentId> {
        self.layers().find_map(|slots| slots.from.as_ref())
    }

    /// Where this instance goes: the newest `intended-receiver`, else `to` (SC00067F section 4).
    pub fn intended_receiver(&self) -> &[AgentId] {
        match self.list(|slots| &slots.intended_receiver) {
            [] => self.to(),
            given => given,
        }
    }

    /// How the payload is represented.
    pub fn acl_representation(&self) -> Option<&Representation> {
        self.layers()
            .find_map(|slots| slots.acl_representation.as_ref())
    }

    /// Octets of the payload, as announced.
    pub fn payload_length(&self) -> Option<u64> {
        self.layers().find_map(|slots| slots.payload_length)
    }

    /// Charset of the payload.
    pub fn payload_encoding(&self) -> Option<&Text> {
        self.layers()
            .find_map(|slots| slots.payload_encoding.as_ref())
    }

    /// When the letter was made.
    pub fn date(&self) -> Option<FipaTime> {
        self.layers().find_map(|slots| slots.date)
    }

    /// The stamps in the order in which the letter travelled.
    pub fn stamps(&self) -> impl Iterator<Item = &Received> {
        self.layers()
            .rev()
            .filter_map(|slots| slots.received.as_ref())
    }

    /// The latest value of every slot, as one layer. Stamps are left out: see
    /// [`stamps`](Self::stamps).
    pub fn flattened(&self) -> Slots {
        let mut user_defined: Vec<(Text, Text)> = Vec::new();
        for (name, value) in self.layers().flat_map(|slots| &slots.user_defined) {
            if !user_defined.iter().any(|(known, _)| known == name) {
                user_defined.push((name.clone(), value.clone()));
            }
        }
        Slots {
            to: self.to().to_vec(),
            from: self.from().cloned(),
            comments: self.layers().find_map(|s| s.comments.clone()),
            acl_representation: self.acl_representation().cloned(),
            payload_length: self.payload_length(),
            payload_encoding: self.payload_encoding().cloned(),
            date: self.date(),
            intended_receiver: self.list(|slots| &slots.intended_receiver).to_vec(),
            received: None,
            transport_behaviour: self.layers().find_map(|s| s.transport_behaviour.clone()),
            user_defined,
        }
    }

    fn list(&self, slot: impl Fn(&Slots) -> &Vec<AgentId>) -> &[AgentId] {
        self.layers()
            .map(slot)
            .find(|list| !list.is_empty())
            .map_or(&[], Vec::as_slice)
    }
}

/// A letter: an envelope with its payload, an encoded message that nobody on the way opens.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Letter {
    /// The envelope.
    pub envelope: Envelope,
    /// The encoded message.
    pub payload: Bytes,
}
