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

/// Entries in one frame of a snapshot.
const ENTRIES_A_FRAME: usize = 500;

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
    pub(super) fn publish_changes(&mut self, now: Now) {
        while let Some(change) = self.directory.poll_change() {
            self.publish(now, &change);
            if change.kind == ChangeKind::Removed {
                self.show_neighbour(now, &change.record.entry.name);
            }
            self.outputs.push_back(Output::Directory(change));
        }
    }

    fn publish(&mut self, now: Now, change: &Change) {
        if change.kind == ChangeKind::Conflict {
            // Both records have been told; whoever holds them sees the clash.
            return;
        }
        let own = change.record.owner == self.config.instance;
        if own {
            self.version += 1;
        }
        let listeners: Vec<(ConnId, bool)> = self
            .conns
            .iter()
            .filter(|(_, open)| match open.partner {
                Partner::Daemon { .. } => own,
                Partner::Program { watch, .. } => watch,
                Partner::Unknown => false,
            })
            .map(|(conn, open)| (*conn, open.same_host))
            .collect();
        for (conn, same_host) in listeners {
            let frame = DirectoryFrame {
                version: self.version,
                snapshot: false,
                more: false,
                items: vec![item(now, change, same_host)],
            };
            self.send(now, conn, Frame::Directory(frame));
        }
    }

    /// The whole directory, for a program.
    pub(super) fn send_everything(&mut self, now: Now, conn: ConnId) {
        let records: Vec<Record> = self.directory.iter().cloned().collect();
        self.send_snapshot(now, conn, true, &records);
    }

    /// Our own entries, for a peer.
    pub(super) fn send_own_entries(&mut self, now: Now, conn: ConnId, same_host: bool) {
        let own = self.config.instance;
        let records: Vec<Record> = self.directory.owned_by(own).cloned().collect();
        self.send_snapshot(now, conn, same_host, &records);
    }

    fn send_snapshot(&mut self, now: Now, conn: ConnId, same_host: bool, records: &[Record]) {
        let frames = records.len().div_ceil(ENTRIES_A_FRAME).max(1);
        for number in 0..frames {
            let part = records.iter().skip(number * ENTRIES_A_FRAME);
            let part = part.take(ENTRIES_A_FRAME);
            let frame = DirectoryFrame {
                version: self.version,
                snapshot: number == 0,
                more: number + 1 < frames,
                items: part.map(|record| put(now, record, same_host)).collect(),
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
        let (Some(peer), Some(open)) = (self.peers.get_mut(&instance), self.conns.get_mut(&conn))
        else {
            return;
        };
        let source = peer.source();
        if frame.snapshot {
            open.snapshot = Some(Vec::new());
        }
        if let Some(snapshot) = &mut open.snapshot {
            snapshot.extend(frame.items.into_iter().filter_map(|item| match item {
                DirectoryItem::Put { owner, entry, .. } if owner == instance => Some(entry),
                _ => None,
            }));
            if frame.more {
                return;
            }
            let entries = open.snapshot.take().unwrap_or_default();
            // Over two links the older snapshot may come last.
            if peer.version.is_none_or(|known| frame.version >= known) {
                peer.version = Some(frame.version);
                for entry in &entries {
                    self.make_way_for(entry);
                }
                self.directory.replace(now, instance, source, entries);
            }
        } else if peer.version.is_some_and(|known| frame.version > known) {
            peer.version = Some(frame.version);
            for item in frame.items {
                match item {
                    DirectoryItem::Put { owner, entry, .. } if owner == instance => {
                        self.make_way_for(&entry);
                        self.directory.put(now, instance, source, entry);
                    }
                    DirectoryItem::Remove { owner, name } if owner == instance => {
                        self.directory.remove(instance, &name);
                    }
                    _ => {}
                }
            }
        }
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
            !address.is_ok_and(|address| address.is_loopback())
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
