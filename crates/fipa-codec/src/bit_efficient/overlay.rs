use bytes::{Bytes, BytesMut};
use fipa_acl::{Envelope, Slots};

use super::envelope_writer::write_overlay;
use super::options::Newest;
use super::reader::Reader;
use crate::{DecodeError, Dialect, EncodeError, Limits};

/// Why an overlay could not be added to a letter.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InsertError {
    /// The letter has no place for it that could be found.
    #[error("the letter: {0}")]
    Letter(#[from] DecodeError),
    /// The overlay cannot be written.
    #[error("the overlay: {0}")]
    Overlay(#[from] EncodeError),
}

/// A letter (SC00088D section 2) with one more overlay, as a peer needs it: in front of everything
/// (SC00088D section 2.2), or directly in front of the base.
///
/// The letter is given as parts that follow each other, its envelope within the first one if
/// possible. Its octets are passed on as they are, and shared.
///
/// Where a peer has the newest overlay last, those that stand in front of everything are older for
/// it, but newer for readers that know whose overlay has which length. So a letter for such a peer
/// is best one that came from such a peer or has no overlay yet.
pub fn insert_overlay_as(
    dialect: Dialect,
    letter: &[Bytes],
    overlay: &Slots,
    limits: &Limits,
) -> Result<Vec<Bytes>, InsertError> {
    let options = dialect.bit_efficient();
    let (mut parts, behind, payload) = match options.newest {
        Newest::First => (Vec::new(), letter.to_vec(), 0),
        Newest::Last => split_at_base(letter, limits)?,
    };
    let mut octets = BytesMut::with_capacity(OVERLAY);
    write_overlay(overlay, payload, options, &mut octets)?;
    parts.push(octets.freeze());
    parts.extend(behind);
    Ok(parts)
}

/// Octets of an ordinary overlay.
const OVERLAY: usize = 256;

/// What is in front of the base, the base with what follows, and how long the payload is.
fn split_at_base(
    letter: &[Bytes],
    limits: &Limits,
) -> Result<(Vec<Bytes>, Vec<Bytes>, u64), DecodeError> {
    let len: usize = letter.iter().map(Bytes::len).sum();
    let (first, others) = match letter {
        [] => (Bytes::new(), letter),
        [first, others @ ..] => (first.clone(), others),
    };
    let (head, others, (base, payload)) = match places(&first, limits) {
        Err(_) if !others.is_empty() => {
            let whole = Bytes::from(letter.concat());
            let places = places(&whole, limits)?;
            (whole, &[][..], places)
        }
        places => (first, others, places?),
    };
    let mut behind = vec![head.slice(base..)];
    behind.extend_from_slice(others);
    let front = (base > 0).then(|| head.slice(..base));
    Ok((front.into_iter().collect(), behind, count(len - payload)))
}

/// Where the base and the payload begin.
fn places(octets: &Bytes, limits: &Limits) -> Result<(usize, usize), DecodeError> {
    let mut reader = Reader::new(octets, limits);
    let base = reader.envelope(&mut Envelope::default())?;
    Ok((base, reader.position()))
}

pub(super) fn count(octets: usize) -> u64 {
    u64::try_from(octets).unwrap_or(u64::MAX)
}
