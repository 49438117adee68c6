use std::collections::{HashMap, VecDeque};
use std::io;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use fipa_acl::Text;
use fipa_locking::Record;
use tokio::task::JoinHandle;

/// Where the owner of resources keeps what must survive a crash. It is called on threads that may
/// wait, one call after the other for an agent.
pub trait Keep: Send + Sync + 'static {
    /// What was kept last of a resource; the default for one of which nothing ever was.
    ///
    /// # Errors
    /// It cannot be read.
    fn recall(&self, resource: &str) -> io::Result<Record>;

    /// Keeps this of a resource. When it returns, it survives a crash.
    ///
    /// # Errors
    /// It cannot be kept; nobody gets the resource with that number.
    fn keep(&self, resource: &str, record: Record) -> io::Result<()>;
}

/// Keeps nothing: numbers begin with the milliseconds since 1970, so that they grow over restarts
/// as long as the clock does. An owner that starts again does not know whether somebody still
/// holds what it lent.
#[derive(Clone, Copy, Debug, Default)]
pub struct Forgetful(());

impl Forgetful {
    /// The one that keeps nothing.
    pub fn new() -> Forgetful {
        Forgetful::default()
    }
}

impl Keep for Forgetful {
    fn recall(&self, _resource: &str) -> io::Result<Record> {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH);
        let millis = since_epoch.unwrap_or_default().as_millis();
        Ok(Record {
            fencing: u64::try_from(millis).unwrap_or_default(),
            held: false,
        })
    }

    fn keep(&self, _resource: &str, _record: Record) -> io::Result<()> {
        Ok(())
    }
}

/// Asks what was kept, on a thread that may wait.
pub(super) async fn recall(keep: Arc<dyn Keep>, resource: Text) -> io::Result<Record> {
    let recalled = tokio::task::spawn_blocking(move || keep.recall(&resource)).await;
    recalled.unwrap_or_else(|panic| Err(io::Error::other(panic)))
}

/// What the owner has to keep, one after the other.
#[derive(Default)]
pub(super) struct Keeping {
    keepers: HashMap<Text, Arc<dyn Keep>>,
    waiting: VecDeque<(Text, Record)>,
    /// What is being written.
    current: Option<(Text, Record, JoinHandle<io::Result<()>>)>,
}

/// What became of a record that was to be kept.
pub(super) struct Kept {
    pub(super) resource: Text,
    pub(super) record: Record,
    pub(super) result: io::Result<()>,
}

impl Keeping {
    pub(super) fn add(&mut self, resource: Text, keep: Arc<dyn Keep>) {
        self.keepers.insert(resource, keep);
    }

    /// Keeps a record; an older one of the resource that was not begun is not wanted any more.
    pub(super) fn put(&mut self, resource: Text, record: Record) {
        self.waiting.retain(|(other, _)| *other != resource);
        self.waiting.push_back((resource, record));
        self.begin();
    }

    fn begin(&mut self) {
        while self.current.is_none()
            && let Some((resource, record)) = self.waiting.pop_front()
        {
            let Some(keep) = self.keepers.get(&resource).cloned() else {
                continue;
            };
            let name = resource.clone();
            let write = tokio::task::spawn_blocking(move || keep.keep(&name, record));
            self.current = Some((resource, record, write));
        }
    }

    /// The next record that was kept, or could not be. Cancel-safe.
    pub(super) async fn next(&mut self) -> Kept {
        let Some((resource, record, write)) = &mut self.current else {
            return std::future::pending().await;
        };
        let result = write.await;
        let kept = Kept {
            resource: resource.clone(),
            record: *record,
            result: result.unwrap_or_else(|panic| Err(io::Error::other(panic))),
        };
        self.current = None;
        self.begin();
        kept
    }
}
