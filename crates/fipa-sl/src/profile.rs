use crate::{Functional, Term};

/// The profiles of SL (SC00008I), each a part of the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Profile {
    /// Actions, their being done and their results, predicates.
    Sl0,
    /// And the propositional connectives.
    Sl1,
    /// And identifying expressions, modal operators, and quantifiers in front of all else.
    Sl2,
    /// And everything in any place.
    Sl,
}

/// Where a term stands, as far as quantifiers may stand there in SL2.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    /// At the head of a formula.
    Head,
    /// Behind nothing but quantifiers, the last of which is `exists`.
    BehindExists,
    Within,
}

impl Profile {
    /// The profile with this name as a message's language, in any case.
    pub fn from_language(name: &str) -> Option<Profile> {
        let profiles = [Profile::Sl0, Profile::Sl1, Profile::Sl2, Profile::Sl];
        profiles
            .into_iter()
            .find(|profile| profile.language().eq_ignore_ascii_case(name))
    }

    /// The name of the profile as a message's language.
    pub fn language(self) -> &'static str {
        match self {
            Profile::Sl0 => "fipa-sl0",
            Profile::Sl1 => "fipa-sl1",
            Profile::Sl2 => "fipa-sl2",
            Profile::Sl => "fipa-sl",
        }
    }

    pub(crate) fn of(term: &Term) -> Profile {
        of_term(term, Place::Head)
    }
}

fn of_term(term: &Term, place: Place) -> Profile {
    match term {
        Term::Variable(_) => Profile::Sl2,
        Term::Functional(functional) => of_functional(functional, place),
        _ => Profile::Sl0,
    }
}

fn of_functional(functional: &Functional, place: Place) -> Profile {
    let (own, inner) = operator(functional, place);
    let positional = functional.positional().iter();
    let named = functional.parameters().iter().map(|(_, value)| value);
    let last = functional.positional().len().checked_sub(1);
    let of_positional = positional.enumerate().map(|(i, term)| {
        // The formula is the last argument of every operator.
        let place = if Some(i) == last {
            inner
        } else {
            Place::Within
        };
        of_term(term, place)
    });
    let of_named = named.map(|term| of_term(term, Place::Within));
    of_positional.chain(of_named).fold(own, Profile::max)
}

/// The profile of a symbol with so many arguments, and the place of its formula.
fn operator(functional: &Functional, place: Place) -> (Profile, Place) {
    let symbol = functional.symbol.to_ascii_lowercase();
    match (symbol.as_str(), functional.positional().len()) {
        ("not", 1) | ("and" | "or" | "implies" | "equiv", 2) => (Profile::Sl1, Place::Within),
        ("forall", 2) if place == Place::Head => (Profile::Sl2, Place::Head),
        ("exists", 2) if place != Place::Within => (Profile::Sl2, Place::BehindExists),
        ("forall" | "exists", 2) => (Profile::Sl, Place::Within),
        ("iota" | "any" | "all", 2) | ("b" | "u" | "pg" | "i", 2) => (Profile::Sl2, Place::Head),
        ("feasible", 1 | 2) | ("done", 2) => (Profile::Sl2, Place::Head),
        ("=" | "|" | ";", 2) => (Profile::Sl2, Place::Within),
        _ => (Profile::Sl0, Place::Within),
    }
}
