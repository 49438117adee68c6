//! Agents of other makes: found by mDNS or listed by the AMS of their platform, without a message
//! transport service of ours.

use fipa_acl::Text;
use fipa_directory::{Address, Entry, InstanceId, Now, Record, Source};
use fipa_link::Outcome;

use super::Mts;
use crate::machine::{Announced, Output};

/// An agent of another make.
#[derive(Debug)]
pub(super) struct Neighbour {
    pub(super) entry: Entry,
    /// The platform whose AMS lists it; otherwise it was found by mDNS.
    pub(super) platform: Option<Text>,
    /// The network was asked whether it is still there, and has not answered yet.
    asked: bool,
}

impl Neighbour {
    /// An agent that the AMS of a platform lists.
    pub(super) fn listed(entry: Entry, platform: Text) -> Neighbour {
        Neighbour {
            entry,
            platform: Some(platform),
            asked: false,
        }
    }

    fn source(&self) -> Source {
        match self.platform {
            Some(_) => Source::Ams,
            None => Source::Mdns,
        }
    }
}

/// Who vouches for an agent of another make: nobody that could be asked. The id begins with eight
/// octets of zero, which no id that was drawn at random does, and ends with the FNV-1a hash of the
/// name.
pub(super) fn owner_of(name: &str) -> InstanceId {
    let hash = name
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325, |hash: u64, octet| {
            (hash ^ u64::from(octet)).wrapping_mul(0x0100_0000_01b3)
        });
    InstanceId::from_bytes(u128::from(hash).to_be_bytes())
}

impl Mts {
    /// mDNS has found an agent of another make, or heard something new of it: an entry that bears
    /// no id of a service of ours. A service of ours brings its entries over its link, and is told
    /// of by [`discovered`](Self::discovered).
    ///
    /// What is said to be at one of our own endpoints is passed over: it is an echo of ourselves.
    /// What a link brings from the same address is the same agent, and the link's entry stays. An
    /// agent elsewhere under a name that is known is a [conflict](fipa_directory::ChangeKind), and
    /// both entries stay.
    pub fn neighbour_found(&mut self, now: Now, entry: Entry) {
        let own = |address: Address| self.config.endpoints.contains(&address);
        if self.closing || addresses_of(&entry).any(own) || !self.is_neighbour_admitted(&entry) {
            return;
        }
        let name = entry.name.clone();
        let neighbour = Neighbour {
            entry,
            platform: None,
            asked: false,
        };
        self.neighbours.insert(name.clone(), neighbour);
        self.show_neighbour(now, &name);
        self.publish_changes(now);
    }

    /// mDNS does not know the agent any more. Letters that wait for it fail.
    pub fn neighbour_gone(&mut self, now: Now, name: &str) {
        let known = self.neighbours.get(name);
        if known.is_some_and(|neighbour| neighbour.source() == Source::Mdns) {
            self.forget_neighbour(now, name);
        }
    }

    pub(super) fn forget_neighbour(&mut self, now: Now, name: &str) {
        if self.neighbours.remove(name).is_none() {
            return;
        }
        self.directory.remove(now, owner_of(name), name);
        for id in self.waiting_for_neighbour(name) {
            let tried = self.post_failures(id);
            let reason = format!("{name} is gone: it is not announced any more{tried}");
            self.finish(now, id, Outcome::Timeout, Text::from(reason));
        }
        self.publish_changes(now);
    }

    /// Puts a neighbour into the directory, unless it is there as somebody whom a link brought.
    pub(super) fn show_neighbour(&mut self, now: Now, name: &Text) {
        let Some(neighbour) = self.neighbours.get(name) else {
            return;
        };
        let (owner, entry) = (owner_of(name), neighbour.entry.clone());
        let source = neighbour.source();
        let known = |record: &Record| record.owner != owner && is_same(&record.entry, &entry);
        if self.directory.find_all(name).iter().any(known) {
            self.directory.remove(now, owner, name);
        } else {
            self.directory.put(now, owner, source, entry);
        }
    }

    /// A link brings this entry: the same agent is not known as a neighbour any more.
    pub(super) fn make_way_for(&mut self, now: Now, entry: &Entry) {
        let neighbour = self.neighbours.get(&entry.name);
        if neighbour.is_some_and(|neighbour| is_same(&neighbour.entry, entry)) {
            self.directory
                .remove(now, owner_of(&entry.name), &entry.name);
        }
    }

    /// A neighbour could not be reached: is it there?
    pub(super) fn doubt_neighbour(&mut self, name: &Text) {
        if let Some(neighbour) = self.neighbours.get_mut(name)
            && neighbour.source() == Source::Mdns
            && !std::mem::replace(&mut neighbour.asked, true)
        {
            let name = Announced::Agent(name.clone());
            self.outputs.push_back(Output::Verify(name));
        }
    }

    /// A neighbour was reached: the next doubt is a new one.
    pub(super) fn trust_neighbour(&mut self, name: &str) {
        if let Some(neighbour) = self.neighbours.get_mut(name) {
            neighbour.asked = false;
        }
    }

    /// The service of ours that is linked and listens where the entry says.
    pub(super) fn peer_at(&self, entry: &Entry) -> Option<InstanceId> {
        let addresses: Vec<Address> = addresses_of(entry).collect();
        let listens = |known: &[Address]| known.iter().any(|at| addresses.contains(at));
        let mut peers = self.peers.iter();
        let found = peers.find(|(_, peer)| !peer.links.is_empty() && listens(&peer.known));
        found.map(|(instance, _)| instance)
    }
}

fn addresses_of(entry: &Entry) -> impl Iterator<Item = Address> + '_ {
    let locations = entry.locations.iter();
    locations.filter_map(|location| location.address.parse().ok())
}

/// Whether two entries of one name are of one agent: letters for it go to the same place.
fn is_same(one: &Entry, other: &Entry) -> bool {
    addresses_of(one).any(|address| addresses_of(other).any(|there| there == address))
}
