//! How texts stand in the octets, and how they are taken out of them.

use bytes::Bytes;
use fipa_acl::Text;

use super::code_table::{Kind, NO_ENTRY};
use super::reader::Reader;
use crate::{DecodeError, Fault};

/// How a text stands there.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Word,
    Literal,
    Len8,
    Len16,
    Len32,
    Coded,
}

impl Form {
    /// As what the text enters a code table.
    fn kind(self) -> Kind {
        match self {
            Form::Word => Kind::Word,
            Form::Literal => Kind::Literal,
            Form::Len8 | Form::Len16 | Form::Len32 | Form::Coded => Kind::Counted,
        }
    }
}

/// A text that was found and can be taken.
///
/// Finding and taking are two steps, because a text that goes through a result is moved about in
/// memory, which costs more than all the rest.
#[derive(Clone, Copy)]
pub(super) struct Found<'a> {
    octets: &'a [u8],
    shape: Shape,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Shape {
    /// The octets are the text.
    Plain,
    /// There are `\"` among the octets that stand for `"`.
    Escaped,
    /// The text has this number in the code table.
    Coded(u16),
}

impl<'a> From<&'a [u8]> for Found<'a> {
    #[inline]
    fn from(octets: &'a [u8]) -> Found<'a> {
        Found {
            octets,
            shape: Shape::Plain,
        }
    }
}

impl<'a> Found<'a> {
    /// The octets of the text, if none of them stands for another.
    pub(super) fn as_it_stands(&self) -> Option<&'a [u8]> {
        (self.shape == Shape::Plain).then_some(self.octets)
    }

    /// Whether there are no octets; not for what is in the code table.
    pub(super) fn is_empty(&self) -> bool {
        self.octets.is_empty()
    }
}

impl<'a> Reader<'a> {
    /// A text of a message. All words and strings but the content come in here.
    #[inline(always)]
    pub(super) fn find(&mut self, form: Form) -> Result<Found<'a>, DecodeError> {
        if self.table.is_some() {
            return self.find_with_table(form);
        }
        self.find_here(form)
    }

    /// BinWord of SC00069G.
    #[inline(always)]
    pub(super) fn find_word(&mut self) -> Result<Found<'a>, DecodeError> {
        match self.octet()? {
            0x10 => self.find(Form::Word),
            0x11 => self.find(Form::Coded),
            _ => Err(self.unexpected("a word is missing")),
        }
    }

    /// The text, shared with the input if it is UTF-8 and there is nothing to unescape.
    #[inline(always)]
    pub(super) fn take(&self, found: Found<'a>) -> Text {
        if found.shape == Shape::Plain
            && let Some(text) = Text::short(found.octets)
        {
            return text;
        }
        self.take_long(found)
    }

    /// Hands the text over: what is put to its place in two ways is not moved about before.
    #[inline(always)]
    pub(super) fn take_with(&self, found: Found<'a>, mut put: impl FnMut(Text)) {
        if found.shape == Shape::Plain
            && let Some(text) = Text::short(found.octets)
        {
            put(text);
        } else {
            put(self.take_long(found));
        }
    }

    /// The octets, shared with the input unless there is something to unescape.
    pub(super) fn take_octets(&self, found: Found<'a>) -> Bytes {
        match found.shape {
            Shape::Plain => self.share(found.octets),
            Shape::Escaped => Bytes::from(unescape(found.octets)),
            Shape::Coded(number) => {
                let table = self.table.as_ref().map(|coding| &*coding.table);
                table
                    .and_then(|table| table.get(number))
                    .unwrap_or_default()
            }
        }
    }

    /// BinWord of SC00069G.
    #[inline]
    pub(super) fn bin_word(&mut self) -> Result<Text, DecodeError> {
        let found = self.find_word()?;
        Ok(self.take(found))
    }

    /// NullTerminatedString of SC00088D.
    #[inline]
    pub(super) fn null_terminated(&mut self) -> Result<Text, DecodeError> {
        let found = self.find_literal()?;
        Ok(self.take(found))
    }

    /// A text that is not held within its value, or something is to be mended in it.
    #[inline(never)]
    fn take_long(&self, found: Found<'a>) -> Text {
        if found.shape == Shape::Plain
            && let Ok(text) = Text::from_utf8(self.share(found.octets))
        {
            return text;
        }
        Text::from_utf8_lossy(self.take_octets(found))
    }

    #[inline(never)]
    fn find_with_table(&mut self, form: Form) -> Result<Found<'a>, DecodeError> {
        if form == Form::Coded {
            return self.find_coded();
        }
        let found = self.find_here(form)?;
        if let Some(coding) = self.table.as_mut().filter(|coding| coding.learns) {
            let met = match found.shape {
                Shape::Escaped => coding.table.met(form.kind(), &unescape(found.octets)),
                _ => coding.table.met(form.kind(), found.octets),
            };
            met.map_err(|what| self.error(Fault::Limit, what))?;
        }
        Ok(found)
    }

    /// An index into the code table.
    pub(super) fn find_coded(&mut self) -> Result<Found<'a>, DecodeError> {
        let is_wide = self.table.as_ref().map(|coding| coding.table.is_wide());
        let number = match is_wide {
            None => return self.find_here(Form::Coded),
            Some(true) => u16::from_be_bytes(self.array()?),
            Some(false) => u16::from(self.octet()?),
        };
        let table = self.table.as_mut().map(|coding| &mut *coding.table);
        if !table.is_some_and(|table| table.use_number(number)) {
            return Err(self.unexpected(NO_ENTRY));
        }
        Ok(Found {
            octets: &[],
            shape: Shape::Coded(number),
        })
    }

    /// A text that is no index, whatever a code table is to learn of it.
    #[inline(always)]
    pub(super) fn find_here(&mut self, form: Form) -> Result<Found<'a>, DecodeError> {
        match form {
            Form::Word => self.until_zero().map(Found::from),
            Form::Literal => self.find_literal(),
            Form::Len8 => self.len8().and_then(|n| self.counted(n)).map(Found::from),
            Form::Len16 => self.len16().and_then(|n| self.counted(n)).map(Found::from),
            Form::Len32 => self.len32().and_then(|n| self.counted(n)).map(Found::from),
            Form::Coded => Err(self.error(Fault::Unsupported, "an index into a code table")),
        }
    }

    /// Text before a zero octet as peers write it: `"…"` with `\"` inside, `#n"…`, or bare.
    #[inline(always)]
    pub(super) fn find_literal(&mut self) -> Result<Found<'a>, DecodeError> {
        if let [b'#', ..] = self.rest()
            && let Some(octets) = self.byte_length_literal()
        {
            return Ok(Found::from(octets));
        }
        match self.until_zero_without_backslash() {
            Some([b'"', octets @ .., b'"']) => Ok(Found::from(octets)),
            Some(octets) => Ok(Found::from(without_byte_length(octets))),
            None => self.literal_with_backslash(),
        }
    }

    #[cold]
    fn literal_with_backslash(&mut self) -> Result<Found<'a>, DecodeError> {
        Ok(match self.until_zero()? {
            [b'"', octets @ .., b'"'] if has_escapes(octets) => Found {
                octets,
                shape: Shape::Escaped,
            },
            [b'"', octets @ .., b'"'] => Found::from(octets),
            octets => Found::from(without_byte_length(octets)),
        })
    }

    /// `#n"` whose n octets, which may be zero octets too, are followed by a zero octet.
    fn byte_length_literal(&mut self) -> Option<&'a [u8]> {
        let (count, prefix) = byte_length(self.rest())?;
        let text = self.rest().get(prefix..)?;
        let (octets, [0, ..]) = text.split_at_checked(count)? else {
            return None;
        };
        self.counted(prefix + count + 1).ok()?;
        Some(octets)
    }
}

fn has_escapes(text: &[u8]) -> bool {
    text.windows(2).any(|pair| pair == b"\\\"")
}

/// What is behind `#n"`, if the text begins like that.
#[inline]
fn without_byte_length(text: &[u8]) -> &[u8] {
    match text {
        [b'#', ..] => {
            let prefix = byte_length(text).map_or(0, |(_, prefix)| prefix);
            text.get(prefix..).unwrap_or_default()
        }
        _ => text,
    }
}

/// The n of `#n"` and how many octets these are.
fn byte_length(text: &[u8]) -> Option<(usize, usize)> {
    let digits = text.strip_prefix(b"#")?;
    let mut count = 0_usize;
    for (i, octet) in digits.iter().enumerate() {
        match octet {
            b'0'..=b'9' => {
                let digit = usize::from(octet - b'0');
                count = count.saturating_mul(10).saturating_add(digit);
            }
            b'"' if i > 0 => return Some((count, i + 2)),
            _ => return None,
        }
    }
    None
}

fn unescape(octets: &[u8]) -> Vec<u8> {
    let mut text = Vec::with_capacity(octets.len());
    let mut rest = octets;
    loop {
        rest = match rest {
            [b'\\', b'"', after @ ..] => {
                text.push(b'"');
                after
            }
            [octet, after @ ..] => {
                text.push(*octet);
                after
            }
            [] => return text,
        };
    }
}
