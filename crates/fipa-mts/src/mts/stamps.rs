//! Our stamps, as they are written in front of letters.

use std::fmt::Write;

use bytes::{Bytes, BytesMut};
use fipa_acl::{FipaTime, Received, Slots, Text};
use fipa_codec::{EncodeError, Output as Encoded, bit_efficient};
use fipa_directory::InstanceId;

/// Octets that memory is taken for at once: several stamps lie in it. A letter that waits keeps all
/// of it, which is little beside the buffer that it was read into.
const ROOM: usize = 4096;

/// Octets of an ordinary overlay.
const OVERLAY: usize = 256;

/// Writes stamps side by side.
#[derive(Debug)]
pub(super) struct Stamps {
    /// What the numbers of our stamps begin with.
    prefix: String,
    ids: BytesMut,
    overlays: Encoded,
    /// Octets that `overlays` has room for.
    left: usize,
    /// A point in time, in milliseconds since 1970-01-01T00:00:00Z, as it stands in overlays.
    date: (i64, Date),
}

/// A point in time as it stands in an overlay.
pub(super) type Date = [u8; 11];

/// A stamp that is put in front of many letters: only its date and its number change.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Overlay {
    /// Up to the date.
    front: Box<[u8]>,
    /// Between the date and the digits of the number.
    middle: Box<[u8]>,
    /// Behind the digits.
    back: Box<[u8]>,
    /// Octets in front of the digits that count as the number's.
    prefix: usize,
    /// Where in the middle it stands how many octets the number has, in two digits.
    count: usize,
}

impl Overlay {
    /// Writes it.
    pub(super) fn put(&self, date: &Date, number: u64, out: &mut BytesMut) {
        let begin = out.len();
        out.extend_from_slice(&self.front);
        out.extend_from_slice(date);
        let count = out.len() + self.count;
        out.extend_from_slice(&self.middle);
        let digits = put_decimal(number, out);
        out.extend_from_slice(&self.back);
        let octets = (out.len() - begin) as u16;
        if let Some(length) = out.get_mut(begin + 1..begin + 3) {
            length.copy_from_slice(&octets.to_be_bytes());
        }
        if let Some(place) = out.get_mut(count..count + 2) {
            let octets = (self.prefix + digits) as u8;
            place.copy_from_slice(&[b'0' + octets / 10, b'0' + octets % 10]);
        }
    }
}

/// Writes a number, and tells how many digits it has.
fn put_decimal(mut number: u64, out: &mut BytesMut) -> usize {
    let mut digits = [b'0'; 20];
    let mut first = digits.len();
    for digit in digits.iter_mut().rev() {
        *digit = b'0' + (number % 10) as u8;
        first -= 1;
        number /= 10;
        if number == 0 {
            break;
        }
    }
    out.extend_from_slice(digits.get(first..).unwrap_or_default());
    digits.len() - first
}

impl Stamps {
    pub(super) fn new(instance: InstanceId) -> Stamps {
        Stamps {
            prefix: format!("{instance}:"),
            ids: BytesMut::new(),
            overlays: Encoded::new(),
            left: 0,
            date: (i64::MIN, [0; 11]),
        }
    }

    /// Now, as it stands in overlays; `None`: it does not stand there as usual.
    pub(super) fn date(&mut self, unix_millis: i64) -> Option<Date> {
        if self.date.0 != unix_millis {
            let overlay = Slots {
                received: Some(Received {
                    by: Text::from_static("a"),
                    from: None,
                    date: FipaTime::from_unix_millis(unix_millis),
                    id: None,
                    via: None,
                    user_defined: Vec::new(),
                }),
                ..Slots::default()
            };
            // Behind the code, the length, and the name: #1"a and its end.
            let date = *self.encode(&overlay).ok()?.get(8..)?.first_chunk()?;
            self.date = (unix_millis, date);
        }
        Some(self.date.1)
    }

    /// A stamp as it is put in front of many letters, from the one of this number and date; `None`
    /// if it is too long for that.
    pub(super) fn repeated(&mut self, overlay: &Slots, number: u64, date: i64) -> Option<Overlay> {
        let octets = self.encode(overlay).ok()?;
        let date = self.date(date)?;
        let digits = number.to_string();
        let id = [self.prefix.as_bytes(), digits.as_bytes()].concat();
        let date_at = octets.windows(date.len()).position(|place| place == date)?;
        let id_at = octets.windows(id.len()).rposition(|place| place == id)?;
        let (behind, digits_at) = (date_at + date.len(), id_at + self.prefix.len());
        let repeated = Overlay {
            front: octets.get(..date_at)?.into(),
            middle: octets.get(behind..digits_at)?.into(),
            back: octets.get(digits_at + digits.len()..)?.into(),
            prefix: self.prefix.len(),
            // #41" stands in front of a text of 41 octets.
            count: id_at.checked_sub(behind + 3)?,
        };
        let mut again = BytesMut::new();
        repeated.put(&date, number, &mut again);
        let longest = octets.len() + 20 <= usize::from(u16::MAX);
        (longest && again == octets).then_some(repeated)
    }

    /// Whether the number of a stamp is one of ours.
    pub(super) fn is_own(&self, id: &[u8]) -> bool {
        id.starts_with(self.prefix.as_bytes())
    }

    /// The number of the stamp on a copy.
    pub(super) fn id(&mut self, number: u64) -> Text {
        if self.ids.capacity() < OVERLAY {
            self.ids.reserve(ROOM);
        }
        self.ids.extend_from_slice(self.prefix.as_bytes());
        // Nothing that is written to memory fails.
        let _ = write!(self.ids, "{number}");
        Text::from_utf8_lossy(self.ids.split().freeze())
    }

    /// The octets of an overlay.
    pub(super) fn encode(&mut self, overlay: &Slots) -> Result<Bytes, EncodeError> {
        if self.left < OVERLAY {
            self.overlays.reserve(ROOM);
            self.left = ROOM;
        }
        bit_efficient::encode_overlay(overlay, &mut self.overlays)?;
        let octets = self.overlays.take_bytes();
        self.left = self.left.saturating_sub(octets.len());
        Ok(octets)
    }
}
