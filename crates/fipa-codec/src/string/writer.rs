use bytes::Bytes;
use fipa_acl::Text;

use super::scan::Form;
use super::{jade, keywords};
use crate::decimal::Decimal;
use crate::user_names::without_prefix;
use crate::{EncodeError, Output};

/// In what a message differs from peer to peer.
#[derive(Clone, Debug)]
pub(crate) struct WriteOptions {
    /// Contents that go out as Base64, said so by a parameter.
    pub(crate) base64_content: Base64,
    /// All strings, the content too, go out behind their count.
    pub(crate) counted: bool,
    /// The n of `#n"` counts UTF-16 units of the text instead of its octets.
    pub(crate) count_utf16: bool,
    /// Values of a message's user-defined parameters stand in parentheses.
    pub(crate) user_defined_in_parentheses: bool,
    /// Agent identifiers have their user-defined parameters.
    pub(crate) user_defined_of_agents: bool,
    /// How deep resolvers are written within resolvers; what is deeper is left out.
    pub(crate) resolver_levels: usize,
    /// Dates say that they are in UTC.
    pub(crate) zone_letter: bool,
}

/// Which contents go out as Base64, instead of as octets behind their count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Base64 {
    Never,
    NotUtf8,
    NotAscii,
}

impl Base64 {
    fn holds(self, content: &[u8], text: Option<&str>) -> bool {
        match self {
            Base64::Never => false,
            Base64::NotUtf8 => text.is_none(),
            Base64::NotAscii => !content.is_ascii(),
        }
    }
}

impl WriteOptions {
    /// As the standard says, in the forms that all known peers read.
    pub(crate) const STRICT: WriteOptions = WriteOptions {
        base64_content: Base64::Never,
        counted: false,
        count_utf16: false,
        user_defined_in_parentheses: false,
        user_defined_of_agents: true,
        resolver_levels: usize::MAX,
        zone_letter: true,
    };
}

/// Where a message is written, and how.
pub(super) struct Writer<'a> {
    pub(super) out: &'a mut Output,
    pub(super) options: &'a WriteOptions,
}

impl Writer<'_> {
    #[inline]
    pub(super) fn put(&mut self, octets: &[u8]) {
        self.out.put_slice(octets);
    }

    /// Word of SC00070I.
    pub(super) fn word(&mut self, text: &Text, parameter: &'static str) -> Result<(), EncodeError> {
        if !text.is_word() {
            return Err(EncodeError {
                parameter,
                what: "not a word",
            });
        }
        self.put(text.as_bytes());
        Ok(())
    }

    /// A word where it is a legal one that no reader takes for a parameter, else a string.
    #[inline]
    pub(super) fn word_or_string(&mut self, text: &Text) {
        let octets = text.as_bytes();
        let is_plain =
            text.is_word() && octets.first() != Some(&b':') && !keywords::has_parameter(octets);
        if is_plain {
            self.put(octets);
        } else {
            self.string(text);
        }
    }

    /// String of SC00070I.
    pub(super) fn string(&mut self, text: &Text) {
        let octets = text.as_bytes();
        match self.form_of(octets) {
            Form::Literal => {
                self.out.put_u8(b'"');
                self.put(octets);
                self.out.put_u8(b'"');
            }
            Form::EscapedLiteral => self.escaped(octets),
            Form::Counted => {
                self.count_of(octets, Some(text));
                self.put(octets);
            }
        }
    }

    /// The name of a user-defined parameter with its colon and the `X-` that marks it.
    pub(super) fn user_name(&mut self, name: &str) -> Result<(), EncodeError> {
        let name = without_prefix(name);
        let wrong = |what| EncodeError {
            parameter: "user-defined",
            what,
        };
        let fits = |octet| matches!(octet, 0x21..=0x7f) && !matches!(octet, b'(' | b')');
        if name.is_empty() || !name.bytes().all(fits) {
            return Err(wrong("the name is not a word"));
        }
        if memchr::memchr3(b'#', b'"', b':', name.as_bytes()).is_some() {
            return Err(wrong("the name has a character that begins a value"));
        }
        self.put(b" :X-");
        self.put(name.as_bytes());
        Ok(())
    }

    /// The content as the value of its parameter.
    pub(super) fn content(&mut self, content: &Bytes) {
        let text = str::from_utf8(content).ok();
        self.put(b" :content ");
        if self.options.base64_content.holds(content, text) {
            return self.base64(content);
        }
        let form = match text {
            Some(_) => self.form_of(content),
            None => Form::Counted,
        };
        match form {
            Form::Literal => self.shared_literal(content),
            Form::EscapedLiteral => self.escaped(content),
            Form::Counted => {
                self.count_of(content, text);
                self.out.put_shared(content);
            }
        }
    }

    #[inline]
    fn form_of(&self, octets: &[u8]) -> Form {
        match self.options.counted {
            true => Form::Counted,
            false => Form::of(octets),
        }
    }

    fn base64(&mut self, content: &Bytes) {
        self.shared_literal(&jade::encoded(content));
        self.put(b" :X-");
        self.put(jade::ENCODING.as_bytes());
        self.put(b" ");
        self.put(jade::VALUE.as_bytes());
    }

    fn shared_literal(&mut self, octets: &Bytes) {
        self.out.put_u8(b'"');
        self.out.put_shared(octets);
        self.out.put_u8(b'"');
    }

    fn escaped(&mut self, octets: &[u8]) {
        let quotes = memchr::memchr_iter(b'"', octets).count();
        self.out.reserve(octets.len() + quotes + 2);
        self.out.put_u8(b'"');
        let mut from = 0;
        for quote in memchr::memchr_iter(b'"', octets) {
            self.put(octets.get(from..quote).unwrap_or_default());
            self.out.put_u8(b'\\');
            from = quote;
        }
        self.put(octets.get(from..).unwrap_or_default());
        self.out.put_u8(b'"');
    }

    fn count_of(&mut self, octets: &[u8], text: Option<&str>) {
        match text {
            Some(text) if self.options.count_utf16 => self.count(text.encode_utf16().count()),
            _ => self.count(octets.len()),
        }
    }

    /// The `#n"` in front of so many octets.
    fn count(&mut self, count: usize) {
        self.out.put_u8(b'#');
        self.put(Decimal::of(count).as_bytes());
        self.out.put_u8(b'"');
    }
}
