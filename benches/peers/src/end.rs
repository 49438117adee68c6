//! The ends of every peer, in this process: where their tasks run, and what has arrived.

use std::future::Future;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use tokio::runtime::{Builder, Runtime};
use tokio::sync::Notify;

/// One thread for the tasks of one end. They go on while nobody waits for them.
pub(crate) struct End(Runtime);

impl End {
    pub(crate) fn new() -> End {
        let runtime = Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build();
        End(runtime.expect("a runtime"))
    }

    /// Does this on the end's thread, and waits for it.
    pub(crate) fn run<T: Send + 'static>(
        &self,
        work: impl Future<Output = T> + Send + 'static,
    ) -> T {
        let work = self.0.spawn(work);
        self.0.block_on(work).expect("done")
    }
}

/// How often whoever waits looks what has arrived.
const STEP: usize = 64;

/// What has arrived at a sink. Whoever waits says for what and then looks, the sink counts and then
/// looks who waits: one of them sees the other.
#[derive(Clone, Default)]
pub(crate) struct Tally(Arc<Counts>);

#[derive(Default)]
struct Counts {
    letters: AtomicUsize,
    octets: AtomicUsize,
    /// The number of letters that somebody waits for.
    wanted: AtomicUsize,
    changed: Notify,
}

impl Tally {
    /// A letter with so many octets of content has arrived.
    pub(crate) fn add(&self, octets: usize) {
        let counts = &self.0;
        counts.octets.fetch_add(octets, Ordering::Relaxed);
        let letters = counts.letters.fetch_add(1, Ordering::SeqCst) + 1;
        if letters.is_multiple_of(STEP) || letters == counts.wanted.load(Ordering::SeqCst) {
            counts.changed.notify_waiters();
        }
    }

    /// How many letters and octets have arrived since the beginning.
    pub(crate) fn seen(&self) -> (usize, usize) {
        let letters = self.0.letters.load(Ordering::SeqCst);
        (letters, self.0.octets.load(Ordering::Relaxed))
    }

    /// Waits until so many letters have arrived since the beginning.
    pub(crate) async fn reached(&self, letters: usize) {
        self.0.wanted.store(letters, Ordering::SeqCst);
        loop {
            // Asked for before looking, so that no notice falls between.
            let changed = self.0.changed.notified();
            tokio::pin!(changed);
            changed.as_mut().enable();
            if self.seen().0 >= letters {
                return;
            }
            changed.await;
        }
    }
}
