//! Who is where.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

use super::PLATFORM;

/// The longest name, in octets.
const MAX_NAME: usize = 64;

/// A stream, numbered by whoever opens it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StreamId(pub u64);

/// Where an agent is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// At this address, by datagrams.
    Datagram(SocketAddr),
    /// On this stream.
    Stream(StreamId),
}

/// Why an agent was not declared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DeclareError {
    /// The name is none.
    #[error("a name has 1 to {MAX_NAME} letters, digits and _ - . @, and is not {PLATFORM}")]
    Name,
    /// The name is there at another place.
    #[error("the name is declared at another place")]
    Elsewhere,
    /// No agent is known there.
    #[error("there is no agent at that address yet")]
    NoSocket,
    /// There are too many agents, or no free ports.
    #[error("there is no room for another agent")]
    Full,
}

#[derive(Clone, Debug)]
struct Agent {
    place: Place,
    /// When it is forgotten unless it is heard; `None`: it stays.
    expires: Option<Duration>,
}

/// The agents of a platform.
#[derive(Clone, Debug)]
pub(super) struct Agents {
    by_name: BTreeMap<String, Agent>,
    next_address: Option<SocketAddr>,
    lifetime: Duration,
    capacity: usize,
}

impl Agents {
    pub(super) fn new(assigned: SocketAddr, lifetime: Duration, capacity: usize) -> Agents {
        Agents {
            by_name: BTreeMap::new(),
            next_address: Some(assigned),
            lifetime,
            capacity,
        }
    }

    pub(super) fn place(&self, name: &str) -> Option<Place> {
        self.by_name.get(name).map(|agent| agent.place)
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.by_name.keys().map(String::as_str)
    }

    /// Declares an agent at the next address that nobody has.
    pub(super) fn assign(&mut self, name: &str) -> Result<SocketAddr, DeclareError> {
        if self.by_name.contains_key(name) {
            return Err(DeclareError::Elsewhere);
        }
        let taken = |address| self.is_place(Place::Datagram(address));
        let mut free = self.next_address;
        while let Some(address) = free.filter(|address| taken(*address)) {
            free = following(address);
        }
        let address = free.ok_or(DeclareError::Full)?;
        self.add(name, Place::Datagram(address), None)?;
        self.next_address = following(address);
        Ok(address)
    }

    /// Declares an agent that stays. Whether it is new.
    pub(super) fn configure(&mut self, name: &str, place: Place) -> Result<bool, DeclareError> {
        match self.by_name.get_mut(name) {
            Some(agent) if agent.place == place => {
                agent.expires = None;
                Ok(false)
            }
            Some(_) => Err(DeclareError::Elsewhere),
            None => self.add(name, place, None).map(|()| true),
        }
    }

    /// Declares an agent that spoke for the first time.
    pub(super) fn appear(
        &mut self,
        now: Duration,
        name: &str,
        place: Place,
    ) -> Result<(), DeclareError> {
        let expires = self.expiry(now, place);
        self.add(name, place, expires)
    }

    /// The socket at this address, if an agent is there.
    pub(super) fn existing(&self, address: SocketAddr) -> Option<Place> {
        Some(Place::Datagram(address)).filter(|place| self.is_place(*place))
    }

    /// Whether an agent is on the socket on which it wants to be.
    pub(super) fn check(&self, name: &str, address: SocketAddr) -> Result<(), DeclareError> {
        let wanted = self.existing(address).ok_or(DeclareError::NoSocket)?;
        match self.place(name) {
            Some(place) if place == wanted => Ok(()),
            _ => Err(DeclareError::Elsewhere),
        }
    }

    /// An agent spoke. Whether it did so at its own place.
    pub(super) fn heard(&mut self, now: Duration, name: &str, from: Place) -> bool {
        let expiry = self.expiry(now, from);
        match self.by_name.get_mut(name) {
            Some(agent) if agent.place == from => {
                agent.expires = agent.expires.and(expiry);
                true
            }
            _ => false,
        }
    }

    pub(super) fn remove_stream(&mut self, stream: StreamId) -> Vec<String> {
        self.remove(|agent| agent.place == Place::Stream(stream))
    }

    pub(super) fn next_expiry(&self) -> Option<Duration> {
        self.by_name
            .values()
            .filter_map(|agent| agent.expires)
            .min()
    }

    pub(super) fn expire(&mut self, now: Duration) -> Vec<String> {
        self.remove(|agent| agent.expires.is_some_and(|at| at <= now))
    }

    fn remove(&mut self, which: impl Fn(&Agent) -> bool) -> Vec<String> {
        let gone: Vec<String> = self
            .by_name
            .iter()
            .filter(|(_, agent)| which(agent))
            .map(|(name, _)| name.clone())
            .collect();
        for name in &gone {
            self.by_name.remove(name);
        }
        gone
    }

    fn add(
        &mut self,
        name: &str,
        place: Place,
        expires: Option<Duration>,
    ) -> Result<(), DeclareError> {
        if !is_name(name) {
            return Err(DeclareError::Name);
        }
        if self.by_name.len() >= self.capacity {
            return Err(DeclareError::Full);
        }
        self.by_name
            .insert(name.to_owned(), Agent { place, expires });
        Ok(())
    }

    fn is_place(&self, place: Place) -> bool {
        self.by_name.values().any(|agent| agent.place == place)
    }

    /// A stream tells when it ends; of a datagram's sender nothing more may ever be heard.
    fn expiry(&self, now: Duration, place: Place) -> Option<Duration> {
        match place {
            Place::Datagram(_) => Some(now + self.lifetime),
            Place::Stream(_) => None,
        }
    }
}

fn following(address: SocketAddr) -> Option<SocketAddr> {
    let port = address.port().checked_add(1)?;
    Some(SocketAddr::new(address.ip(), port))
}

/// Whether agents may be called so: 1 to 64 letters, digits and `_ - . @`, and not [`PLATFORM`].
pub fn is_name(name: &str) -> bool {
    let legal = |octet: u8| octet.is_ascii_alphanumeric() || b"_-.@".contains(&octet);
    (1..=MAX_NAME).contains(&name.len()) && name.bytes().all(legal) && name != PLATFORM
}
