//! The token of Suzuki and Kasami, written as the C++ library does: a Boost text archive.

use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write;

use fipa_acl::Text;

const SIGNATURE: &str = "serialization::archive";
/// What Boost 1.74 writes; other releases refuse numbers above their own.
const ARCHIVE_VERSION: &str = "18";
/// Class information of Boost: a tracking level and a version.
const CLASS: &str = " 0 0";

/// Whose requests were served, and who is next.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Token {
    pub(crate) resource: Text,
    /// The number of each agent's last request that was served.
    pub(crate) served: BTreeMap<Text, u64>,
    /// Who gets the token next.
    pub(crate) queue: VecDeque<Text>,
}

/// The text is no token.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the token is malformed at octet {at}: {what}")]
pub(crate) struct TokenError {
    at: usize,
    what: &'static str,
}

impl Token {
    pub(crate) fn new(resource: Text) -> Token {
        Token {
            resource,
            served: BTreeMap::new(),
            queue: VecDeque::new(),
        }
    }

    pub(crate) fn encode(&self) -> String {
        let mut text = format!("{} {SIGNATURE} {ARCHIVE_VERSION}", SIGNATURE.len());
        put_string(&mut text, &self.resource);
        // The token, the map of the numbers, how many there are.
        text.push_str(CLASS);
        text.push_str(CLASS);
        put_number(&mut text, self.served.len() as u64);
        put_number(&mut text, 0);
        // A class is described where its first object stands: the pair, and the agent in it.
        if !self.served.is_empty() {
            text.push_str(CLASS);
            text.push_str(CLASS);
        }
        for (agent, number) in &self.served {
            put_string(&mut text, agent);
            put_number(&mut text, *number);
        }
        text.push_str(CLASS);
        put_number(&mut text, self.queue.len() as u64);
        put_number(&mut text, 0);
        if self.served.is_empty() && !self.queue.is_empty() {
            text.push_str(CLASS);
        }
        for agent in &self.queue {
            put_string(&mut text, agent);
        }
        text
    }

    /// Reads a token of any archive version, with this many agents in each of its lists at most.
    pub(crate) fn decode(text: &str, max: usize) -> Result<Token, TokenError> {
        let mut reader = Reader { text, at: 0 };
        if reader.string()? != SIGNATURE {
            return Err(reader.error("this is no Boost text archive"));
        }
        reader.number()?;
        let mut token = Token::new(Text::from(reader.string()?));
        reader.class()?;
        reader.class()?;
        let agents = reader.count(max)?;
        if agents > 0 {
            reader.class()?;
            reader.class()?;
        }
        for _ in 0..agents {
            let agent = Text::from(reader.string()?);
            token.served.insert(agent, reader.number()?);
        }
        reader.class()?;
        let waiting = reader.count(max)?;
        if agents == 0 && waiting > 0 {
            reader.class()?;
        }
        for _ in 0..waiting {
            token.queue.push_back(Text::from(reader.string()?));
        }
        match reader.rest().trim_end() {
            "" => Ok(token),
            _ => Err(reader.error("something follows its end")),
        }
    }
}

fn put_number(text: &mut String, number: u64) {
    // Writing to a string does not fail.
    let _ = write!(text, " {number}");
}

fn put_string(text: &mut String, string: &str) {
    let _ = write!(text, " {} {string}", string.len());
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Reader<'a> {
    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or_default()
    }

    fn error(&self, what: &'static str) -> TokenError {
        TokenError { at: self.at, what }
    }

    fn number(&mut self) -> Result<u64, TokenError> {
        let rest = self.rest();
        let word = rest.trim_start_matches(' ');
        let end = word.find(' ').unwrap_or(word.len());
        let (digits, after) = word.split_at(end);
        let number = digits.trim_end().parse();
        let number = number.map_err(|_| self.error("there is no number"))?;
        self.at += rest.len() - after.len();
        Ok(number)
    }

    /// The description of a class; what it says is of no use here.
    fn class(&mut self) -> Result<(), TokenError> {
        self.number()?;
        self.number()?;
        Ok(())
    }

    /// The number of items of a list, and the version of their class.
    fn count(&mut self, max: usize) -> Result<u64, TokenError> {
        let count = self.number()?;
        if count > max as u64 {
            return Err(self.error("it names too many agents"));
        }
        self.number()?;
        Ok(count)
    }

    fn string(&mut self) -> Result<&'a str, TokenError> {
        let length = self.number()?;
        let body = self.rest().strip_prefix(' ');
        let body = body.ok_or_else(|| self.error("there is no string"))?;
        let string = usize::try_from(length).ok().and_then(|end| body.get(..end));
        let string = string.ok_or_else(|| self.error("a string is shorter than it says"))?;
        self.at += 1 + string.len();
        Ok(string)
    }
}

#[cfg(test)]
mod tests {
    use proptest::collection::{btree_map, vec_deque};
    use proptest::prelude::*;

    use super::*;

    const RECORDED: &str = "22 serialization::archive 18 8 resource 0 0 0 0 2 0 0 0 0 0 6 agent2 1 6 agent3 1 0 0 1 0 6 agent3";

    #[test]
    fn a_recorded_token_is_read_and_written_back() {
        let token = Token::decode(RECORDED, 10).unwrap();
        assert_eq!(token.resource, "resource");
        assert_eq!(token.served[&Text::from("agent2")], 1);
        assert_eq!(token.queue, [Text::from("agent3")]);
        assert_eq!(token.encode(), RECORDED);
    }

    #[test]
    fn tokens_of_other_boost_releases_are_read() {
        let other = RECORDED.replace("archive 18", "archive 21");
        assert_eq!(
            Token::decode(&other, 10).unwrap(),
            Token::decode(RECORDED, 10).unwrap()
        );
    }

    #[test]
    fn a_malformed_token_is_refused_with_its_place() {
        let error = |text: &str| Token::decode(text, 10).unwrap_err().to_string();
        assert_eq!(
            error("22 serialization::archive 18 9 resource"),
            "the token is malformed at octet 30: a string is shorter than it says"
        );
        assert_eq!(
            error(&RECORDED.replace("0 0 2 0", "0 0 11 0")),
            "the token is malformed at octet 50: it names too many agents"
        );
        assert_eq!(
            error(&format!("{RECORDED} 1")),
            format!(
                "the token is malformed at octet {}: something follows its end",
                RECORDED.len()
            )
        );
        assert!(error("").ends_with("octet 0: there is no number"));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(
            resource in "\\PC{0,9}",
            served in btree_map("\\PC{0,9}", any::<u64>(), 0..4),
            queue in vec_deque("\\PC{0,9}", 0..4),
        ) {
            let token = Token {
                resource: Text::from(resource),
                served: served.into_iter().map(|(k, v)| (Text::from(k), v)).collect(),
                queue: queue.into_iter().map(Text::from).collect(),
            };
            prop_assert_eq!(Token::decode(&token.encode(), 4), Ok(token));
        }

        #[test]
        fn no_text_makes_the_reader_panic(cut in 0..RECORDED.len(), put in "\\PC{0,5}") {
            let text = format!("{}{put}{}", &RECORDED[..cut], &RECORDED[cut..]);
            let _ = Token::decode(&text, 10);
            let _ = Token::decode(&RECORDED[..cut], 10);
        }
    }
}
