use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::Duration;

use fipa_acl::Text;

use super::matching::matches;
use crate::{DF_SERVICE, DfAgentDescription, Reason};

/// The registered descriptions, in the order of their registration, by agent; with an index over
/// what templates mostly ask for.
#[derive(Debug, Default)]
pub(super) struct Store {
    entries: BTreeMap<u64, Entry>,
    ids: HashMap<Text, u64>,
    index: HashMap<Key, BTreeSet<u64>>,
    leases: BTreeSet<(Duration, u64)>,
    next: u64,
}

#[derive(Debug)]
struct Entry {
    agent: Text,
    description: DfAgentDescription,
    expires: Option<Duration>,
}

/// A value by which descriptions are found, in lower case.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Key {
    ServiceType(String),
    ServiceName(String),
    Ontology(String),
}

impl Store {
    /// Stores a new description of an agent, until the lease expires.
    pub(super) fn insert(
        &mut self,
        agent: Text,
        description: DfAgentDescription,
        expires: Option<Duration>,
    ) -> Result<(), Reason> {
        if self.ids.contains_key(&agent) {
            return Err(Reason::AlreadyRegistered);
        }
        let id = self.next;
        self.next += 1;
        self.ids.insert(agent.clone(), id);
        self.put(
            id,
            Entry {
                agent,
                description,
                expires,
            },
        );
        Ok(())
    }

    /// Puts another description in the place of the one that is known, and tells that.
    pub(super) fn replace(
        &mut self,
        agent: &str,
        description: DfAgentDescription,
        expires: Option<Duration>,
    ) -> Result<DfAgentDescription, Reason> {
        let id = *self.ids.get(agent).ok_or(Reason::NotRegistered)?;
        let old = self.take(id).ok_or(Reason::NotRegistered)?;
        self.put(
            id,
            Entry {
                agent: old.agent,
                description,
                expires,
            },
        );
        Ok(old.description)
    }

    /// Takes the description of an agent away.
    pub(super) fn remove(&mut self, agent: &str) -> Option<DfAgentDescription> {
        let id = self.ids.remove(agent)?;
        self.take(id).map(|entry| entry.description)
    }

    /// Takes away one whose lease has expired.
    pub(super) fn expire(&mut self, now: Duration) -> Option<DfAgentDescription> {
        let (expires, id) = *self.leases.first()?;
        if expires > now {
            return None;
        }
        let agent = self.entries.get(&id)?.agent.clone();
        self.remove(&agent)
    }

    pub(super) fn next_expiry(&self) -> Option<Duration> {
        self.leases.first().map(|(expires, _)| *expires)
    }

    pub(super) fn contains(&self, agent: &str) -> bool {
        self.ids.contains_key(agent)
    }

    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    /// The descriptions that match, in the order of their registration.
    pub(super) fn search<'a>(
        &'a self,
        template: &'a DfAgentDescription,
    ) -> Box<dyn Iterator<Item = &'a DfAgentDescription> + 'a> {
        let description = |id: &u64| self.entries.get(id).map(|entry| &entry.description);
        let is_match = |there: &&DfAgentDescription| matches(template, there);
        if let Some(agent) = &template.name {
            let id = self.ids.get(&agent.name).into_iter();
            return Box::new(id.filter_map(description).filter(is_match));
        }
        // The rarest of the template's values decides how many are looked at.
        let sets = keys_of(template).map(|key| self.index.get(&key));
        match sets.min_by_key(|ids| ids.map_or(0, BTreeSet::len)) {
            Some(ids) => {
                let ids = ids.into_iter().flatten();
                Box::new(ids.filter_map(description).filter(is_match))
            }
            None => {
                let all = self.entries.values().map(|entry| &entry.description);
                Box::new(all.filter(is_match))
            }
        }
    }

    /// The descriptions of DFs.
    pub(super) fn facilitators(&self) -> impl Iterator<Item = &DfAgentDescription> {
        let ids = self.index.get(&Key::ServiceType(DF_SERVICE.to_owned()));
        let entries = ids
            .into_iter()
            .flatten()
            .filter_map(|id| self.entries.get(id));
        entries.map(|entry| &entry.description)
    }

    fn put(&mut self, id: u64, entry: Entry) {
        for key in keys_of(&entry.description) {
            self.index.entry(key).or_default().insert(id);
        }
        if let Some(expires) = entry.expires {
            self.leases.insert((expires, id));
        }
        self.entries.insert(id, entry);
    }

    fn take(&mut self, id: u64) -> Option<Entry> {
        let entry = self.entries.remove(&id)?;
        for key in keys_of(&entry.description) {
            if let Some(ids) = self.index.get_mut(&key) {
                ids.remove(&id);
                if ids.is_empty() {
                    self.index.remove(&key);
                }
            }
        }
        if let Some(expires) = entry.expires {
            self.leases.remove(&(expires, id));
        }
        Some(entry)
    }
}

fn keys_of(description: &DfAgentDescription) -> impl Iterator<Item = Key> {
    let services = description.services.iter();
    let types = services.clone().filter_map(|service| service.kind.as_ref());
    let names = services.filter_map(|service| service.name.as_ref());
    types
        .map(|kind| Key::ServiceType(kind.to_ascii_lowercase()))
        .chain(names.map(|name| Key::ServiceName(name.to_ascii_lowercase())))
        .chain(
            description
                .ontologies
                .iter()
                .map(|name| Key::Ontology(name.to_ascii_lowercase())),
        )
}
