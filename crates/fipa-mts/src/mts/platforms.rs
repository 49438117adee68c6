//! What the AMS and the DF of platforms need: names that are reached and not listed, and agents
//! that the AMS of another platform lists.

use fipa_acl::Text;
use fipa_directory::{Entry, InstanceId, Now, Record};

use super::Mts;
use super::neighbours::{Neighbour, owner_of};
use super::programs::Local;
use super::routing::Route;
use crate::{Mailbox, RegisterError};

/// What stands in front of the name of a platform where its management is meant (FIPA SC00023K).
const MANAGEMENT: [&str; 2] = ["ams@", "df@"];

/// The platform whose AMS or DF bears this name.
pub(super) fn managed_by(name: &str) -> Option<&str> {
    let mut prefixes = MANAGEMENT.iter();
    prefixes.find_map(|prefix| name.strip_prefix(prefix))
}

impl Mts {
    /// Gives the service itself an agent with a mailbox. It is reached by exactly its name: the
    /// directory does not list it, and no pattern matches it.
    pub fn host(&mut self, name: &Text) -> Result<(), RegisterError> {
        if !name.is_word() {
            return Err(RegisterError::Name(name.clone()));
        }
        if self.locals.contains_key(name) {
            return Err(RegisterError::Held(name.clone()));
        }
        let mailbox = Mailbox::new(self.config.mailbox_letters, self.config.queue_octets);
        self.locals.insert(name.clone(), Local::Mailbox(mailbox));
        Ok(())
    }

    /// The AMS of a platform that is none of ours lists this agent. Its own AMS and DF are reached
    /// by their names, and not listed.
    ///
    /// An agent that was found otherwise stays what it is.
    pub fn agent_listed(&mut self, now: Now, platform: &Text, entry: Entry) {
        let name = entry.name.clone();
        let owner = owner_of(&name);
        let is_other = |record: &Record| record.owner != owner;
        let known = self.neighbours.get(&name);
        let elsewhere = known.is_some_and(|known| known.platform.as_ref() != Some(platform));
        if self.closing
            || elsewhere
            || self.locals.contains_key(&name)
            || self.directory.find_all(&name).iter().any(is_other)
        {
            return;
        }
        self.neighbours
            .insert(name.clone(), Neighbour::listed(entry, platform.clone()));
        if managed_by(&name).is_none() {
            self.show_neighbour(now, &name);
        }
        self.publish_changes(now);
    }

    /// The AMS of its platform does not list the agent any more. Letters that wait for it fail.
    pub fn agent_unlisted(&mut self, now: Now, name: &str) {
        if self.lister_of(name).is_some() {
            self.forget_neighbour(now, name);
        }
    }

    /// The agents that the AMS of this platform lists.
    pub fn listed_by(&self, platform: &str) -> Vec<Text> {
        let neighbours = self.neighbours.iter();
        let listed = neighbours.filter(|(_, n)| n.platform.as_deref() == Some(platform));
        listed.map(|(name, _)| name.clone()).collect()
    }

    /// The platform whose AMS lists this agent.
    pub fn lister_of(&self, name: &str) -> Option<&Text> {
        self.neighbours.get(name)?.platform.as_ref()
    }

    /// The way to the AMS or the DF of another platform.
    pub(super) fn route_to_management(&self, name: &str) -> Option<Route> {
        let platform = managed_by(name)?;
        if self.neighbours.contains_key(name) {
            return Some(Route::Neighbour);
        }
        let mut peers = self.peers.iter();
        let found = peers.find(|(_, peer)| peer.name == platform);
        let (instance, _): (InstanceId, _) = found?;
        Some(Route::Peer(instance))
    }
}
