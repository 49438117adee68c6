//! What a person who looks for a fault is told of us and of the others.

use fipa_acl::Text;
use fipa_directory::{Address, Now};
use fipa_link::{Facts, PeerFacts};

use super::Mts;
use super::peer::Peer;
use crate::machine::Notice;

impl Mts {
    /// What is known of this service and of others.
    pub fn facts(&self, now: Now) -> Facts {
        let peers = self.peers.iter().map(|(instance, peer)| {
            let heard = self.last_heard(peer);
            let heard = heard.map(|at| now.mono.saturating_sub(at).as_millis() as u64);
            PeerFacts {
                instance: Some(instance),
                name: peer.name.clone(),
                addresses: peer.addresses().iter().map(Address::to_text).collect(),
                announced: peer.discovered.is_some(),
                heard_millis: heard,
                error: match heard {
                    Some(_) => Text::default(),
                    None => Text::from(peer.last_error.as_str()),
                },
            }
        });
        let sought = self.seeds.iter().filter(|seed| {
            let met = seed.instance.and_then(|instance| self.peers.get(instance));
            seed.kept && !seed.myself && met.is_none()
        });
        let sought = sought.map(|seed| PeerFacts {
            instance: None,
            name: Text::default(),
            addresses: seed.addresses.iter().map(Address::to_text).collect(),
            announced: false,
            heard_millis: None,
            error: Text::from(seed.last_error.as_str()),
        });
        Facts {
            instance: self.config.instance,
            name: self.config.name.clone(),
            scope: self.config.scope.clone(),
            endpoints: self.config.endpoints.iter().map(Address::to_text).collect(),
            mdns_port: self.config.mdns_port,
            left_out: self.left_out.clone().into_iter().collect(),
            peers: peers.chain(sought).collect(),
        }
    }

    /// An agent of ours is not announced to C++ robots, which was not so before.
    pub fn not_announced(&mut self, name: Text, reason: Text) {
        if self.locals.contains_key(&name) {
            self.left_out.insert(name.clone(), reason.clone());
            self.notice(Notice::NotAnnounced { name, reason });
        }
    }

    /// An agent of ours is announced to C++ robots.
    pub fn is_announced(&mut self, name: &str) {
        self.left_out.remove(name);
    }

    fn last_heard(&self, peer: &Peer) -> Option<std::time::Duration> {
        let links = peer.links.iter().filter_map(|conn| self.conns.get(conn));
        links.map(|open| open.link.last_heard()).max()
    }
}
