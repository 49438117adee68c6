use std::collections::BTreeMap;
use std::fs::{DirBuilder, File};
use std::io::{self, Write};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use fipa::locks::{Keep, Record};

/// Why the numbers of earlier grants are not known.
#[derive(Debug, thiserror::Error)]
pub(crate) enum FencingError {
    /// The folder or a file in it cannot be used.
    #[error("{}: {source}", .path.display())]
    Io { path: PathBuf, source: io::Error },
    /// Another daemon has the folder.
    #[error("{}: another daemon keeps its state there", .0.display())]
    InUse(PathBuf),
    /// The file is not what a daemon wrote.
    #[error("{}:{line}: this is no `NUMBER held|free RESOURCE`", .path.display())]
    Malformed { path: PathBuf, line: usize },
}

/// The file `fencing` in the folder of a daemon's state: a line `NUMBER held|free RESOURCE` for each
/// resource that the daemon owns or has owned.
///
/// It is replaced as a whole, by a file that is on the disk before it gets the name.
#[derive(Debug)]
pub(crate) struct FencingFile {
    folder: PathBuf,
    records: Mutex<BTreeMap<String, Record>>,
    /// Keeps other daemons away.
    _lock: File,
}

impl FencingFile {
    /// Opens the file in a folder, which is made if it is not there, for its user alone.
    pub(crate) fn open(folder: &Path) -> Result<FencingFile, FencingError> {
        let at = |path: &Path| {
            let path = path.to_owned();
            move |source| FencingError::Io { path, source }
        };
        let made = DirBuilder::new().mode(0o700).recursive(true).create(folder);
        made.map_err(at(folder))?;
        let path = folder.join("fencing.lock");
        let lock = File::create(&path).map_err(at(&path))?;
        if lock.try_lock().is_err() {
            return Err(FencingError::InUse(folder.to_owned()));
        }
        let path = folder.join("fencing");
        let text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            text => text.map_err(at(&path))?,
        };
        let records = read(&text).map_err(|line| FencingError::Malformed { path, line })?;
        Ok(FencingFile {
            folder: folder.to_owned(),
            records: Mutex::new(records),
            _lock: lock,
        })
    }

    fn write(&self, records: &BTreeMap<String, Record>) -> io::Result<()> {
        let new = self.folder.join("fencing.new");
        let mut file = File::create(&new)?;
        for (resource, record) in records {
            let held = if record.held { "held" } else { "free" };
            writeln!(file, "{} {held} {resource}", record.fencing)?;
        }
        file.sync_all()?;
        std::fs::rename(new, self.folder.join("fencing"))?;
        File::open(&self.folder)?.sync_all()
    }
}

impl Keep for FencingFile {
    fn recall(&self, resource: &str) -> io::Result<Record> {
        let records = self.records.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(records.get(resource).copied().unwrap_or_default())
    }

    fn keep(&self, resource: &str, record: Record) -> io::Result<()> {
        let mut records = self.records.lock().unwrap_or_else(PoisonError::into_inner);
        records.insert(resource.to_owned(), record);
        self.write(&records)
    }
}

/// The records, or the line that is none, counted from 1.
fn read(text: &str) -> Result<BTreeMap<String, Record>, usize> {
    let lines = text.lines().enumerate();
    lines
        .map(|(at, line)| read_line(line).ok_or(at + 1))
        .collect()
}

fn read_line(line: &str) -> Option<(String, Record)> {
    let (number, rest) = line.split_once(' ')?;
    let (held, resource) = rest.split_once(' ')?;
    let held = match held {
        "held" => true,
        "free" => false,
        _ => return None,
    };
    let fencing = number.parse().ok()?;
    let named = !resource.is_empty();
    named.then(|| (resource.to_owned(), Record { fencing, held }))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    const HELD: Record = Record {
        fencing: 17,
        held: true,
    };

    #[test]
    fn what_is_kept_is_there_after_a_restart() {
        let folder = tempfile::tempdir().unwrap();
        let state = folder.path().join("robot1/state");
        let file = FencingFile::open(&state).unwrap();
        let mode = std::fs::metadata(&state).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o700);
        assert_eq!(file.recall("door").unwrap(), Record::default());
        file.keep("the door", HELD).unwrap();
        file.keep(
            "lift",
            Record {
                held: false,
                ..HELD
            },
        )
        .unwrap();
        drop(file);
        let file = FencingFile::open(&state).unwrap();
        assert_eq!(file.recall("the door").unwrap(), HELD);
        assert!(!file.recall("lift").unwrap().held);
        assert_eq!(file.recall("door").unwrap(), Record::default());
    }

    #[test]
    fn two_daemons_do_not_share_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let _first = FencingFile::open(folder.path()).unwrap();
        let second = FencingFile::open(folder.path());
        assert!(matches!(second, Err(FencingError::InUse(_))), "{second:?}");
    }

    #[test]
    fn a_file_that_nobody_can_trust_is_named_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        for line in [
            "x held door",
            "7 lost door",
            "7 held",
            "7 held ",
            "-1 held door",
        ] {
            let text = format!("1 free lift\n{line}\n");
            std::fs::write(folder.path().join("fencing"), text).unwrap();
            let error = FencingFile::open(folder.path()).unwrap_err();
            assert!(
                matches!(error, FencingError::Malformed { line: 2, .. }),
                "{line}: {error}"
            );
        }
    }

    #[test]
    fn a_number_that_cannot_be_written_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = FencingFile::open(folder.path()).unwrap();
        std::fs::create_dir(folder.path().join("fencing.new")).unwrap();
        assert!(file.keep("door", HELD).is_err());
    }
}
