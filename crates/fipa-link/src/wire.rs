//! The primitive values of frames: big endian numbers, and text behind its length.

use bytes::{Buf, BufMut, Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::InstanceId;

/// A frame cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// The body ends in the middle of a value.
    #[error("the {0} frame ends too soon")]
    Short(&'static str),
    /// A value is none that is defined.
    #[error("the {0} frame holds an undefined value")]
    Undefined(&'static str),
    /// A text is not UTF-8.
    #[error("the {0} frame holds text that is not UTF-8")]
    NotUtf8(&'static str),
    /// The octets were changed on their way.
    #[error("the {0} frame was changed on its way")]
    Changed(&'static str),
}

/// Reads the values of one frame's body. What follows the last value that this version knows is
/// left unread, so that later versions can add to a frame.
pub(crate) struct Reader {
    body: Bytes,
    frame: &'static str,
}

impl Reader {
    pub(crate) fn new(body: Bytes, frame: &'static str) -> Reader {
        Reader { body, frame }
    }

    pub(crate) fn undefined(&self) -> FrameError {
        FrameError::Undefined(self.frame)
    }

    fn take(&mut self, octets: usize) -> Result<Bytes, FrameError> {
        self.has(octets)?;
        Ok(self.body.split_to(octets))
    }

    fn has(&self, octets: usize) -> Result<(), FrameError> {
        if self.body.len() < octets {
            return Err(FrameError::Short(self.frame));
        }
        Ok(())
    }

    pub(crate) fn u8(&mut self) -> Result<u8, FrameError> {
        self.has(1)?;
        Ok(self.body.get_u8())
    }

    pub(crate) fn u16(&mut self) -> Result<u16, FrameError> {
        self.has(2)?;
        Ok(self.body.get_u16())
    }

    pub(crate) fn u32(&mut self) -> Result<u32, FrameError> {
        self.has(4)?;
        Ok(self.body.get_u32())
    }

    pub(crate) fn u64(&mut self) -> Result<u64, FrameError> {
        self.has(8)?;
        Ok(self.body.get_u64())
    }

    pub(crate) fn i64(&mut self) -> Result<i64, FrameError> {
        self.has(8)?;
        Ok(self.body.get_i64())
    }

    pub(crate) fn instance(&mut self) -> Result<InstanceId, FrameError> {
        let mut octets = [0; 16];
        octets.copy_from_slice(&self.take(16)?);
        Ok(InstanceId::from_bytes(octets))
    }

    /// Text in a buffer of its own: what frames hold beside letters is kept for long.
    pub(crate) fn text(&mut self) -> Result<Text, FrameError> {
        let octets = self.u32()? as usize;
        self.has(octets)?;
        let text = std::str::from_utf8(&self.body[..octets])
            .map(Text::from)
            .map_err(|_| FrameError::NotUtf8(self.frame))?;
        self.body.advance(octets);
        Ok(text)
    }

    /// A list behind its count. Each item takes an octet at least, which bounds what is reserved.
    pub(crate) fn list<T, L: FromIterator<T>>(
        &mut self,
        mut item: impl FnMut(&mut Reader) -> Result<T, FrameError>,
    ) -> Result<L, FrameError> {
        let count = self.u32()? as usize;
        if count > self.body.len() {
            return Err(FrameError::Short(self.frame));
        }
        (0..count).map(|_| item(self)).collect()
    }

    /// A value behind its length; what this version does not know of it is passed over.
    pub(crate) fn part(&mut self) -> Result<Reader, FrameError> {
        let octets = self.u32()? as usize;
        Ok(Reader::new(self.take(octets)?, self.frame))
    }

    /// Octets behind their number.
    pub(crate) fn octets(&mut self) -> Result<Bytes, FrameError> {
        let octets = self.u32()? as usize;
        self.take(octets)
    }

    /// Passes over the checksum of all that was read of a body, which must fit.
    pub(crate) fn check(&mut self, body: &[u8]) -> Result<(), FrameError> {
        let read = body.len().saturating_sub(self.body.len());
        let sum = crc32fast::hash(body.get(..read).unwrap_or_default());
        match self.u32()? == sum {
            true => Ok(()),
            false => Err(FrameError::Changed(self.frame)),
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.body.is_empty()
    }

    pub(crate) fn rest(self) -> Bytes {
        self.body
    }
}

pub(crate) fn put_text(out: &mut BytesMut, text: &str) {
    out.put_u32(length(text.len()));
    out.put_slice(text.as_bytes());
}

pub(crate) fn put_octets(out: &mut BytesMut, octets: &[u8]) {
    out.put_u32(length(octets.len()));
    out.put_slice(octets);
}

/// A value behind its length.
pub(crate) fn put_part(out: &mut BytesMut, put: impl FnOnce(&mut BytesMut)) {
    let begin = out.len();
    out.put_u32(0);
    put(out);
    let octets = length(out.len() - begin - 4);
    out[begin..begin + 4].copy_from_slice(&octets.to_be_bytes());
}

pub(crate) fn put_list<T>(out: &mut BytesMut, items: &[T], put: impl Fn(&mut BytesMut, &T)) {
    out.put_u32(length(items.len()));
    items.iter().for_each(|item| put(out, item));
}

/// Nothing that a link carries in one frame reaches 4 GiB: letters are limited long before.
fn length(octets: usize) -> u32 {
    u32::try_from(octets).unwrap_or(u32::MAX)
}
