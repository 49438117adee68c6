use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};
use std::time::Duration;

use fipa_acl::Text;

use crate::tombstones::Tombstones;
use crate::{Entry, Field, InstanceId, Now, Pattern, Record, Source, State};

/// How long two living platforms hold one name before that is a conflict. An agent that moves may
/// be registered at its new place before it has left the old one, and the news of both travel on
/// ways of their own.
const MOVING: Duration = Duration::from_secs(1);

/// The store of entries, by name; and the queue of what changed.
///
/// Two platforms may hold the same name. Both records are kept, nothing is renamed, and a clash
/// that lasts for a second is reported as a [`ChangeKind::Conflict`].
///
/// What went is remembered as a tombstone, with the state [`State::Gone`]: the last 1000 names,
/// for 24 hours. [`find`](Self::find) and [`search`](Self::search) do not see them.
#[derive(Debug, Default)]
pub struct Directory {
    names: HashMap<Text, Vec<Record>>,
    owners: HashMap<InstanceId, BTreeSet<Text>>,
    gone: Tombstones,
    /// Names that several living platforms hold, and since when that is a conflict.
    clashes: HashMap<Text, Duration>,
    /// Those of them that have not been reported yet.
    unreported: BTreeSet<(Duration, Text)>,
    changes: VecDeque<Change>,
}

/// Something that changed in a directory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// What happened.
    pub kind: ChangeKind,
    /// The record as it is now; one that went has the state [`State::Gone`].
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
    /// A second living platform holds the same name, and has for a second.
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
        self.put_record(now, record);
    }

    /// Puts a record as another directory holds it: with its own owner, source, state and age. One
    /// that is [`State::Gone`] becomes a tombstone, of which nothing is reported.
    pub fn put_record(&mut self, now: Now, record: Record) {
        let name = record.entry.name.clone();
        if record.state == State::Gone {
            if !self.names.contains_key(&name) {
                self.gone.put(now, record);
            }
            return;
        }
        self.gone.remove(&name);
        // Nearly all names are held once.
        let records = self.names.entry(name.clone());
        let records = records.or_insert_with(|| Vec::with_capacity(1));
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
        } else {
            records.push(record.clone());
            let names = self.owners.entry(record.owner).or_default();
            names.insert(name.clone());
            self.report(ChangeKind::Added, record);
        }
        self.look_for_clash(now, &name);
    }

    /// Takes away the entry of this name for which `owner` vouched.
    pub fn remove(&mut self, now: Now, owner: InstanceId, name: &str) -> Option<Record> {
        let records = self.names.get_mut(name)?;
        let at = records.iter().position(|r| r.owner == owner)?;
        let record = records.remove(at);
        let last = records.is_empty();
        if let Some(names) = self.owners.get_mut(&owner) {
            names.remove(name);
            if names.is_empty() {
                self.owners.remove(&owner);
            }
        }
        if last {
            self.names.remove(name);
            let since = now.mono;
            self.gone.put(
                now,
                Record {
                    since,
                    ..record.clone()
                },
            );
        }
        self.look_for_clash(now, &record.entry.name);
        let state = State::Gone;
        self.report(
            ChangeKind::Removed,
            Record {
                state,
                ..record.clone()
            },
        );
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
            self.remove(now, owner, &name);
        }
        for entry in entries {
            self.put(now, owner, source, entry);
        }
    }

    /// Takes away everything for which `owner` vouched.
    pub fn remove_owner(&mut self, now: Now, owner: InstanceId) {
        for name in self.owned_names(owner) {
            self.remove(now, owner, &name);
        }
    }

    /// Sets how sure everything is for which `owner` vouches.
    pub fn set_state(&mut self, now: Now, owner: InstanceId, state: State) {
        self.update_owner(owner, |record| record.state = state);
        for name in self.owned_names(owner) {
            self.look_for_clash(now, &name);
        }
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

    /// The tombstone of this name: nobody has it now, and somebody had it within the last 24 hours.
    /// Its [`Record::since`] is when it went.
    pub fn tombstone(&self, now: Now, name: &str) -> Option<&Record> {
        self.gone.get(now, name)
    }

    /// Every tombstone, in no order.
    pub fn tombstones(&self, now: Now) -> impl Iterator<Item = &Record> {
        self.gone.iter(now)
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called, on [`Now::mono`].
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.unreported.first().map(|(due, _)| *due)
    }

    /// Reports the clashes that have lasted for long enough.
    pub fn handle_timeout(&mut self, now: Now) {
        while let Some((due, _)) = self.unreported.first()
            && *due <= now.mono
            && let Some((_, name)) = self.unreported.pop_first()
        {
            let records = self.names.get(&name).into_iter().flatten();
            let youngest = records.max_by_key(|record| record.since).cloned();
            if let Some(record) = youngest {
                self.report(ChangeKind::Conflict, record);
            }
        }
    }

    /// The next change that nobody has seen yet.
    pub fn poll_change(&mut self) -> Option<Change> {
        self.changes.pop_front()
    }

    fn look_for_clash(&mut self, now: Now, name: &Text) {
        let records = self.names.get(name).into_iter().flatten();
        if records.filter(|r| r.state == State::Alive).count() > 1 {
            let due = now.mono.saturating_add(MOVING);
            if !self.clashes.contains_key(name) {
                self.clashes.insert(name.clone(), due);
                self.unreported.insert((due, name.clone()));
            }
        } else if let Some(due) = self.clashes.remove(name) {
            self.unreported.remove(&(due, name.clone()));
        }
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
