use std::fmt;

use fipa_acl::{Performative, Text};

use crate::pattern::{Pattern, PatternError};

/// The acts that a transition takes: a bit for each of the 22 of the standard, set when the file
/// is loaded, and the expression for any other word.
#[derive(Clone, Debug)]
pub struct Performatives {
    bits: u32,
    text: Text,
    names: Vec<Text>,
    others: Option<Pattern>,
}

const ALL: u32 = (1 << 22) - 1;

impl Performatives {
    /// The acts whose whole names match one of these expressions, in any case.
    pub(crate) fn new(
        expressions: &[&str],
        max_pattern: usize,
    ) -> Result<Performatives, PatternError> {
        let text = Text::from(expressions.join("|"));
        // Nearly all are a name, or a few: those need no expression.
        if let Some(bits) = listed(&text) {
            return Ok(Performatives::of(bits, text, None));
        }
        for expression in expressions {
            // Each must be a whole by itself: `a)|(b` would break out of the group.
            Pattern::new(expression, max_pattern)?;
        }
        let alternatives = expressions.iter().map(|one| format!("(?:{one})"));
        let alternatives: Vec<String> = alternatives.collect();
        let pattern = Pattern::new(&format!("(?i){}", alternatives.join("|")), max_pattern)?;
        let standard = Performative::STANDARD;
        let matching = standard.iter().filter(|act| pattern.matches(act.as_str()));
        let bits = matching.fold(0, |bits, act| bits | bit(act));
        Ok(Performatives::of(bits, text, Some(pattern)))
    }

    fn of(bits: u32, text: Text, others: Option<Pattern>) -> Performatives {
        let standard = Performative::STANDARD;
        let those = standard.iter().filter(|act| bits & bit(act) != 0);
        let names = match bits {
            ALL => vec![Text::from_static(".*")],
            0 => vec![text.clone()],
            _ => those.map(|act| Text::from(act.as_str())).collect(),
        };
        Performatives {
            bits,
            text,
            names,
            others,
        }
    }

    /// The names of those of the standard; `.*` for all of them, and the expression for none.
    pub fn names(&self) -> &[Text] {
        &self.names
    }

    /// Whether the act is one of these.
    #[inline]
    pub fn contains(&self, act: &Performative) -> bool {
        match act {
            Performative::Other(word) => self.others.as_ref().is_some_and(|p| p.matches(word)),
            act => self.bits & bit(act) != 0,
        }
    }

    /// Those of the standard among these, in alphabetical order.
    pub fn standard(&self) -> impl Iterator<Item = Performative> + '_ {
        Performative::STANDARD
            .into_iter()
            .filter(|act| self.bits & bit(act) != 0)
    }

    /// Whether every act of the standard is among these.
    pub fn is_any(&self) -> bool {
        self.bits == ALL
    }

    pub(crate) fn is_of_no_standard_act(&self) -> bool {
        self.bits == 0
    }

    pub(crate) fn overlaps(&self, other: &Performatives) -> bool {
        self.bits & other.bits != 0
    }

    /// Whether these are all acts of the other and more are there.
    pub(crate) fn is_within_more(&self, other: &Performatives) -> bool {
        self.bits & !other.bits == 0 && self.bits != other.bits
    }
}

/// The place of an act of the standard; zero for another word.
#[inline]
fn bit(act: &Performative) -> u32 {
    macro_rules! bits {
        ($($variant:ident)*) => {{
            #[repr(u8)]
            enum Place { $($variant,)* }
            match act {
                $(Performative::$variant => 1 << Place::$variant as u8,)*
                Performative::Other(_) => 0,
            }
        }};
    }
    bits!(
        AcceptProposal Agree Cancel Cfp Confirm Disconfirm Failure Inform InformIf InformRef
        NotUnderstood Propagate Propose Proxy QueryIf QueryRef Refuse RejectProposal Request
        RequestWhen RequestWhenever Subscribe
    )
}

/// The acts of a text that is nothing but names of the standard, joined by `|`.
fn listed(text: &str) -> Option<u32> {
    let mut names = text.split('|').map(Performative::standard);
    names.try_fold(0, |bits, act| Some(bits | bit(&act?)))
}

impl fmt::Display for Performatives {
    /// The names, joined by ` or `; `any act` for all of them; the expression if the names are many
    /// or none of the standard.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const MANY: u32 = 6;
        match self.bits.count_ones() {
            _ if self.is_any() => f.write_str("any act"),
            0 => f.write_str(&self.text),
            names if names > MANY => f.write_str(&self.text),
            _ => {
                let names: Vec<String> = self.standard().map(|act| act.to_string()).collect();
                f.write_str(&names.join(" or "))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bits_are_those_of_the_list_of_the_standard() {
        for (place, act) in Performative::STANDARD.iter().enumerate() {
            assert_eq!(bit(act), 1 << place, "{act}");
        }
    }

    #[test]
    fn a_list_of_names_takes_no_other_word_and_an_expression_does() {
        let list = Performatives::new(&["inform|AGREE"], 1 << 16).unwrap();
        let names: Vec<_> = list.standard().collect();
        assert_eq!(names, [Performative::Agree, Performative::Inform]);
        assert!(!list.contains(&"shout".into()));
        let any = Performatives::new(&[".*"], 1 << 16).unwrap();
        assert!(any.is_any() && any.contains(&"shout".into()));
        assert_eq!(any.to_string(), "any act");
        let own = Performatives::new(&["shout"], 1 << 16).unwrap();
        assert!(own.contains(&"shout".into()) && own.is_of_no_standard_act());
    }

    #[test]
    fn the_whole_name_must_match() {
        let inform = Performatives::new(&["inform"], 1 << 16).unwrap();
        assert!(!inform.contains(&Performative::InformIf));
        assert!(Performatives::new(&["inform)|(agree"], 1 << 16).is_err());
        assert!(Performatives::new(&["(a{1000}){1000}"], 1 << 16).is_err());
    }
}
