//! Directory entries as strings of a TXT record.
use fipa_acl::Text;
use fipa_directory::{Entry, InstanceId, Location};

use super::{key, label, name_of, timestamp};

/// One string of a TXT record: its key, and the value behind the `=`.
pub(crate) type TxtString = (String, Vec<u8>);

const TYPE: &str = "TYPE";
const LOCATOR: &str = "LOCATOR";
const DESCRIPTION: &str = "DESCRIPTION";
const TIMESTAMP: &str = "TIMESTAMP";
/// The true name, where it is not the one that the label is read as. Only this program writes it.
const NAME: &str = "NAME";
/// The instance id of the daemon. Only this program writes it.
const ID: &str = "ID";

/// What all strings of an entry may have in octets, their lengths included. A C++ reader takes no
/// more.
const MOST: usize = 1300;

/// An entry as it is announced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Announcement {
    pub(crate) strings: Vec<TxtString>,
    /// Whether locations or a part of the description had to be left out.
    pub(crate) shortened: bool,
}

/// The strings of an entry; `None` if what must be told does not fit.
///
/// Whole locations from the end are left out before the description is cut, and neither is
/// begun before the rest has found its place.
pub(crate) fn write(entry: &Entry, instance: InstanceId) -> Option<Announcement> {
    let timestamp = timestamp::write(entry.timestamp);
    let true_name = label(&entry.name).is_none_or(|label| name_of(&label) != *entry.name);
    let name = if true_name { entry.name.as_str() } else { "" };
    let id = instance.to_string();
    let fixed = [
        (TYPE, entry.kind.as_str()),
        (TIMESTAMP, &timestamp),
        (NAME, name),
        (ID, &id),
    ];
    let fixed: usize = fixed.iter().map(|(key, value)| size(key, value)).sum();
    let room = MOST.checked_sub(fixed)?;
    let (locator, all) = locator(&entry.locations, room);
    let description = fitting(&entry.description, room - size(LOCATOR, &locator));
    let shortened = !all || description.len() < entry.description.len();
    let values = [
        (TYPE, entry.kind.as_str()),
        (LOCATOR, &locator),
        (DESCRIPTION, description),
        (TIMESTAMP, &timestamp),
        (NAME, name),
        (ID, &id),
    ];
    let strings = values.iter().flat_map(|(key, value)| {
        let chunks = value.as_bytes().chunks(longest(key));
        chunks.map(|chunk| ((*key).to_owned(), chunk.to_vec()))
    });
    Some(Announcement {
        strings: strings.collect(),
        shortened,
    })
}

/// The daemon that announces an entry, and the entry.
///
/// Nothing is an error: what is missing or malformed is empty. Strings of the same key belong
/// together.
pub(crate) fn read(instance_label: &str, strings: &[TxtString]) -> (Option<InstanceId>, Entry) {
    let value = |key: &str| {
        let same = strings.iter().filter(|(k, _)| k.eq_ignore_ascii_case(key));
        let octets: Vec<u8> = same.flat_map(|(_, value)| value).copied().collect();
        Text::from_utf8_lossy(octets.into())
    };
    // A name that does not belong to the label would let one agent appear as another.
    let told = value(NAME);
    let belongs = label(&told).is_some_and(|own| key(&own) == key(instance_label));
    let mut entry = match belongs {
        true => Entry::new(told),
        false => Entry::new(name_of(instance_label)),
    };
    entry.kind = value(TYPE);
    entry.locations = locations(&value(LOCATOR));
    entry.description = value(DESCRIPTION);
    entry.timestamp = timestamp::read(&value(TIMESTAMP)).unwrap_or_default();
    (value(ID).parse().ok(), entry)
}

/// The locations of `ADDRESS[ SIGNATURE[ SERVICE_SIGNATURE]];…`; the `;` at the end may be missing.
fn locations(locator: &str) -> Vec<Location> {
    let location = |piece: &str| {
        let mut fields = piece.split_ascii_whitespace();
        Some(Location {
            address: fields.next()?.into(),
            signature: fields.next().unwrap_or_default().into(),
        })
    };
    locator.split(';').filter_map(location).collect()
}

/// As many locations as there is room for, and whether that is all of them.
fn locator(locations: &[Location], room: usize) -> (String, bool) {
    let mut locator = String::new();
    let mut all = true;
    for Location { address, signature } in locations {
        let separators = |c: char| c == ';' || c.is_whitespace();
        let before = locator.len();
        if !address.contains(separators) && !signature.contains(separators) {
            locator.push_str(address);
            locator.push(' ');
            locator.push_str(signature);
            locator.push(';');
        }
        if locator.len() == before || size(LOCATOR, &locator) > room {
            locator.truncate(before);
            all = false;
        }
    }
    (locator, all)
}

/// The longest beginning of a description that has room.
fn fitting(description: &str, room: usize) -> &str {
    let mut length = description.floor_char_boundary(room);
    while size(DESCRIPTION, &description[..length]) > room {
        length = description.floor_char_boundary(length.saturating_sub(1));
    }
    &description[..length]
}

/// The longest value that goes into one string: a C++ writer cuts its values so, too.
fn longest(key: &str) -> usize {
    199 - key.len()
}

/// How many octets the strings of a value have, with their lengths and keys.
fn size(key: &str, value: &str) -> usize {
    let strings = value.len().div_ceil(longest(key));
    value.len() + strings * (1 + key.len() + 1)
}

#[cfg(test)]
mod tests;
