//! The thread that writes, and its queue.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use fipa_mts::StoredLetter;

use crate::file::{Change, OutboxFile};

/// Octets that are written in one transaction, about.
const BATCH: usize = 4 << 20;

/// An outbox that was opened, with what is in it.
#[derive(Debug)]
pub struct Opened {
    file: OutboxFile,
    letters: Vec<StoredLetter>,
}

impl Opened {
    pub(crate) fn new(file: OutboxFile, letters: Vec<StoredLetter>) -> Opened {
        Opened { file, letters }
    }

    /// The letters that an earlier run has stored, in order; for
    /// [`Mts::restore`](fipa_mts::Mts::restore).
    pub fn take_letters(&mut self) -> Vec<StoredLetter> {
        std::mem::take(&mut self.letters)
    }

    /// Starts to store. `stored` is called, on the thread of the store, with the number of each
    /// letter that is on the disk, or that cannot be stored, and why.
    ///
    /// # Errors
    ///
    /// When no thread can be started.
    pub fn start(
        self,
        stored: impl Fn(u64, Result<(), String>) + Send + 'static,
    ) -> std::io::Result<Store> {
        let (sender, receiver) = channel();
        let file = self.file;
        let thread = std::thread::Builder::new().name("outbox".to_owned());
        let thread = thread.spawn(move || write(file, &receiver, stored))?;
        Ok(Store { sender, thread })
    }
}

/// The way to the disk. Letters and removals are written in the order in which they are given.
#[derive(Debug)]
pub struct Store {
    sender: Sender<Change>,
    thread: JoinHandle<()>,
}

impl Store {
    /// Stores a letter, soon.
    pub fn put(&self, letter: StoredLetter) {
        self.give(Change::Put(letter));
    }

    /// Removes a letter, soon.
    pub fn remove(&self, key: u64) {
        self.give(Change::Remove(key));
    }

    fn give(&self, change: Change) {
        // The thread ends after this end only; were it dead, nothing would be called stored.
        let _ = self.sender.send(change);
    }

    /// Writes what waits, and closes the file.
    pub fn close(self) {
        drop(self.sender);
        let _ = self.thread.join();
    }
}

fn write(
    mut file: OutboxFile,
    receiver: &Receiver<Change>,
    stored: impl Fn(u64, Result<(), String>),
) {
    // Removals that failed.
    let mut owed: Vec<Change> = Vec::new();
    while let Ok(first) = receiver.recv() {
        let batch = batch(first, receiver);
        let result = file.write(owed.iter().chain(&batch));
        if result.is_ok() {
            owed.clear();
        }
        for change in batch {
            match change {
                Change::Put(letter) => stored(letter.key, result.clone()),
                Change::Remove(key) if result.is_err() => owed.push(Change::Remove(key)),
                Change::Remove(_) => {}
            }
        }
    }
}

/// What waits, up to a measure.
fn batch(first: Change, receiver: &Receiver<Change>) -> Vec<Change> {
    let mut octets = 0;
    let mut batch = vec![first];
    while octets < BATCH
        && let Ok(change) = receiver.try_recv()
    {
        if let Change::Put(letter) = &change {
            octets += letter.octets.len();
        }
        batch.push(change);
    }
    batch
}
