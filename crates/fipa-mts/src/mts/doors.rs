//! How many connections others may have open with us: in total, and from one address.

use std::collections::{BTreeMap, HashMap};

use fipa_acl::Text;

use super::Mts;
use crate::machine::{ConnId, Connected, Notice, Output};

/// Connections that others have opened, by where they are.
#[derive(Debug, Default)]
pub(super) struct Doors {
    addresses: BTreeMap<ConnId, Text>,
    counts: HashMap<Text, usize>,
}

impl Doors {
    fn enter(&mut self, conn: ConnId, address: Text) {
        *self.counts.entry(address.clone()).or_default() += 1;
        self.addresses.insert(conn, address);
    }

    pub(super) fn leave(&mut self, conn: ConnId) {
        if let Some(address) = self.addresses.remove(&conn)
            && let Some(count) = self.counts.get_mut(&address)
        {
            *count -= 1;
            if *count == 0 {
                self.counts.remove(&address);
            }
        }
    }

    fn from(&self, address: &Text) -> usize {
        self.counts.get(address).copied().unwrap_or_default()
    }
}

impl Mts {
    /// Whether a connection that somebody has opened may stay; otherwise it is closed. Where too
    /// many are open, one of whom nobody knows what it wants goes for it, of the same address if
    /// that one has too many.
    pub(super) fn let_in(&mut self, connected: &Connected) -> bool {
        let address = host_of(&connected.remote);
        let crowded = self.doors.from(&address) >= self.config.max_connections_an_address;
        let full = self.doors.addresses.len() >= self.config.max_connections;
        if crowded || full {
            let from = crowded.then_some(&address);
            let Some(quietest) = self.quietest_caller(from) else {
                self.outputs.push_back(Output::Close(connected.conn));
                self.notice(Notice::LinkFailed {
                    with: connected.remote.clone(),
                    reason: Text::from_static(TOO_MANY),
                });
                return false;
            };
            self.give_caller_up(quietest, TOO_MANY);
        }
        self.doors.enter(connected.conn, address);
        true
    }
}

const TOO_MANY: &str = "too many connections are open";

/// An address without its port.
pub(super) fn host_of(remote: &Text) -> Text {
    let host = remote.rsplit_once(':').map(|(host, _)| host);
    match host {
        Some(host) if !host.ends_with('/') && host.contains("//") => Text::from(host),
        _ => remote.detached(),
    }
}
