use bytes::BufMut;
use fipa_acl::{Expression, Text};

use super::code_table::{Coding, Kind};
use super::message_writer::{Refusal, Writer};
use super::numbers::{is_number, write_digits};
use super::scan::is_plain;
use super::writer::{TooLong, write_counted};

/// Whatever stands behind a code is written together with it: each step has its price.
impl Writer<'_> {
    /// BinExpression behind a code: a word if it is a legal one, else a string, never a number; or
    /// a list.
    #[inline]
    pub(super) fn expression(
        &mut self,
        code: Option<u8>,
        value: &Expression,
    ) -> Result<(), Refusal> {
        match value {
            Expression::Word(text) | Expression::String(text) | Expression::Number(text) => {
                self.word_or_string(code, text)
            }
            Expression::List(items) => {
                self.put_code(code);
                self.list(items)
            }
        }
    }

    /// Each parenthesis and token stands alone: fused ones are read differently by peers.
    fn list(&mut self, items: &[Expression]) -> Result<(), Refusal> {
        self.out.put_u8(0x60);
        for item in items {
            match item {
                Expression::Number(text) if is_number(text) => {
                    self.out.put_u8(0x12);
                    write_digits(text.as_bytes(), self.out);
                }
                Expression::Word(text) | Expression::Number(text) => {
                    self.word_or_string(None, text)?;
                }
                Expression::String(text) => self.string(None, text)?,
                Expression::List(inner) => self.list(inner)?,
            }
        }
        self.out.put_u8(0x40);
        Ok(())
    }

    #[inline]
    fn word_or_string(&mut self, code: Option<u8>, text: &Text) -> Result<(), Refusal> {
        if text.is_word() {
            self.legal_word(code, text.as_bytes());
            return Ok(());
        }
        self.string(code, text)
    }

    /// BinWord behind a code.
    #[inline]
    pub(super) fn word(&mut self, code: Option<u8>, text: &Text) -> Result<(), Refusal> {
        if !text.is_word() {
            return Err(Refusal::NotAWord);
        }
        self.legal_word(code, text.as_bytes());
        Ok(())
    }

    #[inline]
    fn legal_word(&mut self, code: Option<u8>, word: &[u8]) {
        if self.is_coded(code, Kind::Word, word) {
            return;
        }
        match code {
            Some(code) => self.out.put_slice(&[code, 0x10]),
            None => self.out.put_u8(0x10),
        }
        self.out.put_slice(word);
        self.out.put_u8(0);
    }

    /// A string literal behind a code, or a counted string for what would read differently in a
    /// literal.
    #[inline]
    fn string(&mut self, code: Option<u8>, text: &Text) -> Result<(), Refusal> {
        let octets = text.as_bytes();
        if !is_plain(octets) {
            return self.string_to_escape(code, text);
        }
        self.plain_literal(code, octets);
        Ok(())
    }

    #[inline(never)]
    fn string_to_escape(&mut self, code: Option<u8>, text: &str) -> Result<(), Refusal> {
        let octets = text.as_bytes();
        if text.contains('\0') || text.ends_with('\\') || text.contains("\\\"") {
            if !self.is_coded(code, Kind::Counted, octets) {
                self.put_code(code);
                write_counted(octets, self.out).map_err(|TooLong| Refusal::TooLong)?;
            }
        } else if !self.is_coded(code, Kind::Literal, octets) {
            self.put_code(code);
            self.escaped(octets);
        }
        Ok(())
    }

    #[inline]
    fn plain_literal(&mut self, code: Option<u8>, text: &[u8]) {
        if self.is_coded(code, Kind::Literal, text) {
            return;
        }
        match code {
            Some(code) => self.out.put_slice(&[code, 0x14, b'"']),
            None => self.out.put_slice(b"\x14\""),
        }
        self.out.put_slice(text);
        self.out.put_slice(b"\"\0");
    }

    fn escaped(&mut self, text: &[u8]) {
        self.out.put_slice(b"\x14\"");
        for (i, piece) in text.split(|octet| *octet == b'"').enumerate() {
            if i > 0 {
                self.out.put_slice(b"\\\"");
            }
            self.out.put_slice(piece);
        }
        self.out.put_slice(b"\"\0");
    }

    fn put_code(&mut self, code: Option<u8>) {
        if let Some(code) = code {
            self.out.put_u8(code);
        }
    }

    /// Writes a code and the index of a text that is in the code table; adds one that is not.
    #[inline]
    pub(super) fn is_coded(&mut self, code: Option<u8>, kind: Kind, octets: &[u8]) -> bool {
        self.coding.is_some() && self.is_coded_by_table(code, kind, octets)
    }

    #[cold]
    fn is_coded_by_table(&mut self, code: Option<u8>, kind: Kind, octets: &[u8]) -> bool {
        let Some(Coding { table, learns }) = &mut self.coding else {
            return false;
        };
        let Some(number) = table.number(kind, octets) else {
            if *learns {
                table.add(kind, octets);
            }
            return false;
        };
        let [high, low] = number.to_be_bytes();
        let high = table.is_wide().then_some(high);
        self.put_code(code);
        self.out.put_u8(match kind {
            Kind::Word => 0x11,
            Kind::Literal => 0x15,
            Kind::Counted => 0x18,
        });
        self.put_code(high);
        self.out.put_u8(low);
        true
    }
}
