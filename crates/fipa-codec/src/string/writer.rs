use bytes::Bytes;
use fipa_acl::Text;

use super::scan::Form;
use super::{jade, keywords};
use crate::{EncodeError, Output};

/// In what a message differs from peer to peer.
#[derive(Clone, Debug)]
pub(crate) struct WriteOptions {
    /// Content that is not UTF-8 goes out as Base64, said so by a parameter, instead of as octets
    /// behind their count (JADE, which reads octets as characters).
    pub(crate) base64_content: bool,
    /// All content goes out behind its count (fipa_acl writes nothing else).
    pub(crate) counted_content: bool,
    /// The n of `#n"` counts UTF-16 units of the text instead of its octets (JADE).
    pub(crate) count_utf16: bool,
    /// Values of a message's user-defined parameters stand in parentheses (fipa_acl reads no
    /// others).
    pub(crate) user_defined_in_parentheses: bool,
    /// Agent identifiers have their user-defined parameters (fipa_acl does not read them).
    pub(crate) user_defined_of_agents: bool,
    /// How deep resolvers are written within resolvers; what is deeper is left out (fipa_acl reads
    /// one level).
    pub(crate) resolver_levels: usize,
}

impl WriteOptions {
    /// As the standard says, in the forms that all known peers read.
    pub(crate) const STRICT: WriteOptions = WriteOptions {
        base64_content: false,
        counted_content: false,
        count_utf16: false,
        user_defined_in_parentheses: false,
        user_defined_of_agents: true,
        resolver_levels: usize::MAX,
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
        match Form::of(octets) {
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
    ///
    /// A name is kept without its prefix, but its field can be set by anybody.
    pub(super) fn user_name(&mut self, mut name: &str) -> Result<(), EncodeError> {
        while let Some(shorter) = name.strip_prefix("X-").or_else(|| name.strip_prefix("x-")) {
            name = shorter;
        }
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
        let form = match text {
            Some(_) if !self.options.counted_content => Form::of(content),
            _ => Form::Counted,
        };
        self.put(b" :content ");
        match (form, text) {
            (Form::Literal, _) => self.shared_literal(content),
            (Form::EscapedLiteral, _) => self.escaped(content),
            (Form::Counted, None) if self.options.base64_content => self.base64(content),
            (Form::Counted, text) => {
                self.count_of(content, text);
                self.out.put_shared(content);
            }
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
    fn count(&mut self, mut count: usize) {
        let mut digits = [b'0'; 20];
        let mut start = digits.len();
        for digit in digits.iter_mut().rev() {
            let [ones, ..] = (count % 10).to_le_bytes();
            *digit = b'0' + ones;
            start -= 1;
            count /= 10;
            if count == 0 {
                break;
            }
        }
        self.out.put_u8(b'#');
        self.put(digits.get(start..).unwrap_or_default());
        self.out.put_u8(b'"');
    }
}

#[cfg(test)]
mod tests {
    use fipa_acl::{AgentId, Message, Performative};

    use super::*;
    use crate::Limits;
    use crate::string::{decode_message, encode_message_with};

    fn written(message: &Message, options: &WriteOptions) -> Bytes {
        let mut out = Output::new();
        encode_message_with(message, &mut out, options).unwrap();
        out.take_bytes()
    }

    fn inform() -> Message {
        Message::new(Performative::Inform)
    }

    #[test]
    fn octets_go_out_as_base64_and_text_is_counted_in_characters() {
        let options = WriteOptions {
            base64_content: true,
            count_utf16: true,
            ..WriteOptions::STRICT
        };
        let octets = inform().content(&b"\x80\xff"[..]).user_defined("a", "b");
        let text = b"(inform :X-a b :content \"gP8=\" :X-JADE-Encoding Base64)";
        assert_eq!(written(&octets, &options), &text[..]);
        let read = decode_message(&Bytes::from_static(text), &Limits::default());
        assert_eq!(read, Ok(octets));
        let text = inform().content("\u{1f680}\\").language("\u{fc}\\");
        let expected = "(inform :language #2\"\u{fc}\\ :content #3\"\u{1f680}\\)";
        assert_eq!(written(&text, &options), expected);
    }

    #[test]
    fn what_a_peer_does_not_read_is_left_out_or_put_in_parentheses() {
        let options = WriteOptions {
            counted_content: true,
            user_defined_in_parentheses: true,
            user_defined_of_agents: false,
            resolver_levels: 1,
            ..WriteOptions::STRICT
        };
        let sender = AgentId::new("a")
            .resolver(AgentId::new("b").resolver("c"))
            .user_defined("p", "q");
        let message = inform()
            .from_agent(sender)
            .content("hi")
            .user_defined("n", "v w");
        let expected = "(inform :sender (agent-identifier :name a :resolvers (sequence \
            (agent-identifier :name b))) :X-n (\"v w\") :content #2\"hi)";
        assert_eq!(written(&message, &options), expected);
    }
}
