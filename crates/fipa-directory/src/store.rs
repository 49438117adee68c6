use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};

use fipa_acl::Text;

use crate::{Entry, Field, InstanceId, Now, Pattern, Record, Source, State};

/// The store of entries, by name; and the queue of what changed.
///
/// Two platforms may hold the same name. Both records are kept, nothing is renamed, and the
/// clash is reported as a [`ChangeKind::Conflict`].
#[derive(Debug, Default)]
pub struct Directory {
    names: HashMap<Text, Vec<Record>>,
    owners: HashMap<InstanceId, BTreeSet<Text>>,
    changes: VecDeque<Change>,
}

/// Something that changed in a directory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// What happened.
    pub kind: ChangeKind,
    /// The record as it is now, or as it was when it went.
    pub record: Record,
}

/// What happened to a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangeKind {
    /// It is new.
    Added,
    /// Its entry or state is another than before.
    Changed,
    /// It is gone.
    Removed,
    /// A second living platform holds the same name.
    Conflict,
}

impl Directory {
    /// A directory without entries.
    pub fn new() -> Directory {
        Directory::default()
    }

    /// Puts an entry for which `owner` vouches; replaces its earlier entry of that name. Nothing
    /// is reported if nothing changed.
    pub fn put(&mut self, now: Now, owner: InstanceId, source: Source, entry: Entry) {
        let record = Record {
            entry,
            owner,
            source,
            state: State::Alive,
            since: now.mono,
        };
        self.put_record(record);
    }

    /// Puts a record as another directory holds it: with its own owner, source, state and age.
    pub fn put_record(&mut self, record: Record) {
        let name = record.entry.name.clone();
        let records = self.names.entry(name.clone()).or_default();
        if let Some(known) = records.iter_mut().find(|r| r.owner == record.owner) {
            let since = known.since;
            let same = known.entry == record.entry
                && known.source == record.source
                && known.state == record.state;
            if !same {
                *known = Record { since, ..record };
                let record = known.clone();
                self.report(ChangeKind::Changed, record);
            }
            return;
        }
        let clash = record.state == State::Alive && records.iter().any(|r| r.state == State::Alive);
        records.push(record.clone());
        self.owners.entry(record.owner).or_default().insert(name);
        self.report(ChangeKind::Added, record.clone());
        if clash {
            self.report(ChangeKind::Conflict, record);
        }
    }

    /// Takes away the entry of this name for which `owner` vouched.
    pub fn remove(&mut self, owner: InstanceId, name: &str) -> Option<Record> {
        let records = self.names.get_mut(name)?;
        let at = records.iter().position(|r| r.owner == owner)?;
        let record = records.remove(at);
        if records.is_empty() {
            self.names.remove(name);
        }
        if let Some(names) = self.owners.get_mut(&owner) {
            names.remove(name);
            if names.is_empty() {
                self.owners.remove(&owner);
            }
        }
        self.report(ChangeKind::Removed, record.clone());
        Some(record)
    }

    /// Makes `entries` all that `owner` vouches for. Only real differences are reported.
    pub fn replace(&mut self, now: Now, owner: InstanceId, source: Source, entries: Vec<Entry>) {
        let gone: Vec<Text> = match self.owners.get(&owner) {
            Some(names) => {
                let kept: HashSet<&Text> = entries.iter().map(|entry| &entry.name).collect();
                let names = names.iter().filter(|name| !kept.contains(name));
                names.cloned().collect()
            }
            None => Vec::new(),
        };
        for name in gone {
            self.remove(owner, &name);
        }
        for entry in entries {
            self.put(now, owner, source, entry);
        }
    }

    /// Takes away everything for which `owner` vouched.
    pub fn remove_owner(&mut self, owner: InstanceId) {
        for name in self.owned_names(owner) {
            self.remove(owner, &name);
        }
    }

    /// Sets how sure everything is for which `owner` vouches.
    pub fn set_state(&mut self, owner: InstanceId, state: State) {
        self.update_owner(owner, |record| record.state = state);
    }

    /// Sets how everything came to be known for which `owner` vouches.
    pub fn set_source(&mut self, owner: InstanceId, source: Source) {
        self.update_owner(owner, |record| record.source = source);
    }

    /// The record of exactly this name; among several the one that is registered here, else the
    /// surest, else the oldest.
    pub fn find(&self, name: &str) -> Option<&Record> {
        let records = self.names.get(name)?;
        records
            .iter()
            .min_by_key(|r| (r.source != Source::Local, r.state, r.since))
    }

    /// The records of exactly this name, several if several platforms hold it, in no order.
    pub fn find_all(&self, name: &str) -> &[Record] {
        self.names.get(name).map_or(&[], Vec::as_slice)
    }

    /// The records whose field matches, one a name, in no order.
    pub fn search<'a>(
        &'a self,
        pattern: &'a Pattern,
        field: Field,
    ) -> impl Iterator<Item = &'a Record> {
        self.names
            .keys()
            .filter_map(|name| self.find(name))
            .filter(move |record| pattern.matches_field(record, field))
    }

    /// Every record, several of one name included, in no order.
    pub fn iter(&self) -> impl Iterator<Item = &Record> {
        self.names.values().flatten()
    }

    /// The records for which `owner` vouches, by name.
    pub fn owned_by(&self, owner: InstanceId) -> impl Iterator<Item = &Record> {
        self.owners
            .get(&owner)
            .into_iter()
            .flatten()
            .filter_map(move |name| self.names.get(name)?.iter().find(|r| r.owner == owner))
    }

    /// How many names are known.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Whether no name is known.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// The next change that nobody has seen yet.
    pub fn poll_change(&mut self) -> Option<Change> {
        self.changes.pop_front()
    }

    fn owned_names(&self, owner: InstanceId) -> Vec<Text> {
        match self.owners.get(&owner) {
            Some(names) => names.iter().cloned().collect(),
            None => Vec::new(),
        }
    }

    fn update_owner(&mut self, owner: InstanceId, update: impl Fn(&mut Record)) {
        for name in self.owned_names(owner) {
            let Some(records) = self.names.get_mut(&name) else {
                continue;
            };
            let Some(record) = records.iter_mut().find(|r| r.owner == owner) else {
                continue;
            };
            let before = (record.state, record.source);
            update(record);
            if before != (record.state, record.source) {
                let record = record.clone();
                self.report(ChangeKind::Changed, record);
            }
        }
    }

    fn report(&mut self, kind: ChangeKind, record: Record) {
        self.changes.push_back(Change { kind, record });
    }
}
