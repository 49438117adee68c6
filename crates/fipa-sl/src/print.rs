use std::fmt;

use fipa_acl::FipaTime;

use crate::scan::{Token, ends_token, is_number};
use crate::{Arguments, Content, Functional, Term};

/// One blank between terms, none directly inside parentheses; a string is a word where it is a
/// legal one of ASCII, else a literal, and `#n"` where no literal can hold it.
struct Printer {
    out: Vec<u8>,
}

impl Printer {
    fn term(&mut self, term: &Term) {
        match term {
            Term::Text(text) => self.text(text),
            Term::Octets(octets) => self.counted(octets),
            // What is no number must not turn into something else than the text that it is.
            Term::Number(number) if is_number(number.as_bytes()) => self.put(number),
            Term::Number(text) => self.text(text),
            Term::Time(time) => self.time(time),
            Term::Truth(truth) => self.put(if *truth { "true" } else { "false" }),
            Term::Variable(name) => self.name('?', name),
            Term::Functional(functional) => self.functional(functional),
        }
    }

    fn functional(&mut self, functional: &Functional) {
        self.put("(");
        self.text(&functional.symbol);
        match &functional.arguments {
            Arguments::Positional(terms) => {
                for term in terms {
                    self.put(" ");
                    self.term(term);
                }
            }
            Arguments::Named(parameters) => {
                for (name, value) in parameters {
                    self.put(" ");
                    self.name(':', name);
                    self.put(" ");
                    self.term(value);
                }
            }
        }
        self.put(")");
    }

    fn text(&mut self, text: &str) {
        if is_plain(text) && matches!(Token::of(text.as_bytes()), Token::Word) {
            self.put(text);
        } else {
            self.quoted(text);
        }
    }

    /// The name of a variable or a parameter behind its mark.
    fn name(&mut self, mark: char, name: &str) {
        self.put(mark.encode_utf8(&mut [0; 4]));
        if is_plain(name) && !name.starts_with('#') {
            self.put(name);
        } else {
            self.quoted(name);
        }
    }

    /// In a literal the backslash means something in front of a quote only, and cannot be escaped.
    fn quoted(&mut self, text: &str) {
        if text.ends_with('\\') || text.contains("\\\"") {
            return self.counted(text.as_bytes());
        }
        self.put("\"");
        self.put(&text.replace('"', "\\\""));
        self.put("\"");
    }

    fn counted(&mut self, octets: &[u8]) {
        self.put(&format!("#{}\"", octets.len()));
        self.out.extend_from_slice(octets);
    }

    /// What has no token, being out of its range, is printed as the nearest that has one.
    fn time(&mut self, time: &FipaTime) {
        let token = time.to_token().or_else(|_| {
            let nearest = FipaTime::from_unix_millis(time.resolve(0));
            nearest.to_token()
        });
        self.put(&token.unwrap_or_default());
    }

    fn put(&mut self, text: &str) {
        self.out.extend_from_slice(text.as_bytes());
    }
}

/// Whether all of it stays in one token.
fn is_plain(text: &str) -> bool {
    !text.is_empty()
        && text
            .bytes()
            .all(|octet| octet.is_ascii() && !ends_token(octet))
}

impl Content {
    pub(crate) fn to_octets(&self) -> Vec<u8> {
        let mut printer = Printer { out: vec![b'('] };
        for (i, expression) in self.expressions().enumerate() {
            if i > 0 {
                printer.put(" ");
            }
            printer.term(expression);
        }
        printer.put(")");
        printer.out
    }
}

impl fmt::Display for Content {
    /// The content as SL; octets that are not UTF-8 are shown as U+FFFD.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&String::from_utf8_lossy(&self.to_octets()))
    }
}

impl fmt::Display for Term {
    /// The term as SL; octets that are not UTF-8 are shown as U+FFFD.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut printer = Printer { out: Vec::new() };
        printer.term(self);
        f.pad(&String::from_utf8_lossy(&printer.out))
    }
}
