//! What is written follows the grammar of FIPA SC00070I to the letter: a plain reader that knows
//! nothing else reads the same values.

mod string_support;

use fipa_acl::{AgentId, Expression, FipaTime, Message, Performative, Relative, Text, UserDefined};
use proptest::prelude::*;
use string_support::{messages, octets_of};

/// The rest of the text; each rule takes from its beginning what it matches.
struct Plain<'a>(&'a [u8]);

type Rule<T> = Result<T, String>;

impl<'a> Plain<'a> {
    fn message(&mut self) -> Rule<Message> {
        self.token("(")?;
        let mut message = Message::new(self.message_type()?);
        while !self.is_next(b')') {
            self.message_parameter(&mut message)?;
        }
        self.token(")")?;
        match self.0 {
            [] => Ok(message),
            _ => self.fail("the end"),
        }
    }

    fn message_type(&mut self) -> Rule<Performative> {
        let name = self.word()?;
        let acts = Performative::STANDARD;
        match acts.into_iter().find(|act| *act.as_str() == *name) {
            Some(act) => Ok(act),
            None => self.fail("an act of the standard"),
        }
    }

    fn message_parameter(&mut self, message: &mut Message) -> Rule<()> {
        let name = self.word()?;
        match &*name {
            ":sender" => message.sender = Some(self.agent()?),
            ":receiver" => message.receiver = self.agents("set")?,
            ":content" => message.content = Some(self.string()?.into()),
            ":reply-with" => message.reply_with = Some(self.expression()?),
            ":reply-by" => message.reply_by = Some(self.date_time()?),
            ":in-reply-to" => message.in_reply_to = Some(self.expression()?),
            ":reply-to" => message.reply_to = self.agents("set")?,
            ":language" => message.language = Some(self.expression()?),
            ":encoding" => message.encoding = Some(self.expression()?),
            ":ontology" => message.ontology = Some(self.expression()?),
            ":protocol" => message.protocol = Some(self.word()?),
            ":conversation-id" => message.conversation_id = Some(self.expression()?),
            _ => message.user_defined.push(self.user_defined(&name)?),
        }
        Ok(())
    }

    fn user_defined(&mut self, name: &str) -> Rule<UserDefined> {
        let Some(name) = name.strip_prefix(":X-") else {
            return self.fail("a user-defined parameter");
        };
        Ok(UserDefined {
            name: name.into(),
            value: self.expression()?,
        })
    }

    fn agent(&mut self) -> Rule<AgentId> {
        self.token("(")?;
        self.keyword("agent-identifier")?;
        self.keyword(":name")?;
        let mut agent = AgentId::new(self.word()?);
        while !self.is_next(b')') {
            match &*self.word()? {
                ":addresses" => agent.addresses = self.urls()?,
                ":resolvers" => agent.resolvers = self.agents("sequence")?,
                name => agent.user_defined.push(self.user_defined(name)?),
            }
        }
        self.token(")")?;
        Ok(agent)
    }

    fn agents(&mut self, collection: &str) -> Rule<Vec<AgentId>> {
        self.token("(")?;
        self.keyword(collection)?;
        let mut agents = Vec::new();
        while !self.is_next(b')') {
            agents.push(self.agent()?);
        }
        self.token(")")?;
        Ok(agents)
    }

    fn urls(&mut self) -> Rule<Vec<Text>> {
        self.token("(")?;
        self.keyword("sequence")?;
        let mut urls = Vec::new();
        while !self.is_next(b')') {
            urls.push(self.word()?);
        }
        self.token(")")?;
        Ok(urls)
    }

    fn expression(&mut self) -> Rule<Expression> {
        self.blanks();
        match self.0 {
            [b'(', ..] => {
                self.token("(")?;
                let mut items = Vec::new();
                while !self.is_next(b')') {
                    items.push(self.expression()?);
                }
                self.token(")")?;
                Ok(Expression::List(items))
            }
            [b'"' | b'#', ..] => {
                let text = String::from_utf8(self.string()?).map_err(|error| error.to_string())?;
                Ok(Expression::String(text.into()))
            }
            _ => match self.number() {
                Some(number) => Ok(Expression::Number(number)),
                None => self.word().map(Expression::Word),
            },
        }
    }

    /// A token that begins with a plus or a point can be a word instead.
    fn number(&mut self) -> Option<Text> {
        let before = self.0;
        let text = String::from_utf8_lossy(self.until_blank_or_parenthesis());
        // What else parses as one has letters or two signs.
        let is_number = text.bytes().all(|b| b"0123456789+-.eE".contains(&b));
        if is_number && text.parse::<f64>().is_ok() {
            return Some(text.into_owned().into());
        }
        self.0 = before;
        None
    }

    fn word(&mut self) -> Rule<Text> {
        self.blanks();
        let word = self.until_blank_or_parenthesis();
        match word {
            [] | [b'#' | b'0'..=b'9' | b'-' | b'@' | b'"', ..] => self.fail("a word"),
            _ => Ok(String::from_utf8(word.to_vec()).unwrap().into()),
        }
    }

    fn string(&mut self) -> Rule<Vec<u8>> {
        self.blanks();
        if self.0.first() == Some(&b'#') {
            return self.byte_length_encoded_string();
        }
        self.token("\"")?;
        let mut text = Vec::new();
        loop {
            match self.0 {
                [b'\\', b'"', rest @ ..] => {
                    text.push(b'"');
                    self.0 = rest;
                }
                [b'"', rest @ ..] => {
                    self.0 = rest;
                    return Ok(text);
                }
                [octet, rest @ ..] => {
                    text.push(*octet);
                    self.0 = rest;
                }
                [] => return self.fail("a quote"),
            }
        }
    }

    fn byte_length_encoded_string(&mut self) -> Rule<Vec<u8>> {
        self.token("#")?;
        let digits = self.digits(|len| len > 0)?;
        self.token("\"")?;
        match self.0.split_at_checked(digits.parse().unwrap()) {
            Some((octets, rest)) => {
                self.0 = rest;
                Ok(octets.to_vec())
            }
            None => self.fail("so many octets"),
        }
    }

    fn date_time(&mut self) -> Rule<FipaTime> {
        self.blanks();
        let sign = self.0[0];
        if matches!(sign, b'+' | b'-') {
            self.0 = &self.0[1..];
        }
        let date = self.digits(|len| len == 8)?;
        self.token("T")?;
        let time = self.digits(|len| len == 9)?;
        let two = |text: &str, at: usize| text[at..at + 2].parse::<u8>().unwrap();
        let millis = time[6..].parse().unwrap();
        if matches!(sign, b'+' | b'-') {
            return Ok(FipaTime::Relative(Relative {
                negative: sign == b'-',
                years: date[..4].parse().unwrap(),
                months: two(&date, 4),
                days: two(&date, 6),
                hours: two(&time, 0),
                minutes: two(&time, 2),
                seconds: two(&time, 4),
                millis,
            }));
        }
        self.token("Z")?;
        let [month, day, hour, minute] = [&date[4..6], &date[6..], &time[..2], &time[2..4]];
        let (second, year) = (&time[4..6], &date[..4]);
        format!("{year}-{month}-{day}T{hour}:{minute}:{second}.{millis:03}Z")
            .parse()
            .map_err(|_| format!("{date} is no date"))
    }

    fn digits(&mut self, fits: fn(usize) -> bool) -> Rule<String> {
        let len = self.0.iter().take_while(|b| b.is_ascii_digit()).count();
        if !fits(len) {
            return self.fail("digits");
        }
        let (digits, rest) = self.0.split_at(len);
        self.0 = rest;
        Ok(String::from_utf8(digits.to_vec()).unwrap())
    }

    fn keyword(&mut self, keyword: &str) -> Rule<()> {
        match self.word()? {
            word if word == *keyword => Ok(()),
            _ => self.fail(keyword),
        }
    }

    fn token(&mut self, token: &str) -> Rule<()> {
        self.blanks();
        match self.0.strip_prefix(token.as_bytes()) {
            Some(rest) => {
                self.0 = rest;
                Ok(())
            }
            None => self.fail(token),
        }
    }

    fn is_next(&mut self, octet: u8) -> bool {
        self.blanks();
        self.0.first() == Some(&octet)
    }

    fn until_blank_or_parenthesis(&mut self) -> &'a [u8] {
        let ends = |octet: &u8| matches!(octet, 0..=0x20 | b'(' | b')');
        let len = self.0.iter().position(ends).unwrap_or(self.0.len());
        let (token, rest) = self.0.split_at(len);
        self.0 = rest;
        token
    }

    fn blanks(&mut self) {
        while let [b' ' | b'\t' | b'\r' | b'\n', rest @ ..] = self.0 {
            self.0 = rest;
        }
    }

    fn fail<T>(&self, expected: &str) -> Rule<T> {
        let here = String::from_utf8_lossy(self.0);
        Err(format!("{expected} is missing in front of {here:.80}"))
    }
}

#[test]
fn the_plain_reader_knows_the_grammar() {
    let text = b"(request :sender (agent-identifier :name i@p :addresses (sequence http://p/acc))
        :content \"say \\\"hi\\\"\" :reply-by 20260102T030405678Z :X-trace (a 42 #3\"a b))";
    let message = Plain(text).message().unwrap();
    let list = Expression::List(vec!["a".into(), "42".into(), "a b".into()]);
    let expected = Message::new(Performative::Request)
        .from_agent(AgentId::new("i@p").address("http://p/acc"))
        .content("say \"hi\"")
        .reply_by("2026-01-02T03:04:05.678Z".parse::<FipaTime>().unwrap())
        .user_defined("trace", list);
    assert_eq!(message, expected);
    assert!(Plain(b"(inform :foo bar)").message().is_err());
    assert!(Plain(b"(inform :language 1a)").message().is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn what_is_written_follows_the_grammar(message in messages()) {
        let octets = octets_of(&message);
        prop_assert_eq!(Plain(&octets).message(), Ok(message));
    }
}
