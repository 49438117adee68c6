//! Telling others what the directory holds, and hearing what theirs does.

use fipa_acl::Text;
use fipa_directory::Record;
use fipa_directory::{
    Address, Change, ChangeKind, Entry, InstanceId, Location, MESSAGE_TRANSPORT, Now,
};
use fipa_link::{DirectoryFrame, DirectoryItem, Frame};

use super::Mts;
use super::connections::Partner;
use crate::machine::{ConnId, Output};

/// Octets of one frame, about. What is more than this goes in several, which its reader takes for
/// one.
const FRAME_OCTETS: usize = 1 << 20;

/// The items of a part of a directory of which more is to come.
#[derive(Debug)]
pub(super) struct Unfinished {
    snapshot: bool,
    items: Vec<DirectoryItem>,
}

impl Mts {
    /// The locations of our agents.
    pub(super) fn own_locations(&self) -> Vec<Location> {
        let signature = Text::from_static(MESSAGE_TRANSPORT);
        self.config
            .endpoints
            .iter()
            .map(|address| Location {
                address: address.to_text(),
                signature: signature.clone(),
            })
            .collect()
    }

    /// Passes on what has changed: our own entries to peers, everything to programs that watch.
    /// What changed at once is told at once.
    pub(super) fn publish_changes(&mut self, now: Now) {
        // Where one goes, a neighbour of the same name may show.
        loop {
            let changes = std::iter::from_fn(|| self.directory.poll_change());
            let changes: Vec<Change> = changes.collect();
            if changes.is_empty() {
                return;
            }
            self.publish(now, &changes);
            for change in changes {
                let name = &change.record.entry.name;
                match change.kind {
                    ChangeKind::Added => self.follow(now, name),
                    ChangeKind::Removed => {
                        self.settle_claims(now, name);
                        self.show_neighbour(now, name);
                    }
                    _ => {}
                }
                self.outputs.push_back(Output::Directory(change));
            }
        }
    }

    fn publish(&mut self, now: Now, changes: &[Change]) {
        // Whoever is told of both records sees the clash.
        let told = changes.iter().filter(|c| c.kind != ChangeKind::Conflict);
        let told: Vec<&Change> = told.collect();
        let own: Vec<&Change> = told
            .iter()
            .copied()
            .filter(|change| change.record.owner == self.config.instance)
            .collect();
        if !own.is_empty() {
            self.version += 1;
        }
        let peers = self.conns.iter().filter_map(|(conn, open)| {
            let is_peer = matches!(open.partner, Partner::Daemon { .. });
            is_peer.then_some((*conn, open.same_host, true))
        });
        let host_of = |conn: &ConnId| Some(self.conns.get(conn)?.same_host);
        let programs = self.watchers.iter();
        let programs = programs.filter_map(|conn| Some((*conn, host_of(conn)?, false)));
        let mut listeners: Vec<(ConnId, bool, bool)> = programs.collect();
        if !own.is_empty() {
            listeners.extend(peers);
        }
        for (conn, same_host, only_own) in listeners {
            let changes = if only_own { &own } else { &told };
            let items = changes.iter().map(|change| item(now, change, same_host));
            let items: Vec<DirectoryItem> = items.collect();
            if !items.is_empty() {
                self.send_items(now, conn, false, items);
            }
        }
    }

    /// The whole directory, tombstones included, for a program.
    pub(super) fn send_everything(&mut self, now: Now, conn: ConnId) {
        let records = self.directory.iter().chain(self.directory.tombstones(now));
        let items = records.map(|record| put(now, record, true)).collect();
        self.send_items(now, conn, true, items);
    }

    /// Our own entries, for a peer.
    pub(super) fn send_own_entries(&mut self, now: Now, conn: ConnId, same_host: bool) {
        let records = self.directory.owned_by(self.config.instance);
        let items = records.map(|record| put(now, record, same_host)).collect();
        self.send_items(now, conn, true, items);
    }

    fn send_items(&mut self, now: Now, conn: ConnId, snapshot: bool, items: Vec<DirectoryItem>) {
        let mut parts = in_parts(items).into_iter().peekable();
        let mut first = true;
        while let Some(items) = parts.next() {
            let frame = DirectoryFrame {
                version: self.version,
                snapshot: snapshot && std::mem::take(&mut first),
                more: parts.peek().is_some(),
                items,
            };
            self.send(now, conn, Frame::Directory(frame));
        }
    }

    /// A peer tells of its agents. What it says of others' is passed over: each speaks for its own.
    pub(super) fn peer_directory(
        &mut self,
        now: Now,
        conn: ConnId,
        instance: InstanceId,
        frame: DirectoryFrame,
    ) {
        let (Some(peer), Some(open)) = (self.peers.get_mut(instance), self.conns.get_mut(&conn))
        else {
            return;
        };
        let source = peer.source();
        if frame.snapshot {
            open.unfinished = None;
        }
        let mut whole = open.unfinished.take().unwrap_or(Unfinished {
            snapshot: frame.snapshot,
            items: Vec::new(),
        });
        whole.items.extend(frame.items);
        if frame.more {
            open.unfinished = Some(whole);
            return;
        }
        let items = whole.items.into_iter();
        if whole.snapshot {
            // Over two links the older snapshot may come last.
            if peer.version.is_none_or(|known| frame.version >= known) {
                peer.version = Some(frame.version);
                let entries = items.filter_map(|item| match item {
                    DirectoryItem::Put { owner, entry, .. } if owner == instance => Some(entry),
                    _ => None,
                });
                self.drop_claims(instance);
                let mut entries: Vec<Entry> = entries.collect();
                entries.retain(|entry| self.is_admitted(instance, entry));
                for entry in &entries {
                    self.make_way_for(now, entry);
                }
                self.directory.replace(now, instance, source, entries);
            }
        } else if peer.version.is_some_and(|known| frame.version > known) {
            peer.version = Some(frame.version);
            for item in items {
                match item {
                    DirectoryItem::Put { owner, entry, .. } if owner == instance => {
                        if !self.is_admitted(instance, &entry) {
                            continue;
                        }
                        self.make_way_for(now, &entry);
                        self.directory.put(now, instance, source, entry);
                    }
                    DirectoryItem::Remove { owner, name } if owner == instance => {
                        self.drop_claim(instance, &name);
                        self.directory.remove(now, instance, &name);
                    }
                    _ => {}
                }
            }
        }
    }
}

/// Items in portions that fit a frame; one, if there are none.
fn in_parts(items: Vec<DirectoryItem>) -> Vec<Vec<DirectoryItem>> {
    let mut parts = vec![Vec::new()];
    let mut octets = 0;
    for item in items {
        octets += octets_of(&item);
        if octets > FRAME_OCTETS {
            octets = octets_of(&item);
            parts.push(Vec::new());
        }
        if let Some(part) = parts.last_mut() {
            part.push(item);
        }
    }
    parts
}

/// The octets of an item, about.
fn octets_of(item: &DirectoryItem) -> usize {
    match item {
        DirectoryItem::Put { entry, .. } => {
            let locations = entry.locations.iter();
            let locations = locations.map(|l| l.address.len() + l.signature.len() + 8);
            let texts = entry.name.len() + entry.kind.len() + entry.description.len();
            64 + texts + locations.sum::<usize>()
        }
        DirectoryItem::Remove { name, .. } => 32 + name.len(),
    }
}

fn item(now: Now, change: &Change, same_host: bool) -> DirectoryItem {
    match change.kind {
        ChangeKind::Removed => DirectoryItem::Remove {
            owner: change.record.owner,
            name: change.record.entry.name.clone(),
        },
        _ => put(now, &change.record, same_host),
    }
}

/// An entry as it is told to somebody: another host is not told addresses that only we can reach.
fn put(now: Now, record: &Record, same_host: bool) -> DirectoryItem {
    let mut entry: Entry = record.entry.clone();
    if !same_host {
        entry.locations.retain(|location| {
            let address = location.address.parse::<Address>();
            !address.is_ok_and(|address| !address.is_for_others())
        });
    }
    let age = now.mono.saturating_sub(record.since).as_millis();
    DirectoryItem::Put {
        owner: record.owner,
        source: record.source,
        state: record.state,
        age_millis: u64::try_from(age).unwrap_or(u64::MAX),
        entry,
    }
}

/// What a program's copy of the directory makes of an item.
pub(crate) fn record_of(now: Now, item: DirectoryItem) -> Result<Record, (InstanceId, Text)> {
    match item {
        DirectoryItem::Put {
            owner,
            source,
            state,
            age_millis,
            entry,
        } => Ok(Record {
            entry,
            owner,
            source,
            state,
            since: now
                .mono
                .saturating_sub(std::time::Duration::from_millis(age_millis)),
        }),
        DirectoryItem::Remove { owner, name } => Err((owner, name)),
    }
}
