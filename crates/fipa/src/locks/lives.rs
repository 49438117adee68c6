use std::collections::{BTreeSet, HashMap};

use fipa_acl::Text;
use fipa_directory::{Change, ChangeKind, Directory, InstanceId, Record, Source, State};

/// Names of which it is remembered that they went, at most.
const MOST_GONE: usize = 1024;

/// Who lives, as the directory tells it, and who certainly does not.
///
/// An agent is certainly gone when the daemon that vouches for it says so: it was deregistered, or
/// its program's connection ended. One whose daemon is not heard may still hold something.
#[derive(Debug, Default)]
pub(super) struct Lives {
    known: HashMap<(InstanceId, Text), Life>,
    /// Of whom nothing counts any more that is still under way.
    gone: BTreeSet<Text>,
}

#[derive(Clone, Copy, Debug)]
struct Life {
    /// When it was registered, which tells it from a later life.
    registered: i64,
    /// Whether its daemon is heard.
    heard: bool,
}

/// Whether a daemon of ours says when an agent is gone: it does not of agents of other makes, which
/// stand in records of their own.
fn is_vouched_for(record: &Record) -> bool {
    !record.owner.as_bytes().starts_with(&[0; 8]) && record.source != Source::Ams
}

impl Lives {
    pub(super) fn new(directory: &Directory) -> Lives {
        let mut lives = Lives::default();
        for record in directory.iter() {
            lives.put(record);
        }
        lives
    }

    /// Follows the directory; the agent whose life has certainly ended by this.
    pub(super) fn follow(&mut self, change: &Change) -> Option<Text> {
        let record = &change.record;
        let name = &record.entry.name;
        match change.kind {
            ChangeKind::Added | ChangeKind::Changed => {
                self.gone.remove(name);
                let before = self.put(record)?;
                let another = before.registered != record.entry.timestamp;
                (another && is_vouched_for(record)).then(|| name.clone())
            }
            ChangeKind::Removed => {
                let before = self.known.remove(&(record.owner, name.clone()))?;
                if !before.heard || !is_vouched_for(record) {
                    return None;
                }
                if !self.known.keys().any(|(_, known)| known == name) {
                    if self.gone.len() >= MOST_GONE {
                        self.gone.clear();
                    }
                    self.gone.insert(name.clone());
                }
                Some(name.clone())
            }
            ChangeKind::Conflict => None,
        }
    }

    /// The daemon that tells all this is away: what it tells next is not the end of anybody.
    pub(super) fn doubt(&mut self) {
        self.known.values_mut().for_each(|life| life.heard = false);
    }

    /// Whether an agent is certainly gone, so that what it said before does not count.
    pub(super) fn is_gone(&self, name: &str) -> bool {
        self.gone.contains(name)
    }

    fn put(&mut self, record: &Record) -> Option<Life> {
        let key = (record.owner, record.entry.name.clone());
        let life = Life {
            registered: record.entry.timestamp,
            heard: record.state == State::Alive,
        };
        self.known.insert(key, life)
    }
}

#[cfg(test)]
mod tests {
    use fipa_directory::{Entry, Now};

    use super::*;

    const ROBOT: InstanceId = InstanceId::from_bytes([7; 16]);
    const FOREIGN: InstanceId = InstanceId::from_bytes([0; 16]);

    fn entry(timestamp: i64) -> Entry {
        Entry {
            timestamp,
            ..Entry::new("arm")
        }
    }

    /// Whose life ends by what happens to a directory, change by change.
    fn ended(lives: &mut Lives, directory: &mut Directory) -> Vec<Option<Text>> {
        let changes = std::iter::from_fn(|| directory.poll_change());
        changes.map(|change| lives.follow(&change)).collect()
    }

    #[test]
    fn who_is_deregistered_is_gone_and_who_is_only_not_heard_of_is_not() {
        let now = Now::default();
        for (owner, state, gone) in [
            (ROBOT, State::Alive, true),
            (ROBOT, State::Suspect, false),
            (FOREIGN, State::Alive, false),
        ] {
            let (mut lives, mut directory) = (Lives::default(), Directory::new());
            directory.put(now, owner, Source::Mdns, entry(1));
            directory.set_state(now, owner, state);
            ended(&mut lives, &mut directory);
            directory.remove(now, owner, "arm");
            let expected = gone.then(|| Text::from("arm"));
            assert_eq!(ended(&mut lives, &mut directory), [expected]);
            assert_eq!(lives.is_gone("arm"), gone);
            directory.put(now, owner, Source::Mdns, entry(2));
            assert_eq!(ended(&mut lives, &mut directory), [None]);
            assert!(!lives.is_gone("arm"));
        }
    }

    #[test]
    fn who_came_back_before_its_end_was_told_has_ended_once() {
        let now = Now::default();
        let (mut lives, mut directory) = (Lives::default(), Directory::new());
        directory.put(now, ROBOT, Source::Peer, entry(1));
        directory.set_source(ROBOT, Source::Mdns);
        directory.put(now, ROBOT, Source::Mdns, entry(2));
        let gone = Some(Text::from("arm"));
        assert_eq!(ended(&mut lives, &mut directory), [None, None, gone]);
        assert!(!lives.is_gone("arm"));
    }

    #[test]
    fn what_a_daemon_does_not_know_after_it_was_away_is_not_the_end_of_it() {
        let now = Now::default();
        let mut directory = Directory::new();
        directory.put(now, ROBOT, Source::Peer, entry(1));
        let mut lives = Lives::new(&directory);
        while directory.poll_change().is_some() {}
        lives.doubt();
        directory.remove(now, ROBOT, "arm");
        assert_eq!(ended(&mut lives, &mut directory), [None]);
    }
}
