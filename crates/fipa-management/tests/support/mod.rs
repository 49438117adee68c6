//! Recordings, and a directory as a host keeps it.
#![allow(dead_code, reason = "not every test needs all of it")]

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;

use bytes::Bytes;
use fipa_acl::{AgentId, Message, Text};
use fipa_management::{
    ApService, Df, DfOutput, DirectoryChange, DirectoryView, KnownAgent, Reason,
};
use fipa_sl::{Arguments, Content, Functional, Limits, Term};

/// The message in a recording of JADE: the payload itself, or the part of a request over HTTP.
pub(crate) fn recorded(file: &str) -> Message {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/vectors/jade");
    let octets = std::fs::read(Path::new(folder).join(file)).unwrap();
    let octets = Bytes::from(octets);
    let limits = fipa_codec::Limits::default();
    let starts = octets.windows(5).enumerate();
    let starts = starts.filter(|(_, window)| window == b"\r\n\r\n(");
    let mut starts = std::iter::once(0).chain(starts.map(|(at, _)| at + 4));
    let found = starts.find_map(|at| {
        let read = fipa_codec::string::decode_message_prefix(&octets.slice(at..), &limits);
        read.ok().map(|(message, _)| message)
    });
    found.unwrap_or_else(|| panic!("no message in {file}"))
}

/// A content whose parameters stand in the order of their names: nobody minds another.
pub(crate) fn sorted(message: &Message) -> Vec<Term> {
    let octets = message.content.clone().unwrap();
    let content = Content::parse(&octets, &Limits::default()).unwrap();
    content.expressions().map(sorted_term).collect()
}

fn sorted_term(term: &Term) -> Term {
    let Term::Functional(functional) = term else {
        return term.clone();
    };
    let arguments = match &functional.arguments {
        Arguments::Positional(terms) => {
            Arguments::Positional(terms.iter().map(sorted_term).collect())
        }
        Arguments::Named(parameters) => {
            let parameters = parameters.iter();
            let mut parameters: Vec<_> = parameters
                .map(|(name, value)| (name.clone(), sorted_term(value)))
                .collect();
            parameters.sort_by(|(a, _), (b, _)| a.cmp(b));
            Arguments::Named(parameters)
        }
    };
    let symbol = functional.symbol.clone();
    Functional { symbol, arguments }.into()
}

/// All that a DF wants sent.
pub(crate) fn sent(df: &mut Df) -> Vec<Message> {
    std::iter::from_fn(|| df.poll_output())
        .filter_map(|output| match output {
            DfOutput::Send(message) => Some(*message),
            DfOutput::Federation { .. } => None,
        })
        .collect()
}

/// The only message that a DF wants sent.
pub(crate) fn only(df: &mut Df) -> Message {
    let [message] = <[Message; 1]>::try_from(sent(df)).unwrap();
    message
}

/// A directory of agents, as a host keeps it.
#[derive(Debug, Default)]
pub(crate) struct Town {
    pub(crate) name: String,
    pub(crate) address: String,
    pub(crate) service: String,
    /// The agents with their type, and whether they are local.
    pub(crate) agents: BTreeMap<String, (String, bool)>,
    /// The addresses of those that have some of their own.
    pub(crate) addresses: BTreeMap<String, Vec<Text>>,
}

impl Town {
    pub(crate) fn new(name: &str, address: &str) -> Town {
        Town {
            name: name.to_owned(),
            address: address.to_owned(),
            service: "fipa.mts.mtp.http.std".to_owned(),
            ..Town::default()
        }
    }

    pub(crate) fn with(mut self, agent: &str, kind: &str, local: bool) -> Town {
        self.agents
            .insert(agent.to_owned(), (kind.to_owned(), local));
        self
    }

    fn put(&mut self, agent: AgentId) {
        let name = agent.name.to_string();
        self.agents.insert(name.clone(), ("agent".to_owned(), true));
        self.addresses.insert(name, agent.addresses);
    }
}

impl DirectoryView for Town {
    fn platform(&self) -> Text {
        Text::from(&self.name)
    }

    fn services(&self) -> Vec<ApService> {
        vec![ApService {
            name: Text::from(&self.service),
            kind: Text::from_static("fipa.mts.mtp.http.std"),
            addresses: vec![Text::from(&self.address)],
        }]
    }

    fn find(&self, name: &str) -> Option<KnownAgent<'_>> {
        let (name, (kind, local)) = self.agents.get_key_value(name)?;
        let local = *local;
        Some(KnownAgent { name, kind, local })
    }

    fn visit(&self, visitor: &mut dyn FnMut(KnownAgent<'_>) -> ControlFlow<()>) {
        let mut names = self.agents.keys();
        let _ = names.try_for_each(|name| {
            self.find(name)
                .map_or(ControlFlow::Continue(()), &mut *visitor)
        });
    }

    fn addresses(&self, name: &str) -> Vec<Text> {
        match self.addresses.get(name) {
            Some(addresses) => addresses.clone(),
            None => vec![Text::from(&self.address)],
        }
    }

    fn change(&mut self, change: DirectoryChange) -> Result<(), Reason> {
        match change {
            DirectoryChange::Register(agent) | DirectoryChange::Modify(agent) => self.put(agent),
            DirectoryChange::Deregister(name) => {
                self.agents.remove(&*name).ok_or(Reason::NotRegistered)?;
            }
        }
        Ok(())
    }
}
