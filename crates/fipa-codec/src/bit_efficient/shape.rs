use std::ops::Range;

use bytes::Bytes;
use fipa_acl::Slots;

use super::reader::Reader;
use super::times::read_time;
use crate::{DecodeError, Limits};

/// What envelopes have in common that differ in nothing but dates, lengths and the numbers of their
/// stamps: those of letters that one agent writes to another, by one way.
///
/// Whether an envelope has a shape that is known is found out without reading it into slots.
#[derive(Clone, Debug)]
pub struct EnvelopeShape {
    octets: Bytes,
    /// What may differ, in its order.
    places: Vec<Place>,
    limits: Limits,
}

/// A place in an envelope at which others of its shape may differ.
#[derive(Clone, Debug)]
struct Place {
    range: Range<usize>,
    kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// The length of a layer.
    Length,
    /// Where that layer ends.
    End,
    Date,
    PayloadLength,
    /// The number of a stamp.
    Number,
}

impl EnvelopeShape {
    /// The shape of the envelope at the beginning of the input. `None`: it is written in a way that
    /// is out of the ordinary, and has none.
    pub fn of(octets: &Bytes, limits: &Limits) -> Result<Option<EnvelopeShape>, DecodeError> {
        let mut reader = Reader::new(octets, limits);
        let mut places = Vec::new();
        if !walk(&mut reader, &mut places)? {
            return Ok(None);
        }
        Ok(Some(EnvelopeShape {
            octets: Bytes::copy_from_slice(octets.get(..reader.position()).unwrap_or_default()),
            places,
            limits: *limits,
        }))
    }

    /// The envelope of which this is the shape.
    pub fn octets(&self) -> &Bytes {
        &self.octets
    }

    /// Whether the input begins with an envelope of this shape; then where its payload begins. What
    /// is told so can be read, and is no different but for what may differ.
    ///
    /// `stamp` is told the number of each stamp, that of the newest first, and whether to go on.
    pub fn fits(&self, octets: &Bytes, mut stamp: impl FnMut(&[u8]) -> bool) -> Option<usize> {
        let mut reader = Reader::new(octets, &self.limits);
        let mut known = 0;
        let mut layer = (0, 0);
        for Place { range, kind } in &self.places {
            same(&mut reader, self.octets.get(known..range.start)?)?;
            known = range.end;
            let usual = self.octets.get(range.clone())?;
            match kind {
                Kind::Length => {
                    let begin = reader.position() - 1;
                    layer = (begin, u16::from_be_bytes(reader.array().ok()?).into());
                }
                Kind::End => {
                    if reader.position() - layer.0 != layer.1 {
                        return None;
                    }
                }
                Kind::Date | Kind::PayloadLength if reader.rest().starts_with(usual) => {
                    reader.counted(usual.len()).ok()?;
                }
                Kind::Date => {
                    if reader.peek().ok()? != *usual.first()? {
                        return None;
                    }
                    read_time(&mut reader).ok()?;
                }
                Kind::PayloadLength => drop(reader.payload_length().ok()?),
                Kind::Number => {
                    let number = reader.find_literal().ok()?.as_it_stands()?;
                    if !number.is_ascii() || !stamp(number) {
                        return None;
                    }
                }
            }
        }
        same(&mut reader, self.octets.get(known..)?)?;
        Some(reader.position())
    }
}

/// Steps over these octets, which must be the next ones.
fn same(reader: &mut Reader<'_>, octets: &[u8]) -> Option<()> {
    let next = reader.counted(octets.len()).ok()?;
    (next == octets).then_some(())
}

/// Reads an envelope and notes what may differ in others. Whether all of it is as usual.
fn walk(reader: &mut Reader<'_>, places: &mut Vec<Place>) -> Result<bool, DecodeError> {
    for layers in 1.. {
        reader.check_layers(layers)?;
        let begin = reader.position();
        let code = reader.octet()?;
        let length = reader.position();
        let announced = usize::from(u16::from_be_bytes(reader.array()?));
        // Another length follows, of one that is very long.
        if announced == 0 {
            return Ok(false);
        }
        note(places, reader, length, Kind::Length);
        let usual = match code {
            0xfd => walk_stamp(reader, places)?,
            0xfe => {
                reader.representation()?;
                walk_date(reader, places)?;
                true
            }
            _ => false,
        };
        if !usual || !walk_slots(reader, places)? || reader.position() - begin != announced {
            return Ok(false);
        }
        note(places, reader, reader.position(), Kind::End);
        if code == 0xfe {
            break;
        }
    }
    Ok(true)
}

fn walk_stamp(reader: &mut Reader<'_>, places: &mut Vec<Place>) -> Result<bool, DecodeError> {
    // An encoder that begins otherwise, or an overlay without a stamp.
    if matches!(reader.peek()?, 0x0a | 0x00) {
        return Ok(false);
    }
    reader.null_terminated()?;
    walk_date(reader, places)?;
    loop {
        match reader.octet()? {
            0x00 => drop(reader.user_text()?),
            0x01 => return Ok(true),
            0x02 | 0x04 => drop(reader.null_terminated()?),
            0x03 => {
                let begin = reader.position();
                reader.null_terminated()?;
                note(places, reader, begin, Kind::Number);
            }
            _ => return Ok(false),
        }
    }
}

fn walk_slots(reader: &mut Reader<'_>, places: &mut Vec<Place>) -> Result<bool, DecodeError> {
    let mut slots = Slots::default();
    loop {
        match reader.octet()? {
            0x01 => return Ok(true),
            0x06 => {
                let begin = reader.position();
                reader.payload_length()?;
                note(places, reader, begin, Kind::PayloadLength);
            }
            code @ (0x00 | 0x02..=0x05 | 0x07 | 0x09 | 0x0b) => reader.slot(code, &mut slots)?,
            _ => return Ok(false),
        }
    }
}

fn walk_date(reader: &mut Reader<'_>, places: &mut Vec<Place>) -> Result<(), DecodeError> {
    let begin = reader.position();
    read_time(reader)?;
    note(places, reader, begin, Kind::Date);
    Ok(())
}

fn note(places: &mut Vec<Place>, reader: &Reader<'_>, begin: usize, kind: Kind) {
    let range = begin..reader.position();
    places.push(Place { range, kind });
}
