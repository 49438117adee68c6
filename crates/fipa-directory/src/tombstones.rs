use std::collections::{BTreeSet, HashMap};
use std::time::Duration;

use fipa_acl::Text;

use crate::{Now, Record, State};

/// Agents that are remembered after they went.
const MAX_TOMBSTONES: usize = 1000;

/// How long an agent is remembered after it went.
const REMEMBERED: Duration = Duration::from_secs(24 * 3600);

/// The last record of each name that is known no more: bounded in number and time.
#[derive(Debug, Default)]
pub(crate) struct Tombstones {
    names: HashMap<Text, Record>,
    /// By when they went; the oldest go first.
    order: BTreeSet<(Duration, Text)>,
}

impl Tombstones {
    /// Remembers a record that went at [`Record::since`].
    pub(crate) fn put(&mut self, now: Now, record: Record) {
        let name = record.entry.name.clone();
        self.remove(&name);
        self.order.insert((record.since, name.clone()));
        self.names.insert(
            name,
            Record {
                state: State::Gone,
                ..record
            },
        );
        while let Some((since, _)) = self.order.first()
            && (self.order.len() > MAX_TOMBSTONES || since.saturating_add(REMEMBERED) <= now.mono)
            && let Some((_, oldest)) = self.order.pop_first()
        {
            self.names.remove(&oldest);
        }
    }

    /// Forgets a name, which is known again.
    pub(crate) fn remove(&mut self, name: &Text) {
        if let Some(record) = self.names.remove(name) {
            self.order.remove(&(record.since, name.clone()));
        }
    }

    pub(crate) fn get(&self, now: Now, name: &str) -> Option<&Record> {
        self.names
            .get(name)
            .filter(|record| is_remembered(now, record))
    }

    pub(crate) fn iter(&self, now: Now) -> impl Iterator<Item = &Record> {
        let names = self.names.values();
        names.filter(move |record| is_remembered(now, record))
    }
}

fn is_remembered(now: Now, record: &Record) -> bool {
    now.mono < record.since.saturating_add(REMEMBERED)
}
