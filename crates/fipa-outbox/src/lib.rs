//! Letters for robots that are away, on disk.
//!
//! ```text
//!   Output::Store ───▶ Store::put ────╮ queue   ╭─ thread: all that waits, in one transaction ─╮
//!   Output::Unstore ─▶ Store::remove ─╯ ──────▶ ╰─ commit, fsync ─▶ "stored", or why not ──────╯
//! ```
//!
//! The letters are in one file, `outbox.redb`, in the directory that is given. A letter is reported
//! as stored when the system has said that the transaction is on the disk (`fsync`): it survives a
//! crash of the process at once, and a loss of power as far as the disk keeps its word. A letter
//! that is removed may be there again after a crash; it is then sent again, and the receiver's side
//! knows it.
//!
//! When a write fails, as on a full disk, every letter of that transaction is reported as not
//! stored; the file is opened anew for the next one. A removal that failed is done with the next
//! transaction. A file that cannot be read is never replaced or repaired by leaving letters out:
//! [`open`] fails and says so.
//!
//! **Knows** the file and its one thread. **Never knows** which letters are stored and why: the
//! message transport service says that.

mod file;
mod writer;

use std::io;
use std::path::PathBuf;

pub use writer::{Opened, Store};

pub use file::FILE_NAME;

/// Why the letters of an earlier run cannot be read, or none can be stored.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The directory cannot be made.
    #[error("the directory {} cannot be made: {source}", .path.display())]
    Directory {
        /// The directory.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Another daemon has it.
    #[error("the outbox {} is in use by another daemon", .0.display())]
    InUse(PathBuf),
    /// It is damaged, or another kind of file.
    #[error(
        "the outbox {} cannot be read: {reason}; \
         move it away to begin with an empty one, or restore it from a copy", .path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The system does not let it be opened or written.
    #[error("the outbox {} cannot be opened: {reason}", .path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: String,
    },
}

/// Opens the outbox in this directory, or makes one, and reads what is in it. The directory is
/// made where it is missing. It belongs to one process at a time.
pub fn open(directory: impl Into<PathBuf>) -> Result<Opened, OpenError> {
    let directory = directory.into();
    make(&directory).map_err(|source| OpenError::Directory {
        path: directory.clone(),
        source,
    })?;
    let (file, letters) = file::OutboxFile::open(directory.join(FILE_NAME))?;
    Ok(Opened::new(file, letters))
}

/// Makes a directory that others cannot read: letters are nobody else's business.
fn make(directory: &std::path::Path) -> io::Result<()> {
    use std::os::unix::fs::DirBuilderExt;
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true).mode(0o700).create(directory)
}
