use bytes::{BufMut, BytesMut};
use fipa_acl::Text;

use crate::wire::{FrameError, Reader, put_list, put_text};
use crate::{Parts, ReceiverOutcome};

/// Something that passed a message transport service, told to a program that watches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sniffed {
    /// Counts what passes, in the order in which it came.
    pub number: u64,
    /// When it came, in milliseconds since 1970-01-01T00:00:00Z.
    pub unix_millis: i64,
    /// How much was not told to this watcher before this, since it did not keep up.
    pub lost: u64,
    /// What it is.
    pub passed: Passed,
}

/// What a watcher is told of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Passed {
    /// The watch has begun: what comes from now on is told.
    Begin,
    /// The watch has ended.
    End,
    /// A letter, told once all its outcomes are known; without outcomes when the watch ended
    /// before.
    Letter {
        /// The service or program that handed it over; empty: an agent in the service's process.
        from: Text,
        /// The transport by which it came; empty: none.
        via: Text,
        /// One outcome a receiver.
        outcomes: Vec<ReceiverOutcome>,
        /// Its octets as they came, the envelope bit-efficient.
        parts: Parts,
    },
    /// A message of another protocol, between the service and a device of its robot.
    Inside(Inside),
}

/// A message between a service and a device of its robot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Inside {
    /// The protocol: `text` or `hiac`.
    pub protocol: Text,
    /// Whether it came from the device.
    pub incoming: bool,
    /// Where the device is, as a URL.
    pub place: Text,
    /// The message, in the form in which programs are shown it.
    pub form: Text,
}

impl Sniffed {
    /// Octets of what it holds.
    pub fn octets(&self) -> usize {
        match &self.passed {
            Passed::Begin | Passed::End => 0,
            Passed::Letter { parts, .. } => parts.octets(),
            Passed::Inside(inside) => inside.form.len(),
        }
    }

    /// Writes it, save for the parts of a letter that are returned.
    pub(crate) fn put(self, out: &mut BytesMut) -> Parts {
        out.put_u64(self.number);
        out.put_i64(self.unix_millis);
        out.put_u64(self.lost);
        match self.passed {
            Passed::Begin => out.put_u8(0),
            Passed::End => out.put_u8(1),
            Passed::Letter {
                from,
                via,
                outcomes,
                parts,
            } => {
                out.put_u8(2);
                put_text(out, &from);
                put_text(out, &via);
                put_list(out, &outcomes, ReceiverOutcome::put);
                return parts;
            }
            Passed::Inside(inside) => {
                out.put_u8(3);
                put_text(out, &inside.protocol);
                out.put_u8(u8::from(inside.incoming));
                put_text(out, &inside.place);
                put_text(out, &inside.form);
            }
        }
        Parts::default()
    }

    pub(crate) fn read(mut r: Reader) -> Result<Sniffed, FrameError> {
        Ok(Sniffed {
            number: r.u64()?,
            unix_millis: r.i64()?,
            lost: r.u64()?,
            passed: match r.u8()? {
                0 => Passed::Begin,
                1 => Passed::End,
                2 => Passed::Letter {
                    from: r.text()?,
                    via: r.text()?,
                    outcomes: r.list(ReceiverOutcome::read)?,
                    parts: r.rest().into(),
                },
                3 => Passed::Inside(Inside {
                    protocol: r.text()?,
                    incoming: r.u8()? != 0,
                    place: r.text()?,
                    form: r.text()?,
                }),
                _ => return Err(r.undefined()),
            },
        })
    }
}
