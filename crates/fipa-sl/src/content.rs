use std::str::FromStr;

use bytes::Bytes;

use crate::reader::Reader;
use crate::{Limits, ParseError, Profile, Term};

/// The content of a message in SL (SC00008I, Content): one or more actions, propositions and
/// identifying expressions in a pair of parentheses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Content {
    first: Term,
    others: Vec<Term>,
}

impl Content {
    /// A content of one expression.
    pub fn new(expression: impl Into<Term>) -> Content {
        Content {
            first: expression.into(),
            others: Vec::new(),
        }
    }

    /// Adds an expression, such as the reason behind the action that is refused.
    #[must_use]
    pub fn and(mut self, expression: impl Into<Term>) -> Content {
        self.others.push(expression.into());
        self
    }

    /// Reads a content that fills all of the octets; the texts share their buffer.
    pub fn parse(octets: &Bytes, limits: &Limits) -> Result<Content, ParseError> {
        Reader::whole(octets, limits, |reader| {
            let (first, others) = reader.content()?;
            Ok(Content { first, others })
        })
    }

    /// The first expression.
    pub fn first(&self) -> &Term {
        &self.first
    }

    /// The first expression, taken out.
    pub fn into_first(self) -> Term {
        self.first
    }

    /// The expressions behind the first.
    pub fn others(&self) -> &[Term] {
        &self.others
    }

    /// All expressions.
    pub fn expressions(&self) -> impl Iterator<Item = &Term> {
        std::iter::once(&self.first).chain(&self.others)
    }

    /// The smallest profile that has all that stands here.
    pub fn profile(&self) -> Profile {
        let profiles = self.expressions().map(Profile::of);
        profiles.max().unwrap_or(Profile::Sl0)
    }

    /// The octets of the content, as a message carries them.
    pub fn to_bytes(&self) -> Bytes {
        Bytes::from(self.to_octets())
    }
}

impl FromStr for Content {
    type Err = ParseError;

    /// Reads a content with the default limits.
    fn from_str(text: &str) -> Result<Content, ParseError> {
        Content::parse(&Bytes::copy_from_slice(text.as_bytes()), &Limits::default())
    }
}

impl Term {
    /// Reads one term that fills all of the octets; the texts share their buffer.
    pub fn parse(octets: &Bytes, limits: &Limits) -> Result<Term, ParseError> {
        Reader::whole(octets, limits, |reader| reader.term(1))
    }
}

impl FromStr for Term {
    type Err = ParseError;

    /// Reads a term with the default limits.
    fn from_str(text: &str) -> Result<Term, ParseError> {
        Term::parse(&Bytes::copy_from_slice(text.as_bytes()), &Limits::default())
    }
}
