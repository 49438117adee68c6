//! The directory of a message transport service as its AMS and DF see it.

use std::ops::ControlFlow;

use fipa_acl::{AgentId, Text};
use fipa_directory::{Address, Entry, Location, Now, Record, Source};
use fipa_management::{ApService, DirectoryChange, DirectoryView, KnownAgent, Reason};
use fipa_mts::{Machine, Mts};

use super::{HTTP, services, urls};

/// The service type of the AMS and the DF themselves.
const MANAGEMENT: &str = "fipa-management";

/// The view of somebody who asks.
pub(super) struct View<'a> {
    pub(super) now: Now,
    pub(super) mts: &'a mut Mts,
    /// The names of the AMS and the DF.
    pub(super) own: &'a [Text; 2],
    /// Whether addresses of loopback are of use to the one who asks.
    pub(super) same_host: bool,
}

impl View<'_> {
    fn known<'r>(&self, record: &'r Record) -> KnownAgent<'r> {
        let name = &record.entry.name;
        let registered = self.mts.lister_of(name) == Some(&self.mts.service_name());
        KnownAgent {
            name,
            kind: &record.entry.kind,
            local: record.source == Source::Local || registered,
        }
    }

    fn own(&self) -> impl Iterator<Item = KnownAgent<'_>> {
        self.own.iter().map(|name| KnownAgent {
            name,
            kind: MANAGEMENT,
            local: true,
        })
    }

    fn list(&mut self, agent: &AgentId) -> Result<(), Reason> {
        if agent.addresses.is_empty() {
            let missing = "an agent that is not attached here needs an address";
            return Err(Reason::InternalError(Text::from_static(missing)));
        }
        let platform = self.mts.service_name();
        let entry = Entry {
            timestamp: self.now.unix_millis,
            ..entry(agent, "Registered with the AMS")
        };
        self.mts.agent_listed(self.now, &platform, entry);
        match self.mts.lister_of(&agent.name) == Some(&platform) {
            true => Ok(()),
            false => Err(Reason::AlreadyRegistered),
        }
    }
}

/// What the directory holds of an agent that an AMS lists.
pub(super) fn entry(agent: &AgentId, description: &str) -> Entry {
    let location = |address: &Text| Location {
        address: address.clone(),
        signature: HTTP,
    };
    Entry {
        locations: agent.addresses.iter().map(location).collect(),
        description: Text::from(description),
        ..Entry::new(&agent.name)
    }
}

impl DirectoryView for View<'_> {
    fn platform(&self) -> Text {
        self.mts.service_name()
    }

    fn services(&self) -> Vec<ApService> {
        services(urls(self.mts, self.same_host))
    }

    fn find(&self, name: &str) -> Option<KnownAgent<'_>> {
        if let Some(own) = self.own().find(|own| own.name == name) {
            return Some(own);
        }
        let record = self.mts.directory().find(name)?;
        Some(self.known(record))
    }

    fn visit(&self, visitor: &mut dyn FnMut(KnownAgent<'_>) -> ControlFlow<()>) {
        let directory = self.mts.directory();
        // Of several records of one name the one is shown that letters go by.
        let is_first = |record: &&Record| {
            let first = directory.find(&record.entry.name);
            first.is_some_and(|first| std::ptr::eq(first, *record))
        };
        let records = directory.iter().filter(is_first);
        let mut agents = self.own().chain(records.map(|record| self.known(record)));
        // Whoever stops looking has seen what it wanted.
        let _ = agents.try_for_each(visitor);
    }

    /// Its own URLs, or ours: what is posted there for an agent of our network is passed on.
    fn addresses(&self, name: &str) -> Vec<Text> {
        let record = self.mts.directory().find(name);
        let locations = record
            .into_iter()
            .flat_map(|record| &record.entry.locations);
        let addresses = locations.map(|location| &location.address);
        let is_url = |address: &&Text| address.parse().is_ok_and(|a: Address| a.is_http());
        let urls: Vec<Text> = addresses.filter(is_url).cloned().collect();
        match urls.is_empty() {
            true => super::urls(self.mts, self.same_host),
            false => urls,
        }
    }

    fn change(&mut self, change: DirectoryChange) -> Result<(), Reason> {
        match change {
            DirectoryChange::Register(agent) | DirectoryChange::Modify(agent) => self.list(&agent),
            DirectoryChange::Deregister(name) if self.mts.lister_of(&name).is_some() => {
                self.mts.agent_unlisted(self.now, &name);
                Ok(())
            }
            DirectoryChange::Deregister(_) => {
                let attached = "an attached agent is deregistered by whoever attached it";
                Err(Reason::InternalError(Text::from_static(attached)))
            }
        }
    }
}
