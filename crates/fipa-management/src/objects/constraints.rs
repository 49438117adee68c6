use fipa_acl::Text;
use fipa_sl::{FrameError, Functional, Term};

use super::frame::Frame;

pub(crate) const OBJECT: &str = "search-constraints";

/// More results than there are. JADE gives no more than 100 to whoever asks for all of them by a
/// number below zero, and as many as are asked for to whoever names a number.
const ALL: i64 = i32::MAX as i64;

/// How far a search goes (FIPA SC00023K, search-constraints).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SearchConstraints {
    /// How many DFs away federated DFs are asked; absent: none. Below zero: any number.
    pub max_depth: Option<i64>,
    /// How many descriptions are wanted; absent: one. Below zero: all.
    pub max_results: Option<i64>,
    /// What the search is told by when it comes around again.
    pub search_id: Option<Text>,
}

impl SearchConstraints {
    /// A search for all that matches, at the DF that is asked alone.
    pub fn all() -> SearchConstraints {
        SearchConstraints {
            max_results: Some(ALL),
            ..SearchConstraints::default()
        }
    }

    /// How many results are wanted, if `most` are given at most.
    pub(crate) fn limit(&self, most: usize) -> usize {
        let wanted = self.max_results.unwrap_or(1);
        usize::try_from(wanted).map_or(most, |wanted| wanted.min(most))
    }
}

impl TryFrom<&Term> for SearchConstraints {
    type Error = FrameError;

    fn try_from(term: &Term) -> Result<SearchConstraints, FrameError> {
        let frame = Frame::of(term, OBJECT)?;
        Ok(SearchConstraints {
            max_depth: frame.integer("max-depth")?,
            max_results: frame.integer("max-results")?,
            search_id: frame.text("search-id")?,
        })
    }
}

impl From<&SearchConstraints> for Term {
    fn from(constraints: &SearchConstraints) -> Term {
        Functional::object(Text::from_static(OBJECT))
            .with_some("max-results", constraints.max_results.map(Term::integer))
            .with_some("max-depth", constraints.max_depth.map(Term::integer))
            .with_some("search-id", constraints.search_id.as_ref())
            .into()
    }
}
