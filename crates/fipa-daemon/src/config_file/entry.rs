use std::collections::BTreeMap;

use fipa_directory::Address;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::Wrong;
use crate::options::value;

/// A key with its value.
pub(super) struct Entry<'a> {
    pub(super) key: &'a str,
    pub(super) value: &'a Spanned<DeValue<'a>>,
}

impl<'a> Entry<'a> {
    /// A string.
    pub(super) fn text<T>(&self, read: impl Fn(&str) -> Result<T, String>) -> Result<T, Wrong> {
        match self.value.get_ref() {
            DeValue::String(text) => read(text).map_err(|problem| self.bad(self.value, &problem)),
            _ => Err(self.not("a string", self.value)),
        }
    }

    /// A list of strings, or a string for a list of one.
    pub(super) fn list<T>(
        &self,
        read: impl Fn(&str) -> Result<T, String>,
    ) -> Result<Vec<T>, Wrong> {
        let DeValue::Array(items) = self.value.get_ref() else {
            return match self.value.get_ref() {
                DeValue::String(_) => Ok(vec![self.text(read)?]),
                _ => Err(self.not("a string or a list of strings", self.value)),
            };
        };
        let item = |item: &Spanned<DeValue<'_>>| match item.get_ref() {
            DeValue::String(text) => read(text).map_err(|problem| self.bad(item, &problem)),
            _ => Err(self.not("a list of strings only", item)),
        };
        items.iter().map(item).collect()
    }

    /// Tables, each with its place in the file.
    pub(super) fn tables(&self) -> Result<Vec<(usize, &'a DeTable<'a>)>, Wrong> {
        let DeValue::Array(items) = self.value.get_ref() else {
            return Err(self.not("tables, each under [[rules]]", self.value));
        };
        let table = |item: &'a Spanned<DeValue<'a>>| match item.get_ref() {
            DeValue::Table(table) => Ok((item.span().start, table)),
            _ => Err(self.not("tables only, each under [[rules]]", item)),
        };
        items.iter().map(table).collect()
    }

    /// A table of strings.
    pub(super) fn strings<K: Ord, V>(
        &self,
        read_key: impl Fn(&str) -> Result<K, String>,
        read: impl Fn(&str) -> Result<V, String>,
    ) -> Result<BTreeMap<K, V>, Wrong> {
        let pair = |(key, value): (&Spanned<_>, &Spanned<DeValue<'_>>)| {
            let name: &std::borrow::Cow<'_, str> = key.get_ref();
            let known = read_key(name).map_err(|problem| Wrong {
                at: key.span().start,
                problem: format!("{}: {problem}", self.key),
            })?;
            match value.get_ref() {
                DeValue::String(text) => {
                    let value = read(text).map_err(|problem| self.bad(value, &problem))?;
                    Ok((known, value))
                }
                _ => Err(self.not("a table of strings only", value)),
            }
        };
        self.table()?.iter().map(pair).collect()
    }

    /// `true` or `false`.
    pub(super) fn flag(&self) -> Result<bool, Wrong> {
        match self.value.get_ref() {
            DeValue::Boolean(flag) => Ok(*flag),
            _ => Err(self.not("true or false", self.value)),
        }
    }

    /// A whole number.
    pub(super) fn number<T>(&self, read: impl Fn(u64) -> Result<T, String>) -> Result<T, Wrong> {
        let DeValue::Integer(digits) = self.value.get_ref() else {
            return Err(self.not("a whole number", self.value));
        };
        let number = u64::from_str_radix(digits.as_str(), digits.radix())
            .map_err(|_| format!("{digits} is negative or too large"));
        let read = number.and_then(read);
        read.map_err(|problem| self.bad(self.value, &problem))
    }

    /// A table.
    pub(super) fn table(&self) -> Result<&DeTable<'_>, Wrong> {
        match self.value.get_ref() {
            DeValue::Table(table) => Ok(table),
            _ => Err(self.not("a table", self.value)),
        }
    }

    /// The endpoints. None at all would be a daemon that nobody can reach.
    pub(super) fn listen(&self) -> Result<Vec<Address>, Wrong> {
        let addresses = self.list(value::listen_address)?;
        if addresses.is_empty() {
            return Err(self.bad(self.value, "at least one endpoint is needed"));
        }
        Ok(addresses)
    }

    fn bad(&self, at: &Spanned<DeValue<'_>>, problem: &str) -> Wrong {
        Wrong {
            at: at.span().start,
            problem: format!("{}: {problem}", self.key),
        }
    }

    fn not(&self, wanted: &str, at: &Spanned<DeValue<'_>>) -> Wrong {
        let found = match at.get_ref() {
            DeValue::String(_) => "a string",
            DeValue::Integer(_) => "a whole number",
            DeValue::Float(_) => "a number with a fraction",
            DeValue::Boolean(_) => "true or false",
            DeValue::Datetime(_) => "a date or time",
            DeValue::Array(_) => "a list",
            DeValue::Table(_) => "a table",
        };
        self.bad(at, &format!("this takes {wanted}, not {found}"))
    }
}
