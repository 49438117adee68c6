//! Dials: an address after the other, refused at once or without an answer after a while.

use std::time::Duration;

use fipa_directory::Address;
use fipa_mts::DialId;

use crate::events::{Dialling, Event};
use crate::net::{Network, Stream};
use crate::node::{NodeId, Running};
use crate::sim::Sim;

/// How long a host that is cut off is dialled.
const NO_ANSWER: Duration = Duration::from_secs(3);

/// How long octets travel between processes of one host.
const ON_HOST: Duration = Duration::from_micros(50);

impl Sim {
    /// What the network between two nodes is like.
    pub(crate) fn network_between(&self, one: NodeId, two: NodeId) -> Network {
        let (one, two) = self.hosts(one, two);
        if one == two {
            // A Unix socket.
            return Network {
                latency: ON_HOST,
                split: self.network.split,
                ..Network::default()
            };
        }
        let own = self.networks.get(&(one, two));
        own.unwrap_or(&self.network).clone()
    }

    /// The hosts of two nodes, the smaller one first.
    pub(crate) fn hosts(&self, one: NodeId, two: NodeId) -> (NodeId, NodeId) {
        let (one, two) = (self.nodes[one.0].host, self.nodes[two.0].host);
        (one.min(two), one.max(two))
    }

    /// Whether nothing gets from one node to the other.
    pub(crate) fn is_cut(&self, one: NodeId, two: NodeId) -> bool {
        let (one, two) = self.hosts(one, two);
        one != two
            && (self.cuts.contains(&(one, two))
                || self.isolated.contains(&one)
                || self.isolated.contains(&two))
    }

    pub(crate) fn dial(&mut self, node: NodeId, dial: DialId, addresses: Vec<Address>) {
        let at = self.now.mono;
        let dialling = &mut self.nodes[node.0];
        dialling.collected.dials.push((at, addresses.clone()));
        let dialling = Dialling {
            node,
            run: dialling.run,
            dial,
            addresses,
            next: 0,
        };
        self.put(ON_HOST, Event::Dial(dialling));
    }

    pub(crate) fn dial_next(&mut self, mut dialling: Dialling) {
        let Dialling {
            node, run, dial, ..
        } = dialling;
        if !self.runs(node, run) {
            return;
        }
        let Some(address) = dialling.addresses.get(dialling.next).cloned() else {
            return;
        };
        let found = self.addresses.get(&address).copied();
        // A Unix socket is there on its own host only.
        let found = found.filter(|(there, _)| {
            let local = self.nodes[there.0].host == self.nodes[node.0].host;
            local || !matches!(address, Address::Unix(_))
        });
        let (pause, reason) = match found {
            Some((there, _)) if self.is_cut(node, there) => (NO_ANSWER, "no answer"),
            Some((there, control)) if self.listens(there) => {
                self.connect(node, there, (dial, address), control);
                return;
            }
            _ => (Duration::ZERO, "connection refused"),
        };
        dialling.next += 1;
        if dialling.next < dialling.addresses.len() {
            self.put(pause, Event::Dial(dialling));
        } else {
            let reason = format!("{address}: {reason}");
            let event = Event::DialFailed {
                node,
                run,
                dial,
                reason,
            };
            self.put(pause, event);
        }
    }

    fn listens(&self, node: NodeId) -> bool {
        let node = &self.nodes[node.0];
        matches!(node.running, Running::Daemon(_) | Running::Robot(_)) && !node.closing
    }

    fn connect(&mut self, node: NodeId, there: NodeId, dialled: (DialId, Address), control: bool) {
        let network = self.network_between(node, there);
        self.next_stream += 1;
        let stream = self.next_stream;
        let ends = [
            (node, self.nodes[node.0].run),
            (there, self.nodes[there.0].run),
        ];
        let seed = self.seed ^ stream.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let latency = network.latency;
        self.streams
            .insert(stream, Stream::new(network, ends, seed));
        let opened = |side, dialled| Event::Opened {
            stream,
            side,
            dialled,
            control: control && side == 1,
        };
        self.put(latency, opened(1, None));
        self.put(latency * 2, opened(0, Some(dialled)));
    }
}
