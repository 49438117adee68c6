use bytes::Bytes;
use fipa_acl::{Envelope, FipaTime, Received, Representation, Slots, Text};

use super::content::EndTag;
use super::cursor::{Cursor, Element};
use super::names::Tag;
use super::values::ATTRIBUTES;
use crate::{DecodeError, Fault, dates};

impl Cursor<'_> {
    /// `envelope` of SC00085J.
    pub(super) fn envelope(&mut self) -> Result<Envelope, DecodeError> {
        let root = self.root()?;
        if root.tag != Tag::Envelope {
            return Err(DecodeError {
                offset: root.name.start,
                fault: Fault::Malformed,
                what: "the outermost element is no envelope",
            });
        }
        let mut envelope = Envelope::default();
        let mut indexes = Vec::new();
        while let Some(child) = self.child(&root)? {
            if child.tag != Tag::Params {
                self.skip(&child)?;
                continue;
            }
            self.check_layers(indexes.len() + 1)?;
            let index = self.index().or(indexes.last().copied());
            let place = match indexes.len() {
                0 => &mut envelope.base,
                _ => envelope.overlays.push_mut(Slots::default()),
            };
            indexes.push(index.unwrap_or(0));
            self.layer(&child, place)?;
        }
        match indexes.is_empty() {
            true => Err(self.error(Fault::Violation, "an envelope without params")),
            false => Ok(in_order(envelope, &indexes)),
        }
    }

    /// The number of a layer; one that has none follows the one in front of it.
    fn index(&self) -> Option<u64> {
        let value = self.octets(self.attribute(b"index")?).trim_ascii();
        std::str::from_utf8(value).ok()?.parse().ok()
    }

    fn check_layers(&self, layers: usize) -> Result<(), DecodeError> {
        if layers > self.limits.max_layers {
            return Err(self.error(Fault::Limit, "too many layers"));
        }
        Ok(())
    }

    fn layer(&mut self, element: &Element, slots: &mut Slots) -> Result<(), DecodeError> {
        while let Some(child) = self.child(element)? {
            self.slot(&child, slots)?;
        }
        Ok(())
    }

    /// What comes twice: the last one counts, but receivers add up.
    fn slot(&mut self, element: &Element, slots: &mut Slots) -> Result<(), DecodeError> {
        match element.tag {
            Tag::To => self.agents(element, &mut slots.to)?,
            Tag::From => self.one_agent(element, &mut slots.from)?,
            Tag::Comments => slots.comments = self.comments(element)?,
            Tag::AclRepresentation => {
                let name = self.optional_trimmed(element)?;
                slots.acl_representation = name.map(Representation::from);
            }
            Tag::PayloadLength => slots.payload_length = self.count(element)?,
            Tag::PayloadEncoding => slots.payload_encoding = self.optional(element)?,
            Tag::Date => slots.date = self.time(element)?,
            Tag::IntendedReceiver => self.agents(element, &mut slots.intended_receiver)?,
            Tag::Received => slots.received = self.received(element)?,
            Tag::TransportBehaviour => slots.transport_behaviour = self.behaviour(element)?,
            Tag::UserDefined | Tag::Extension => {
                self.text_parameter(element, &mut slots.user_defined)?;
            }
            _ => self.skip(element)?,
        }
        Ok(())
    }

    fn comments(&mut self, element: &Element) -> Result<Option<Text>, DecodeError> {
        if !self.lenient {
            return self.optional(element);
        }
        let octets = self.unescaped_text(element, EndTag::Last, ATTRIBUTES)?;
        Ok(Some(self.text_of(octets)).filter(|text| !text.is_empty()))
    }

    /// The standard leaves open what is in it.
    fn behaviour(&mut self, element: &Element) -> Result<Option<Bytes>, DecodeError> {
        let octets = self.value(element, ATTRIBUTES)?;
        Ok(Some(self.bytes_of(octets)).filter(|octets| !octets.is_empty()))
    }

    /// A date; an empty one is an absent one.
    pub(super) fn time(&mut self, element: &Element) -> Result<Option<FipaTime>, DecodeError> {
        let start = element.name.start;
        let text = self.trimmed(element, &[b"time", b"href", b"value"])?;
        if text.is_empty() {
            return Ok(None);
        }
        // Not escaping a text is no reason for a wrong date.
        let wrong = |(_, what)| DecodeError {
            offset: start,
            fault: Fault::Violation,
            what,
        };
        dates::parse(text.as_bytes()).map(Some).map_err(wrong)
    }

    /// `received`; `None` for one that does not say by whom it is, which is no stamp.
    fn received(&mut self, element: &Element) -> Result<Option<Received>, DecodeError> {
        let mut by = Text::default();
        let mut date = None;
        let (mut from, mut id, mut via) = (None, None, None);
        let mut user_defined = Vec::new();
        while let Some(child) = self.child(element)? {
            match child.tag {
                Tag::ReceivedBy => by = self.exact(&child, ATTRIBUTES)?,
                Tag::ReceivedFrom => from = self.optional(&child)?,
                Tag::ReceivedDate => date = self.time(&child)?,
                Tag::ReceivedId => id = self.optional(&child)?,
                Tag::ReceivedVia => via = self.optional(&child)?,
                Tag::UserDefined | Tag::Extension => {
                    self.text_parameter(&child, &mut user_defined)?;
                }
                _ => self.skip(&child)?,
            }
        }
        if by.is_empty() {
            return Ok(None);
        }
        let date = date.ok_or_else(|| self.error(Fault::Violation, "a stamp without its date"))?;
        Ok(Some(Received {
            by,
            from,
            date,
            id,
            via,
            user_defined,
        }))
    }
}

/// The layers by their numbers: the base has the lowest.
fn in_order(mut envelope: Envelope, indexes: &[u64]) -> Envelope {
    if indexes.is_sorted() {
        return envelope;
    }
    let layers = std::iter::once(envelope.base).chain(envelope.overlays.drain(..));
    let mut numbered: Vec<_> = indexes.iter().zip(layers).collect();
    numbered.sort_by_key(|(index, _)| **index);
    let mut layers = numbered.into_iter().map(|(_, slots)| slots);
    Envelope {
        base: layers.next().unwrap_or_default(),
        overlays: layers.collect(),
    }
}
