//! Our agents in the directory of C++ robots: which are announced there, and which are told of as
//! left out.

use std::collections::HashSet;
use std::sync::Arc;

use fipa_acl::Text;
use fipa_directory::{Change, ChangeKind, Entry, Source};
use fipa_dsd::{LeftOut, Mdns};
use fipa_mts::{Machine, Mts};

use crate::node::Node;

/// What was told of agents that are left out, so that each is told of once.
#[derive(Debug, Default)]
pub(crate) struct Announcing {
    told: HashSet<Text>,
    /// Whether it was told that there are more agents than are announced.
    told_limit: bool,
}

impl Announcing {
    /// Announces all agents that are registered here; mDNS knows none of them yet.
    pub(crate) fn begin(&mut self, node: &Arc<Node<Mts>>, mdns: &mut Mdns) {
        let entries: Vec<Entry> = node.with(|_, mts, _| {
            let own = mts.directory().owned_by(mts.config().instance);
            own.map(|record| record.entry.clone()).collect()
        });
        for entry in entries {
            self.put(node, mdns, entry);
        }
    }

    /// Follows the directory.
    pub(crate) fn follow(&mut self, node: &Arc<Node<Mts>>, mdns: &mut Mdns, change: Change) {
        let record = change.record;
        if record.source != Source::Local {
            return;
        }
        match change.kind {
            ChangeKind::Added | ChangeKind::Changed => self.put(node, mdns, record.entry),
            ChangeKind::Removed => {
                let name = &record.entry.name;
                self.told.remove(name);
                mdns.withdraw_agent(name);
            }
            ChangeKind::Conflict => {}
        }
    }

    fn put(&mut self, node: &Arc<Node<Mts>>, mdns: &mut Mdns, entry: Entry) {
        let name = entry.name.clone();
        let left_out = mdns.announce_agent(entry);
        let news = match &left_out {
            Ok(()) => {
                if self.told.remove(&name) {
                    node.with(|_, mts, _| mts.is_announced(&name));
                }
                return;
            }
            // mDNS has told that the scope keeps everybody from C++ robots.
            Err(LeftOut::Scope) => false,
            // Whoever asked for none knows.
            Err(LeftOut::Limit(0)) => false,
            Err(LeftOut::Limit(_)) if self.told_limit => false,
            Err(LeftOut::Limit(_)) => {
                self.told_limit = true;
                self.told.insert(name.clone())
            }
            Err(_) => self.told.insert(name.clone()),
        };
        if let (Err(left_out), true) = (left_out, news) {
            let reason = Text::from(left_out.to_string());
            node.with(|_, mts, _| mts.not_announced(name, reason));
        }
    }
}
