use bytes::Bytes;
use fipa_acl::{FipaTime, Text};

use crate::Functional;

/// A term, formula or action of SL (SC00008I): the grammar lets each stand where a term may.
///
/// Two terms are equal if they mean the same: text is equal to octets that are the same text.
#[derive(Clone, Debug)]
pub enum Term {
    /// A string: word and literal are two ways to write the same.
    Text(Text),
    /// A byte-length encoded string (`#n"`), kept as octets: JADE writes byte arrays so.
    Octets(Bytes),
    /// A number as its text, such as `42`, `-1.5E3` or `0x2A`.
    Number(Text),
    /// A date or a span.
    Time(FipaTime),
    /// The propositions `true` and `false`; the same words in quotes are text.
    Truth(bool),
    /// A variable, by its name without the question mark.
    Variable(Text),
    /// What stands in parentheses: functional terms, sets and sequences, actions, predicates and
    /// all operators.
    Functional(Functional),
}

impl Term {
    /// A string.
    pub fn text(text: impl Into<Text>) -> Term {
        Term::Text(text.into())
    }

    /// A whole number.
    pub fn integer(number: i64) -> Term {
        Term::Number(Text::from(number.to_string()))
    }

    /// A set, in the order in which it will be printed.
    pub fn set(items: impl IntoIterator<Item = Term>) -> Term {
        Functional::new("set", items).into()
    }

    /// A sequence.
    pub fn sequence(items: impl IntoIterator<Item = Term>) -> Term {
        Functional::new("sequence", items).into()
    }

    /// The text of a string, or of octets that are UTF-8.
    pub fn as_text(&self) -> Option<Text> {
        match self {
            Term::Text(text) => Some(text.clone()),
            Term::Octets(octets) => Text::from_utf8(octets.clone()).ok(),
            _ => None,
        }
    }

    /// The value of a whole number that fits, decimal or hexadecimal.
    pub fn as_integer(&self) -> Option<i64> {
        let Term::Number(number) = self else {
            return None;
        };
        let digits = number.trim_start_matches(['+', '-']);
        let Some(hex) = digits.strip_prefix("0x").or(digits.strip_prefix("0X")) else {
            return number.parse().ok();
        };
        let value = i64::from_str_radix(hex, 16).ok()?;
        Some(if number.starts_with('-') {
            -value
        } else {
            value
        })
    }

    /// The date or span.
    pub fn as_time(&self) -> Option<FipaTime> {
        match self {
            Term::Time(time) => Some(*time),
            _ => None,
        }
    }

    /// What stands in parentheses, if it has this symbol, in any case.
    pub fn functional(&self, symbol: &str) -> Option<&Functional> {
        self.as_functional()
            .filter(|functional| functional.is(symbol))
    }

    /// What stands in parentheses, whatever its symbol.
    pub fn as_functional(&self) -> Option<&Functional> {
        match self {
            Term::Functional(functional) => Some(functional),
            _ => None,
        }
    }

    /// The items of a set or a sequence.
    pub fn items(&self) -> Option<&[Term]> {
        let collection = self.functional("set").or(self.functional("sequence"))?;
        collection.all_positional()
    }

    fn octets(&self) -> Option<&[u8]> {
        match self {
            Term::Text(text) => Some(text.as_bytes()),
            Term::Octets(octets) => Some(octets),
            _ => None,
        }
    }
}

impl PartialEq for Term {
    fn eq(&self, other: &Term) -> bool {
        match (self, other) {
            (Term::Number(a), Term::Number(b)) | (Term::Variable(a), Term::Variable(b)) => a == b,
            (Term::Time(a), Term::Time(b)) => a == b,
            (Term::Truth(a), Term::Truth(b)) => a == b,
            (Term::Functional(a), Term::Functional(b)) => a == b,
            (a, b) => a.octets().is_some() && a.octets() == b.octets(),
        }
    }
}

impl Eq for Term {}

impl From<Text> for Term {
    fn from(text: Text) -> Term {
        Term::Text(text)
    }
}

impl From<&Text> for Term {
    fn from(text: &Text) -> Term {
        Term::Text(text.clone())
    }
}

impl From<&str> for Term {
    fn from(text: &str) -> Term {
        Term::text(text)
    }
}

impl From<Functional> for Term {
    fn from(functional: Functional) -> Term {
        Term::Functional(functional)
    }
}
