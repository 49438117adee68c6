use std::time::Duration;

use fipa_acl::Text;

use crate::InstanceId;

/// The signature type of a location that takes letters in the way of `fipa_services`, and the
/// service type of the agents there.
pub const MESSAGE_TRANSPORT: &str = "fipa::services::transports::MessageTransport";

/// A service directory entry (FIPA SC00001L): an agent and where its letters go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The agent's name.
    pub name: Text,
    /// The service type.
    pub kind: Text,
    /// Its locator: where letters for it go, in the order in which they should be tried.
    pub locations: Vec<Location>,
    /// Free text for people.
    pub description: Text,
    /// When it was registered, in milliseconds since 1970-01-01T00:00:00Z.
    pub timestamp: i64,
}

impl Entry {
    /// An entry of the usual service type with nothing but a name.
    pub fn new(name: impl Into<Text>) -> Entry {
        Entry {
            name: name.into(),
            kind: Text::from_static(MESSAGE_TRANSPORT),
            locations: Vec::new(),
            description: Text::default(),
            timestamp: 0,
        }
    }
}

/// One place where letters for an agent go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// A transport address (URL).
    pub address: Text,
    /// What is spoken there.
    pub signature: Text,
}

/// How an entry came to be known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The agent is registered here.
    Local,
    /// From a platform that was found by mDNS.
    Mdns,
    /// From a platform that was given as a peer, or that called us.
    Peer,
    /// From the AMS of another platform.
    Ams,
}

impl Source {
    /// The word that people and programs are shown.
    pub fn as_str(self) -> &'static str {
        match self {
            Source::Local => "local",
            Source::Mdns => "mdns",
            Source::Peer => "peer",
            Source::Ams => "ams",
        }
    }
}

/// How sure it is that an entry still holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// Its platform is heard.
    Alive,
    /// Its platform has not been heard for a while; letters are still tried.
    Suspect,
    /// Its platform is gone.
    Gone,
}

impl State {
    /// The word that people and programs are shown.
    pub fn as_str(self) -> &'static str {
        match self {
            State::Alive => "alive",
            State::Suspect => "suspect",
            State::Gone => "gone",
        }
    }
}

/// An entry with what the directory knows about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// The entry.
    pub entry: Entry,
    /// The message transport service that vouches for it. An agent of another make has none: its
    /// owner is an id made from its name, which begins with eight octets of zero.
    pub owner: InstanceId,
    /// How it came to be known.
    pub source: Source,
    /// How sure it is.
    pub state: State,
    /// When it came to be known, on the clock of [`Now::mono`](crate::Now::mono); of one that is
    /// [`State::Gone`], when it went.
    pub since: Duration,
}
