use bytes::Bytes;
use fipa_acl::{Envelope, Received, Representation, Slots, Text, canonical_user_name};

use super::agents::Notation;
use super::numbers::read_count;
use super::reader::Reader;
use super::times::read_time;
use crate::{DecodeError, Fault};

/// What stands in front of the parameters of one layer.
struct LayerHead {
    start: usize,
    announced: usize,
    is_base: bool,
}

impl Reader<'_> {
    /// ExtEnvelope* BaseEnvelope of SC00088D, into its place; tells where the base begins.
    pub(super) fn envelope(&mut self, envelope: &mut Envelope) -> Result<usize, DecodeError> {
        let (overlays, begin) = self.layers(&mut envelope.base)?;
        envelope.overlays = travel_order(overlays);
        Ok(begin)
    }

    /// ExtEnvelope* BaseEnvelope of SC00088D, each where it stands.
    pub(super) fn layers_as_they_stand(&mut self) -> Result<Vec<Slots>, DecodeError> {
        let mut base = Slots::default();
        let (overlays, _) = self.layers(&mut base)?;
        let overlays = overlays.into_iter().map(|(slots, _)| slots);
        Ok(overlays.chain([base]).collect())
    }

    /// The overlays as they stand there, with whether their announced lengths are true; reads the
    /// base into its place, and tells where it begins.
    #[inline]
    fn layers(&mut self, base: &mut Slots) -> Result<(Vec<(Slots, bool)>, usize), DecodeError> {
        let mut overlays = Vec::new();
        loop {
            self.check_layers(overlays.len() + 1)?;
            match self.octet()? {
                0xfd => overlays.push(self.overlay()?),
                0xfe => {
                    let begin = self.position() - 1;
                    self.base(base)?;
                    return Ok((overlays, begin));
                }
                _ => return Err(self.unexpected("no envelope begins like this")),
            }
        }
    }

    fn base(&mut self, slots: &mut Slots) -> Result<(), DecodeError> {
        let head = self.head(true)?;
        slots.acl_representation = Some(self.representation()?);
        slots.date = Some(read_time(self)?);
        self.slots(&head, slots)
    }

    /// An overlay, and whether its announced length is its true one.
    fn overlay(&mut self) -> Result<(Slots, bool), DecodeError> {
        let head = self.head(false)?;
        // One encoder puts the code of the parameter in front of the stamp; no text begins so.
        if self.peek()? == 0x0a {
            self.octet()?;
        }
        let mut slots = Slots {
            received: self.received()?,
            ..Slots::default()
        };
        self.slots(&head, &mut slots)?;
        let is_true = self.position() - head.start == head.announced;
        Ok((slots, is_true))
    }

    /// EnvLen: 16 bits, or 32 behind 16 zero bits.
    fn head(&mut self, is_base: bool) -> Result<LayerHead, DecodeError> {
        let start = self.position() - 1;
        let announced = match self.len16()? {
            0 => self.len32()?,
            short => short,
        };
        Ok(LayerHead {
            start,
            announced,
            is_base,
        })
    }

    fn slots(&mut self, head: &LayerHead, slots: &mut Slots) -> Result<(), DecodeError> {
        loop {
            match self.octet()? {
                0x01 => return Ok(()),
                code @ (0x00..=0x07 | 0x09..=0x0b) => self.slot(code, slots)?,
                _ => return self.skip_layer(head),
            }
        }
    }

    pub(super) fn slot(&mut self, code: u8, slots: &mut Slots) -> Result<(), DecodeError> {
        match code {
            0x00 => slots.user_defined.push(self.user_text()?),
            0x02 => self.agents(Notation::Envelope, &mut slots.to)?,
            0x03 => drop(self.agent(Notation::Envelope, &mut slots.from)?),
            0x04 => slots.acl_representation = Some(self.representation()?),
            0x05 => self.unless_empty(&mut slots.comments)?,
            0x06 => slots.payload_length = Some(self.payload_length()?),
            0x07 => self.unless_empty(&mut slots.payload_encoding)?,
            0x09 => self.agents(Notation::Envelope, &mut slots.intended_receiver)?,
            // An overlay may repeat the stamp of its head, with more in it.
            0x0a => slots.received = self.received()?.or(slots.received.take()),
            0x0b => slots.transport_behaviour = Some(self.any()?),
            _ => return Err(self.unexpected("an envelope has no such parameter")),
        }
        Ok(())
    }

    /// Goes on behind the layer because of a parameter of unknown extent, if the announced length
    /// leads to what can be the end of the layer.
    fn skip_layer(&mut self, head: &LayerHead) -> Result<(), DecodeError> {
        let unknown = self.unexpected("an envelope has no such parameter");
        let left = head
            .announced
            .checked_sub(self.position() - head.start)
            .and_then(|left| self.rest().split_at_checked(left));
        match left {
            Some(([.., 0x01], behind))
                if head.is_base || matches!(behind.first(), Some(0xfd | 0xfe)) =>
            {
                self.go_to(head.start + head.announced);
                Ok(())
            }
            _ => Err(unknown),
        }
    }

    /// ACLRepresentation.
    pub(super) fn representation(&mut self) -> Result<Representation, DecodeError> {
        match self.octet()? {
            0x00 => self.null_terminated().map(Representation::from),
            0x10 => Ok(Representation::BitEfficient),
            0x11 => Ok(Representation::String),
            0x12 => Ok(Representation::Xml),
            _ => Err(self.unexpected("no representation has this code")),
        }
    }

    /// ReceivedObject; `None` for the empty one of an overlay that is no stamp.
    fn received(&mut self) -> Result<Option<Received>, DecodeError> {
        let mut received = Received {
            by: self.null_terminated()?,
            from: None,
            date: read_time(self)?,
            id: None,
            via: None,
            user_defined: Vec::new(),
        };
        loop {
            match self.octet()? {
                0x00 => received.user_defined.push(self.user_text()?),
                0x01 => return Ok(Some(received).filter(|stamp| !stamp.by.is_empty())),
                0x02 => received.from = Some(self.null_terminated()?),
                0x03 => received.id = Some(self.null_terminated()?),
                0x04 => received.via = Some(self.null_terminated()?),
                _ => return Err(self.unexpected("a stamp has no such parameter")),
            }
        }
    }

    pub(super) fn user_text(&mut self) -> Result<(Text, Text), DecodeError> {
        self.count_item()?;
        let name = self.null_terminated()?;
        let value = self.null_terminated()?;
        Ok((canonical_user_name(name), value))
    }

    /// Some peers write an absent text as an empty one.
    fn unless_empty(&mut self, place: &mut Option<Text>) -> Result<(), DecodeError> {
        let found = self.find_literal()?;
        *place = None;
        if !found.is_empty() {
            self.take_with(found, |text| *place = Some(text));
        }
        Ok(())
    }

    /// The grammar has bare Digits, the notes a code in front of them. No length has a leading
    /// zero, so an octet that can be the code is it.
    pub(super) fn payload_length(&mut self) -> Result<u64, DecodeError> {
        if matches!(self.peek()?, 0x12 | 0x13) {
            self.octet()?;
        }
        read_count(self)
    }

    /// Any: one of the forms of a string.
    fn any(&mut self) -> Result<Bytes, DecodeError> {
        match self.peek()? {
            0x14 | 0x16 | 0x17 | 0x19 => self.string(),
            _ => Err(self.error(Fault::Malformed, "a string is missing")),
        }
    }
}

/// The overlays from the oldest to the newest, given as they stand there with whether their
/// announced lengths are true.
///
/// SC00088D puts the newest first. fipa_acl puts it last, and announces wrong lengths; it writes
/// the whole letter anew at each hop, so whatever has a true length was added after it, either
/// in front or (for a reader that lets the last one win) behind.
fn travel_order(overlays: Vec<(Slots, bool)>) -> Vec<Slots> {
    let slots = |(slots, _)| slots;
    if overlays.is_empty() {
        return Vec::new();
    }
    let Some(first_false) = overlays.iter().position(|(_, is_true)| !is_true) else {
        return overlays.into_iter().rev().map(slots).collect();
    };
    let mut in_front = overlays;
    let from_false = in_front.split_off(first_false);
    let (behind, rewritten): (Vec<_>, Vec<_>) =
        from_false.into_iter().partition(|(_, is_true)| *is_true);
    let newest = in_front.into_iter().rev();
    rewritten
        .into_iter()
        .chain(behind)
        .chain(newest)
        .map(slots)
        .collect()
}
