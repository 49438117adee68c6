//! The other daemons, as told by the announcements heard so far.
use std::collections::{HashMap, HashSet};
use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

use fipa_directory::InstanceId;

use super::heard::Heard;
use super::txt;
use crate::{DiscoveredPeer, DiscoveryEvent};

/// How long an address outlives the announcement that no longer holds it. Address records come and
/// go one family and one interface at a time; a stale address costs a failed connection, a missing
/// one costs the peer. This is the lifetime of an address record.
const ADDRESS_GRACE: Duration = Duration::from_secs(120);

/// All other daemons of our scope.
///
/// They are known by the id in their announcement. The instance name of mDNS serves only to tell
/// whom the report of a removal means.
#[derive(Debug)]
pub(super) struct Peers {
    own: InstanceId,
    scope: String,
    by_fullname: HashMap<String, InstanceId>,
    peers: HashMap<InstanceId, Peer>,
    /// Instance names not heard again since the search was begun anew.
    unconfirmed: HashSet<String>,
    /// Instance names of whom a version we do not understand was reported.
    incomprehensible: HashSet<String>,
}

#[derive(Debug, Default)]
struct Peer {
    name: String,
    quic: Option<u16>,
    /// The addresses, with the time since when the announcements lack them.
    addresses: HashMap<SocketAddr, Option<Instant>>,
    reported: Option<DiscoveredPeer>,
}

impl Peers {
    /// Nobody yet.
    pub(super) fn new(own: InstanceId, scope: String) -> Peers {
        Peers {
            own,
            scope,
            by_fullname: HashMap::new(),
            peers: HashMap::new(),
            unconfirmed: HashSet::new(),
            incomprehensible: HashSet::new(),
        }
    }

    /// Takes in an announcement; tells what is new in it.
    pub(super) fn heard(&mut self, heard: Heard, now: Instant) -> Vec<DiscoveryEvent> {
        let Some(id) = heard.id.as_ref().and_then(|id| id.parse().ok()) else {
            // The TXT record may still be on its way.
            return Vec::new();
        };
        if id == self.own || heard.scope != self.scope {
            return Vec::new();
        }
        if heard.version != txt::CURRENT_VERSION {
            return self.not_understood(&heard);
        }
        let mut events = Vec::new();
        if self
            .by_fullname
            .get(&heard.fullname)
            .is_some_and(|known| *known != id)
        {
            events.extend(self.removed(&heard.fullname));
        }
        self.unconfirmed.remove(&heard.fullname);
        self.by_fullname.insert(heard.fullname, id);
        let peer = self.peers.entry(id).or_default();
        peer.name = heard.name;
        peer.quic = heard.quic.filter(|port| *port != 0);
        peer.merge(&heard.addresses, now);
        events.extend(peer.report(id));
        events
    }

    /// Takes in the removal of an instance name; tells if that means the loss of a peer.
    pub(super) fn removed(&mut self, fullname: &str) -> Option<DiscoveryEvent> {
        self.unconfirmed.remove(fullname);
        self.incomprehensible.remove(fullname);
        let id = self.by_fullname.remove(fullname)?;
        if self.by_fullname.values().any(|other| *other == id) {
            return None;
        }
        // One who was never reported, for want of an address, need not be reported lost.
        self.peers
            .remove(&id)?
            .reported
            .map(|_| DiscoveryEvent::Lost(id))
    }

    /// The instance names of this peer.
    pub(super) fn fullnames(&self, instance: InstanceId) -> impl Iterator<Item = &str> {
        let own = self
            .by_fullname
            .iter()
            .filter(move |(_, id)| **id == instance);
        own.map(|(fullname, _)| fullname.as_str())
    }

    /// From now on everybody is in doubt until heard again: removals may have been missed.
    pub(super) fn doubt_all(&mut self) {
        self.unconfirmed = self.by_fullname.keys().cloned().collect();
    }

    /// Gives up those who are still in doubt.
    pub(super) fn drop_doubtful(&mut self) -> Vec<DiscoveryEvent> {
        let doubtful = std::mem::take(&mut self.unconfirmed);
        doubtful
            .iter()
            .filter_map(|fullname| self.removed(fullname))
            .collect()
    }

    fn not_understood(&mut self, heard: &Heard) -> Vec<DiscoveryEvent> {
        if !self.incomprehensible.insert(heard.fullname.clone()) {
            return Vec::new();
        }
        let (name, version) = (&heard.name, &heard.version);
        let text = format!("daemon `{name}` is ignored: its announcement has version `{version}`");
        vec![DiscoveryEvent::Warning(text)]
    }
}

impl Peer {
    fn merge(&mut self, heard: &[SocketAddr], now: Instant) {
        for since in self.addresses.values_mut() {
            since.get_or_insert(now);
        }
        self.addresses
            .extend(heard.iter().map(|address| (*address, None)));
        let ports: HashSet<u16> = heard.iter().map(SocketAddr::port).collect();
        self.addresses.retain(|address, since| {
            let expired = since.is_some_and(|since| now - since >= ADDRESS_GRACE);
            // A socket moved to another port is gone at once.
            !expired && (ports.is_empty() || ports.contains(&address.port()))
        });
    }

    /// The report of this peer, if it differs from the one before and leads somewhere.
    fn report(&mut self, instance: InstanceId) -> Option<DiscoveryEvent> {
        let mut addresses: Vec<_> = self.addresses.keys().copied().collect();
        addresses.sort_by_key(|address| (rank(address), *address));
        let peer = DiscoveredPeer {
            instance,
            name: self.name.clone(),
            addresses,
            quic: self.quic,
        };
        if peer.addresses.is_empty() || self.reported.as_ref() == Some(&peer) {
            return None;
        }
        self.reported = Some(peer.clone());
        Some(DiscoveryEvent::Found(peer))
    }
}

/// Which addresses are to be tried first: the lowest.
fn rank(address: &SocketAddr) -> u8 {
    match address.ip() {
        IpAddr::V4(ip) if ip.is_loopback() => 0,
        IpAddr::V6(ip) if ip.is_loopback() => 1,
        IpAddr::V4(ip) if !ip.is_link_local() => 2,
        IpAddr::V4(_) => 3,
        IpAddr::V6(ip) if !ip.is_unicast_link_local() => 4,
        IpAddr::V6(_) => 5,
    }
}

#[cfg(test)]
mod tests;
