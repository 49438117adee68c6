//! A document as a tree of elements that know where they stand.
//!
//! **Knows** XML, namespaces by their prefixes, and the limits. **Never knows** what an element
//! means. No entity is ever expanded but the five of XML itself and those to numbers.

use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;

use crate::diagnostic::{LoadError, Position};
use crate::{Limits, NAMESPACE};

const SCXML: &str = "http://www.w3.org/2005/07/scxml";

/// Whose an element or attribute is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Space {
    /// SCXML or the dialect of it: without a prefix.
    Scxml,
    /// What this crate adds.
    Ours,
    /// Somebody else's: of no interest.
    Foreign,
}

#[derive(Debug)]
pub(crate) struct Element {
    pub(crate) space: Space,
    pub(crate) name: String,
    pub(crate) position: Position,
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) children: Vec<Element>,
}

#[derive(Debug)]
pub(crate) struct Attribute {
    pub(crate) space: Space,
    pub(crate) name: String,
    pub(crate) value: String,
    pub(crate) position: Position,
}

impl Element {
    /// An attribute of SCXML or of the dialect; the latter may bear our prefix.
    pub(crate) fn attribute(&self, name: &str) -> Option<&Attribute> {
        let spaces = [Space::Scxml, Space::Ours];
        spaces.iter().find_map(|space| self.find(*space, name))
    }

    /// An attribute that this crate adds.
    pub(crate) fn extension(&self, name: &str) -> Option<&Attribute> {
        self.find(Space::Ours, name)
    }

    fn find(&self, space: Space, name: &str) -> Option<&Attribute> {
        self.attributes
            .iter()
            .find(|attribute| attribute.space == space && attribute.name == name)
    }
}

/// Reads a whole document.
pub(crate) fn read(bytes: &[u8], limits: &Limits) -> Result<Element, LoadError> {
    let at_start = |what: String| LoadError {
        position: Position { line: 1, column: 1 },
        what,
    };
    if bytes.len() > limits.max_octets {
        let what = format!("the file is longer than {} octets", limits.max_octets);
        return Err(at_start(what));
    }
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.strip_prefix('\u{feff}').unwrap_or(text),
        Err(error) => {
            let valid = bytes.get(..error.valid_up_to()).unwrap_or_default();
            let valid = String::from_utf8_lossy(valid);
            return Err(LoadError {
                position: Lines::new(&valid).position(valid.len()),
                what: "this is not UTF-8".into(),
            });
        }
    };
    Builder {
        text,
        lines: Lines::new(text),
        limits,
        items_left: limits.max_items,
        open: Vec::new(),
        root: None,
    }
    .run()
}

/// Where the lines of a text begin.
struct Lines<'a> {
    text: &'a str,
    starts: Vec<usize>,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Lines<'a> {
        let breaks = text.match_indices('\n').map(|(at, _)| at + 1);
        Lines {
            text,
            starts: std::iter::once(0).chain(breaks).collect(),
        }
    }

    fn position(&self, offset: usize) -> Position {
        let line = self.starts.partition_point(|start| *start <= offset);
        let start = line.checked_sub(1).and_then(|i| self.starts.get(i));
        let before = self.text.get(start.copied().unwrap_or(0)..offset);
        Position {
            line,
            column: before.map_or(0, |text| text.chars().count()) + 1,
        }
    }
}

struct Builder<'a> {
    text: &'a str,
    lines: Lines<'a>,
    limits: &'a Limits,
    items_left: usize,
    open: Vec<Open>,
    root: Option<Element>,
}

/// An element whose end tag was not read, with the prefixes that it declares.
struct Open {
    element: Element,
    prefixes: Vec<(String, Space)>,
}

impl Builder<'_> {
    fn run(mut self) -> Result<Element, LoadError> {
        let mut reader = Reader::from_str(self.text);
        loop {
            let start = to_usize(reader.buffer_position());
            let event = reader.read_event().map_err(|error| {
                let at = to_usize(reader.error_position());
                self.error(at, format!("this is not XML: {error}"))
            })?;
            match event {
                Event::Start(tag) => self.open(start, &tag)?,
                Event::Empty(tag) => {
                    self.open(start, &tag)?;
                    self.close();
                }
                Event::End(_) => self.close(),
                Event::Text(text) if self.open.is_empty() => {
                    if let Some(at) = text.find(|c: char| !c.is_ascii_whitespace()) {
                        return Err(self.error(
                            start + at,
                            "this is not XML: text outside of the outermost element",
                        ));
                    }
                }
                Event::CData(_) | Event::GeneralRef(_) if self.open.is_empty() => {
                    return Err(self.error(
                        start,
                        "this is not XML: text outside of the outermost element",
                    ));
                }
                Event::GeneralRef(reference) => {
                    if character(&reference).is_none() {
                        return Err(self.unknown_reference(start, &reference));
                    }
                }
                Event::DocType(text) => {
                    if text.contains('[') {
                        return Err(self.error(
                            start,
                            "a document type with declarations of its own is not read",
                        ));
                    }
                    if self.root.is_some() || !self.open.is_empty() {
                        return Err(self.error(
                            start,
                            "this is not XML: a document type stands in front of the elements",
                        ));
                    }
                }
                Event::Text(_)
                | Event::CData(_)
                | Event::Comment(_)
                | Event::Decl(_)
                | Event::PI(_) => {}
                Event::Eof => return self.finish(start),
            }
        }
    }

    fn finish(mut self, end: usize) -> Result<Element, LoadError> {
        if let Some(open) = self.open.pop() {
            let name = open.element.name;
            return Err(self.error(
                end,
                format!("this is not XML: the end of <{name}> is missing"),
            ));
        }
        match self.root.take() {
            Some(root) => Ok(root),
            None => Err(self.error(end, "this is not XML: there is no element")),
        }
    }

    fn open(&mut self, start: usize, tag: &BytesStart<'_>) -> Result<(), LoadError> {
        if self.open.is_empty() && self.root.is_some() {
            return Err(self.error(
                start,
                "this is not XML: there is a second outermost element",
            ));
        }
        if self.open.len() >= self.limits.max_depth {
            return Err(self.error(
                start,
                format!("elements are nested deeper than {}", self.limits.max_depth),
            ));
        }
        self.count(start)?;
        let raw = self.attributes(start, tag)?;
        let prefixes = raw
            .iter()
            .filter_map(|(name, value, _)| declared(name, value));
        let prefixes: Vec<_> = prefixes.collect();
        let space = |name: &str| self.space(&prefixes, name);
        let attributes = raw.iter().map(|(name, value, at)| Attribute {
            space: space(name),
            name: local(name).to_owned(),
            value: value.clone(),
            position: self.lines.position(*at),
        });
        let name = tag.name();
        if !begins_name(name.as_ref()) {
            return Err(self.error(start, "this is not XML: no tag begins like this"));
        }
        let element = Element {
            space: space(name.as_ref()),
            name: local(name.as_ref()).to_owned(),
            position: self.lines.position(start),
            attributes: attributes.collect(),
            children: Vec::new(),
        };
        self.open.push(Open { element, prefixes });
        Ok(())
    }

    /// Names with their prefixes, values, and the offsets of the names.
    fn attributes(
        &mut self,
        start: usize,
        tag: &BytesStart<'_>,
    ) -> Result<Vec<(String, String, usize)>, LoadError> {
        let mut found = Vec::new();
        for attribute in tag.attributes() {
            self.count(start)?;
            let attribute = attribute
                .map_err(|error| self.error(start, format!("this is not XML: {error}")))?;
            let name = attribute.key.into_inner();
            let at = start + 1 + offset_within(tag, name);
            if attribute.value.contains('<') {
                return Err(self.error(at, "this is not XML: < within a value"));
            }
            let value = unescaped(&attribute.value)
                .map_err(|reference| self.unknown_reference(at, &reference))?;
            found.push((name.to_owned(), value, at));
        }
        Ok(found)
    }

    fn close(&mut self) {
        let Some(open) = self.open.pop() else { return };
        match self.open.last_mut() {
            Some(parent) => parent.element.children.push(open.element),
            None => self.root = Some(open.element),
        }
    }

    /// Whose a name is. Names without a prefix belong to SCXML whatever the default namespace is:
    /// peers write none at all.
    fn space(&self, own: &[(String, Space)], name: &str) -> Space {
        let Some((prefix, _)) = name.split_once(':') else {
            return Space::Scxml;
        };
        let outer = self.open.iter().rev().flat_map(|open| &open.prefixes);
        let mut declared = own.iter().chain(outer);
        let found = declared.find(|(declared, _)| declared == prefix);
        found.map_or(Space::Foreign, |(_, space)| *space)
    }

    fn count(&mut self, at: usize) -> Result<(), LoadError> {
        match self.items_left.checked_sub(1) {
            Some(left) => {
                self.items_left = left;
                Ok(())
            }
            None => Err(self.error(
                at,
                format!(
                    "there are more than {} elements and attributes",
                    self.limits.max_items
                ),
            )),
        }
    }

    fn unknown_reference(&self, at: usize, reference: &str) -> LoadError {
        self.error(
            at,
            format!("this is not XML: &{reference}; stands for nothing that is known"),
        )
    }

    fn error(&self, offset: usize, what: impl Into<String>) -> LoadError {
        LoadError {
            position: self.lines.position(offset),
            what: what.into().replace(['\n', '\r'], " "),
        }
    }
}

fn to_usize(position: u64) -> usize {
    usize::try_from(position).unwrap_or(usize::MAX)
}

/// The prefix that an attribute declares, if it is such a one.
fn declared(name: &str, value: &str) -> Option<(String, Space)> {
    let prefix = name.strip_prefix("xmlns:")?;
    let space = match value {
        SCXML => Space::Scxml,
        NAMESPACE => Space::Ours,
        _ => Space::Foreign,
    };
    Some((prefix.to_owned(), space))
}

fn local(name: &str) -> &str {
    name.split_once(':').map_or(name, |(_, local)| local)
}

fn begins_name(name: &str) -> bool {
    let first = name.chars().next();
    first.is_some_and(|first| first.is_alphabetic() || matches!(first, '_' | ':'))
}

fn offset_within(text: &str, part: &str) -> usize {
    let offset = part.as_ptr().addr().checked_sub(text.as_ptr().addr());
    offset.filter(|offset| *offset <= text.len()).unwrap_or(0)
}

/// The value with what its references stand for; the reference that stands for nothing.
fn unescaped(value: &str) -> Result<String, String> {
    let mut text = String::with_capacity(value.len());
    let mut rest = value;
    while let Some((before, behind)) = rest.split_once('&') {
        text.push_str(before);
        let Some((reference, after)) = behind.split_once(';') else {
            return Err(behind.chars().take(16).collect());
        };
        text.push(
            character(reference).ok_or_else(|| reference.chars().take(16).collect::<String>())?,
        );
        rest = after;
    }
    text.push_str(rest);
    // XML makes blanks of them.
    Ok(text.replace(['\t', '\n', '\r'], " "))
}

/// What a reference stands for.
fn character(reference: &str) -> Option<char> {
    let number = |digits, radix| {
        u32::from_str_radix(digits, radix)
            .ok()
            .and_then(char::from_u32)
    };
    match reference {
        "amp" => Some('&'),
        "lt" => Some('<'),
        "gt" => Some('>'),
        "quot" => Some('"'),
        "apos" => Some('\''),
        _ => match reference.strip_prefix('#')? {
            digits if digits.starts_with('x') => number(digits.trim_start_matches('x'), 16),
            digits => number(digits, 10),
        },
    }
    .filter(|character| *character != '\0')
}
