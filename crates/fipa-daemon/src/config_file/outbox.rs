use std::time::Duration;

use fipa::OutboxConfig;

use super::Wrong;
use super::entry::Entry;
use crate::options::value;

/// The keys of the table.
const KEYS: [&str; 4] = ["letters", "bytes", "total-bytes", "hours"];

/// The table `[outbox]`: the limits of what is stored for robots that are away.
pub(super) fn read(entry: &Entry<'_>) -> Result<OutboxConfig, Wrong> {
    let mut limits = OutboxConfig::default();
    let mut entries: Vec<_> = entry.table()?.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    for (key, value) in entries {
        let entry = Entry {
            key: key.get_ref().as_ref(),
            value,
        };
        match entry.key {
            "letters" => limits.letters = entry.number(value::amount)?,
            "bytes" => limits.octets = entry.number(value::amount)?,
            "total-bytes" => limits.total_octets = entry.number(value::amount)?,
            "hours" => {
                let hours = entry.number(value::hours)?;
                limits.age = Duration::from_secs(hours * 3600);
            }
            _ => return Err(Wrong::key(key, &KEYS)),
        }
    }
    Ok(limits)
}
