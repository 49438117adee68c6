//! Disks: what a daemon stores survives its crashes, once it is written.

use std::collections::BTreeMap;
use std::time::Duration;

use fipa_acl::Text;
use fipa_mts::StoredLetter;

use crate::node::{NodeId, Running};
use crate::sim::Sim;

/// The longest that the disk takes for one write.
const SLOWEST_MILLIS: u64 = 100;

/// The disk of a node. It does one thing after the other.
#[derive(Debug, Default)]
pub(crate) struct Disk {
    letters: BTreeMap<u64, StoredLetter>,
    full: bool,
    free_at: Duration,
}

/// What a machine wants of the disk.
#[derive(Debug)]
pub(crate) enum Write {
    Store(Box<StoredLetter>),
    Unstore(u64),
}

impl Sim {
    /// Sets whether the disk of a node is full.
    pub fn set_disk_full(&mut self, node: NodeId, full: bool) {
        self.nodes[node.0].disk.full = full;
    }

    /// How many letters are on the disk of a node.
    pub fn letters_on_disk(&self, node: NodeId) -> usize {
        self.nodes[node.0].disk.letters.len()
    }

    /// The letters on the disk of a node, as a daemon finds them that starts there.
    pub(crate) fn read_disk(&self, node: NodeId) -> Vec<StoredLetter> {
        self.nodes[node.0].disk.letters.values().cloned().collect()
    }

    /// Writes, and then tells the machine. A crash in between leaves what is written; one before it
    /// loses it, or does not.
    pub(crate) fn write_disk(&mut self, node: NodeId, write: Write) {
        let run = self.nodes[node.0].run;
        let millis = self.random.u64(0..SLOWEST_MILLIS);
        let survives = self.random.bool();
        let (now, disk) = (self.now.mono, &mut self.nodes[node.0].disk);
        disk.free_at = disk.free_at.max(now) + Duration::from_millis(millis / 8);
        let written = disk.free_at - now;
        let told = Duration::from_millis(self.random.u64(0..SLOWEST_MILLIS));
        self.after(written, move |sim| {
            if !survives && !sim.runs(node, run) {
                return;
            }
            let disk = &mut sim.nodes[node.0].disk;
            let (key, full) = match write {
                Write::Unstore(key) => {
                    disk.letters.remove(&key);
                    return;
                }
                Write::Store(letter) => {
                    let key = letter.key;
                    if !disk.full {
                        disk.letters.insert(key, *letter);
                    }
                    (key, disk.full)
                }
            };
            sim.after(told, move |sim| sim.tell_written(node, run, key, full));
        });
    }

    fn tell_written(&mut self, node: NodeId, run: u64, key: u64, full: bool) {
        let now = self.now;
        if !self.runs(node, run) {
            return;
        }
        if let Running::Daemon(mts) = &mut self.nodes[node.0].running {
            let result = match full {
                true => Err(Text::from_static("the disk is full")),
                false => Ok(()),
            };
            mts.stored(now, key, result);
        }
        self.settle(node);
    }
}
