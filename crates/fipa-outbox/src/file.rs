//! The file: a table of letters by their numbers.

use std::io::ErrorKind;
use std::path::PathBuf;

use bytes::Bytes;
use fipa_acl::Text;
use fipa_mts::StoredLetter;
use redb::{
    Builder, Database, DatabaseError, ReadableDatabase, ReadableTable, StorageError,
    TableDefinition,
};

use crate::OpenError;

/// The name of the file in its directory.
pub const FILE_NAME: &str = "outbox.redb";

/// Octets of the file that are held in memory; it is written, and read once.
const CACHE: usize = 4 << 20;

/// Receiver, its platform, since when, reply-by, octets.
type Value = (&'static str, &'static str, i64, Option<i64>, &'static [u8]);

const LETTERS: TableDefinition<'_, u64, Value> = TableDefinition::new("letters-1");

#[derive(Debug)]
pub(crate) struct OutboxFile {
    path: PathBuf,
    /// `None` after a failure, until it is opened anew.
    database: Option<Database>,
}

/// What is to be written.
pub(crate) enum Change {
    Put(StoredLetter),
    Remove(u64),
}

impl OutboxFile {
    pub(crate) fn open(path: PathBuf) -> Result<(OutboxFile, Vec<StoredLetter>), OpenError> {
        let database = match open_database(&path, true) {
            Ok(database) => database,
            Err(error) => return Err(explain(path, &error)),
        };
        let damaged = |error: redb::Error| OpenError::Damaged {
            path: path.clone(),
            reason: error.to_string(),
        };
        let letters = read(&database).map_err(damaged)?;
        let database = Some(database);
        Ok((OutboxFile { path, database }, letters))
    }

    /// Does all of it, or nothing; it is on the disk then.
    pub(crate) fn write<'a>(
        &mut self,
        changes: impl Iterator<Item = &'a Change>,
    ) -> Result<(), String> {
        let database = match &mut self.database {
            Some(database) => database,
            none => {
                let opened = open_database(&self.path, false);
                none.insert(opened.map_err(|error| error.to_string())?)
            }
        };
        let written = write(database, changes);
        if written.is_err() {
            self.database = None;
        }
        written.map_err(|error| error.to_string())
    }
}

fn open_database(path: &PathBuf, thorough: bool) -> Result<Database, DatabaseError> {
    let mut builder = Builder::new();
    builder.set_cache_size(CACHE);
    builder.set_check_integrity_on_open(thorough);
    builder.create(path)
}

fn explain(path: PathBuf, error: &DatabaseError) -> OpenError {
    let reason = error.to_string();
    match error {
        DatabaseError::DatabaseAlreadyOpen => OpenError::InUse(path),
        DatabaseError::Storage(StorageError::Io(io)) if io.kind() != ErrorKind::InvalidData => {
            OpenError::Unusable { path, reason }
        }
        _ => OpenError::Damaged { path, reason },
    }
}

fn read(database: &Database) -> Result<Vec<StoredLetter>, redb::Error> {
    let transaction = database.begin_read()?;
    let table = match transaction.open_table(LETTERS) {
        Err(redb::TableError::TableDoesNotExist(_)) => return Ok(Vec::new()),
        table => table?,
    };
    let mut letters = Vec::new();
    for entry in table.iter()? {
        let (key, value) = entry?;
        let (to, peer, since, reply_by, octets) = value.value();
        letters.push(StoredLetter {
            key: key.value(),
            to: Text::from(to),
            peer: Text::from(peer),
            since,
            reply_by,
            octets: Bytes::copy_from_slice(octets),
        });
    }
    Ok(letters)
}

fn write<'a>(
    database: &Database,
    changes: impl Iterator<Item = &'a Change>,
) -> Result<(), redb::Error> {
    let transaction = database.begin_write()?;
    {
        let mut table = transaction.open_table(LETTERS)?;
        for change in changes {
            match change {
                Change::Put(letter) => {
                    let value = (
                        letter.to.as_str(),
                        letter.peer.as_str(),
                        letter.since,
                        letter.reply_by,
                        &letter.octets[..],
                    );
                    table.insert(letter.key, value)?;
                }
                Change::Remove(key) => {
                    table.remove(key)?;
                }
            }
        }
    }
    transaction.commit()?;
    Ok(())
}
