//! The letter log: what passes the daemon, one JSON object a line, in a file.
//!
//! ```text
//!   Platform ── Sniffer ──▶ thread: JSON, whole lines ──▶ FILE
//! ```
//!
//! A thread of its own writes, so that no letter waits for the disk. A file that was moved away or
//! deleted is opened anew. While nothing can be written the daemon goes on; what is missing then is
//! counted, and stands in the log as soon as there is room.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use fipa::{Passed, Platform, Sniffed, Sniffer, open_letter};
use fipa_json::sniffed_to_json;
use tokio::sync::oneshot;

/// Octets that are written in one go.
const BATCH: usize = 1 << 20;

/// How long the end of the daemon waits for the last lines.
const LAST_LINES: Duration = Duration::from_millis(500);

/// The letter log cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("cannot open the letter log {}: {source}", path.display())]
pub(crate) struct OpenLogError {
    path: PathBuf,
    source: io::Error,
}

/// A letter log that is being written.
pub(crate) struct LetterLog {
    ended: oneshot::Receiver<()>,
}

impl LetterLog {
    /// Opens the log and begins to write. What is there stays.
    pub(crate) fn start(platform: &Platform, path: &Path) -> Result<LetterLog, OpenLogError> {
        let failed = |source| OpenLogError {
            path: path.to_owned(),
            source,
        };
        let log = LogFile::open(path).map_err(failed)?;
        let sniffer = platform.sniff();
        let (end, ended) = oneshot::channel();
        let thread = std::thread::Builder::new().name("letter-log".to_owned());
        let write = move || {
            write_all(sniffer, log);
            // The daemon may be gone already.
            let _ = end.send(());
        };
        thread.spawn(write).map_err(failed)?;
        Ok(LetterLog { ended })
    }

    /// Waits until the last lines are written, once the platform has ended.
    pub(crate) async fn wait(self) {
        // A disk that stands still does not keep the daemon.
        let _ = tokio::time::timeout(LAST_LINES, self.ended).await;
    }
}

fn write_all(mut sniffer: Sniffer, mut log: LogFile) {
    let mut lines = String::new();
    while let Some(mut sniffed) = sniffer.blocking_next() {
        lines.clear();
        let mut count = weight(&sniffed);
        sniffed.lost += log.lost;
        put(&mut lines, &sniffed);
        while lines.len() < BATCH
            && let Some(sniffed) = sniffer.try_next()
        {
            count += weight(&sniffed);
            put(&mut lines, &sniffed);
        }
        if !lines.is_empty() {
            log.write(&lines, count);
        }
    }
}

/// How much is missing where this is.
fn weight(sniffed: &Sniffed) -> u64 {
    let is_mark = matches!(sniffed.passed, Passed::Begin | Passed::End);
    sniffed.lost + u64::from(!is_mark)
}

fn put(lines: &mut String, sniffed: &Sniffed) {
    for line in sniffed_to_json(sniffed, open_letter) {
        lines.push_str(&line.to_string());
        lines.push('\n');
    }
}

/// A file that grows at its end.
struct LogFile {
    path: PathBuf,
    file: File,
    /// What could not be written since something was.
    lost: u64,
}

impl LogFile {
    fn open(path: &Path) -> io::Result<LogFile> {
        Ok(LogFile {
            path: path.to_owned(),
            file: open(path)?,
            lost: 0,
        })
    }

    /// Writes lines that tell of so much, and of what was lost before.
    fn write(&mut self, lines: &str, count: u64) {
        match self.try_write(lines.as_bytes()) {
            Ok(()) => {
                if self.lost > 0 {
                    let (path, lost) = (self.path.display(), self.lost);
                    tracing::warn!("the letter log {path} is written again; {lost} are missing");
                }
                self.lost = 0;
            }
            Err(error) => {
                if self.lost == 0 {
                    let path = self.path.display();
                    tracing::error!("the letter log {path} cannot be written: {error}");
                }
                self.lost += count;
            }
        }
    }

    fn try_write(&mut self, lines: &[u8]) -> io::Result<()> {
        if self.was_moved()? {
            self.file = open(&self.path)?;
        }
        let before = self.file.metadata()?;
        self.file.write_all(lines).inspect_err(|_| {
            // A line of which there was no room for the end would spoil the next one.
            if before.is_file() {
                let _ = self.file.set_len(before.len());
            }
        })
    }

    /// Whether another file is, or none, where this one was opened.
    fn was_moved(&self) -> io::Result<bool> {
        let open = self.file.metadata()?;
        match std::fs::metadata(&self.path) {
            Ok(there) => Ok((there.dev(), there.ino()) != (open.dev(), open.ino())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(true),
            Err(error) => Err(error),
        }
    }
}

/// Opens a log, which only its owner may read: letters are nobody else's business.
fn open(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    let mut file = options.append(true).create(true).mode(0o600).open(path)?;
    if ends_within_line(path, &file)? {
        file.write_all(b"\n")?;
    }
    Ok(file)
}

/// Whether the last line was not finished: the machine lost its power meanwhile.
fn ends_within_line(path: &Path, file: &File) -> io::Result<bool> {
    let about = file.metadata()?;
    if !about.is_file() || about.len() == 0 {
        return Ok(false);
    }
    let mut last = [0];
    let mut there = File::open(path)?;
    there.seek(SeekFrom::End(-1))?;
    there.read_exact(&mut last)?;
    Ok(last != *b"\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(path: &Path) -> String {
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn a_log_that_is_moved_or_deleted_goes_on_in_a_new_file() {
        let folder = tempfile::tempdir().unwrap();
        let (path, old) = (folder.path().join("log"), folder.path().join("old"));
        let mut log = LogFile::open(&path).unwrap();
        log.write("1\n", 1);
        std::fs::rename(&path, &old).unwrap();
        log.write("2\n", 1);
        assert_eq!((text(&old), text(&path)), ("1\n".into(), "2\n".into()));
        std::fs::remove_file(&path).unwrap();
        log.write("3\n", 1);
        log.write("4\n", 1);
        assert_eq!(text(&path), "3\n4\n");
        assert_eq!(log.lost, 0);
    }

    #[test]
    fn what_is_there_stays_and_a_line_that_was_not_finished_spoils_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log");
        std::fs::write(&path, "{\"event\"").unwrap();
        LogFile::open(&path).unwrap().write("1\n", 1);
        assert_eq!(text(&path), "{\"event\"\n1\n");
        LogFile::open(&path).unwrap().write("2\n", 1);
        assert_eq!(text(&path), "{\"event\"\n1\n2\n");
    }

    #[test]
    fn what_finds_no_room_is_counted_until_there_is_some() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log");
        std::os::unix::fs::symlink("/dev/full", &path).unwrap();
        let mut log = LogFile::open(&path).unwrap();
        log.write("1\n", 1);
        log.write("2\n3\n", 2);
        assert_eq!(log.lost, 3);
        std::fs::remove_file(&path).unwrap();
        log.write("4\n", 1);
        assert_eq!(log.lost, 0);
        assert_eq!(text(&path), "4\n");
    }
}
