mod recency;

use std::collections::HashMap;

use bytes::Bytes;

use self::recency::Recency;
use crate::DecodeError;

/// The code table of one direction of a link (SC00069G section 2, notes on code tables): words and
/// strings that were sent once are sent as a number from then on.
///
/// Who writes and who reads each have a table of the same size, and make the same changes to it
/// while a message is written or read: [`encode_message_with`](super::encode_message_with),
/// [`decode_message_with`](super::decode_message_with). A table belongs to one direction of one
/// link that neither loses nor reorders messages. The size is agreed upon elsewhere, and so is
/// when both sides begin anew ([`reset`](Self::reset)).
///
/// * A text that is not in the table gets the smallest free number. Words, string literals and
///   strings with a length are different texts even if they have the same octets: each kind has an
///   index of its own. What enters is the text that is meant, without quotes and escapes.
/// * The content never enters, nor do numbers and dates.
/// * In a full table room is made first: an eighth of the entries, those that were not used for
///   the longest time. To write, to read an index of, or to meet again is to use.
///
/// # What goes wrong
///
/// A message that cannot be read leaves the two tables different, and so may a message that got
/// lost. After an error while a message with a table was being read, the table answers every
/// further message with the same error until it is reset. The loss of a message that added nothing
/// is harmless until entries are removed; the loss of one that added something is noticed when a
/// number comes that is free. The format cannot tell when a number that means one text here means
/// another one there: whoever cannot rely on the link must not use a table.
#[derive(Debug)]
pub struct CodeTable {
    size: usize,
    /// The entries by number; removed ones are empty.
    entries: Vec<Option<Entry>>,
    /// The numbers of the entries by text, for each kind.
    numbers: [HashMap<Bytes, u16>; 3],
    /// Removed numbers, the smallest last.
    free: Vec<u16>,
    recency: Recency,
    /// Octets of all entries.
    octets: usize,
    /// Texts added since the table was made.
    added: u64,
    broken: Option<DecodeError>,
}

#[derive(Debug)]
struct Entry {
    kind: Kind,
    octets: Bytes,
}

/// In which form a text entered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Word,
    Literal,
    Counted,
}

/// The code table of a message that is being written or read.
pub(super) struct Coding<'a> {
    pub(super) table: &'a mut CodeTable,
    /// Whether the texts of the message enter it.
    pub(super) learns: bool,
}

/// The number of entries is not one that a code table can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a code table has 256 to 65536 entries")]
pub struct InvalidTableSize;

/// What is wrong with the number of no entry.
pub(super) const NO_ENTRY: &str = "nothing has this number in the code table";

/// Octets that the entries of one table have together at most: a bound for what a peer can make us
/// keep.
const MAX_OCTETS: usize = 16 << 20;

impl CodeTable {
    /// A table without entries that has room for 256 to 65,536 of them. Numbers are written in one
    /// octet if there are 256, else in two.
    pub fn new(entries: usize) -> Result<CodeTable, InvalidTableSize> {
        if !(256..=65_536).contains(&entries) {
            return Err(InvalidTableSize);
        }
        Ok(CodeTable {
            size: entries,
            entries: Vec::new(),
            numbers: Default::default(),
            free: Vec::new(),
            recency: Recency::default(),
            octets: 0,
            added: 0,
            broken: None,
        })
    }

    /// Entries that there is room for.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Entries that there are.
    pub fn len(&self) -> usize {
        self.entries.len() - self.free.len()
    }

    /// Whether there are no entries.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Removes all entries, and makes the table usable again after an error. The other side must
    /// do the same between the same two messages.
    pub fn reset(&mut self) {
        self.entries.clear();
        self.numbers = Default::default();
        self.free.clear();
        self.recency = Recency::default();
        self.octets = 0;
        self.broken = None;
    }

    /// The error after which the table must be reset, if there was one.
    pub fn broken(&self) -> Option<&DecodeError> {
        self.broken.as_ref()
    }

    /// Refuses everything until the table is reset.
    pub(super) fn break_with(&mut self, error: DecodeError) -> DecodeError {
        self.broken.insert(error).clone()
    }

    /// Whether numbers are written in two octets.
    pub(super) fn is_wide(&self) -> bool {
        self.size > 256
    }

    /// Texts added since the table was made.
    pub(super) fn added(&self) -> u64 {
        self.added
    }

    /// Whether texts of so many octets together can be added.
    pub(super) fn has_room_for(&self, octets: usize) -> bool {
        octets <= MAX_OCTETS - self.octets
    }

    /// The text with this number.
    pub(super) fn get(&self, number: u16) -> Option<Bytes> {
        let entry = self.entries.get(usize::from(number))?.as_ref()?;
        Some(entry.octets.clone())
    }

    /// Uses the text with this number, if there is one.
    pub(super) fn use_number(&mut self, number: u16) -> bool {
        let is_there = matches!(self.entries.get(usize::from(number)), Some(Some(_)));
        if is_there {
            self.recency.touch(number);
        }
        is_there
    }

    /// The number of this text, which is thereby used.
    pub(super) fn number(&mut self, kind: Kind, octets: &[u8]) -> Option<u16> {
        let number = *self.numbers[kind as usize].get(octets)?;
        self.recency.touch(number);
        Some(number)
    }

    /// Uses this text, or adds it.
    pub(super) fn met(&mut self, kind: Kind, octets: &[u8]) -> Result<(), &'static str> {
        if self.number(kind, octets).is_some() {
            return Ok(());
        }
        if !self.has_room_for(octets.len()) {
            return Err("the texts of the code table are too long together");
        }
        self.add(kind, octets);
        Ok(())
    }

    /// Adds a text that is not in the table.
    pub(super) fn add(&mut self, kind: Kind, octets: &[u8]) {
        if self.len() >= self.size {
            self.make_room();
        }
        let number = self.free_number();
        // A copy: an entry must not keep the buffer of a whole message alive.
        let octets = Bytes::copy_from_slice(octets);
        self.octets += octets.len();
        self.added += 1;
        self.numbers[kind as usize].insert(octets.clone(), number);
        if let Some(place) = self.entries.get_mut(usize::from(number)) {
            *place = Some(Entry { kind, octets });
        }
        self.recency.insert(number);
    }

    /// The smallest free number, with a place for its entry.
    fn free_number(&mut self) -> u16 {
        self.free.pop().unwrap_or_else(|| {
            let next = self.entries.len();
            self.entries.push(None);
            u16::try_from(next).unwrap_or(u16::MAX)
        })
    }

    /// Removes an eighth of the entries, those that were used least recently.
    fn make_room(&mut self) {
        for _ in 0..self.size >> 3 {
            let Some(number) = self.recency.remove_oldest() else {
                break;
            };
            let place = self.entries.get_mut(usize::from(number));
            if let Some(entry) = place.and_then(Option::take) {
                self.octets -= entry.octets.len();
                self.numbers[entry.kind as usize].remove(&entry.octets);
            }
            self.free.push(number);
        }
        // The table was full: there were no free numbers before.
        self.free.sort_unstable_by(|a, b| b.cmp(a));
    }
}
