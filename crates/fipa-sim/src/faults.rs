//! What goes wrong.

use std::time::Duration;

use fipa_directory::InstanceId;

use crate::events::Event;
use crate::net::{EndState, Item, Network};
use crate::node::{NodeId, Running};
use crate::sim::Sim;

impl Sim {
    /// Sets what streams that are opened from now on are like.
    pub fn set_network(&mut self, network: Network) {
        self.network = network;
    }

    /// Sets what streams between the hosts of two nodes are like that are opened from now on.
    pub fn set_network_between(&mut self, one: NodeId, two: NodeId, network: Network) {
        let hosts = self.hosts(one, two);
        self.networks.insert(hosts, network);
    }

    /// Ends a process without a word. Its host lives: its streams end, and who dials it is
    /// refused.
    pub fn crash(&mut self, node: NodeId) {
        self.end_run(node, true);
    }

    /// Takes the power from a host: nobody is told that its streams have ended. A process that is
    /// started there later says so to whoever still writes.
    pub fn power_off(&mut self, node: NodeId) {
        self.end_run(node, false);
    }

    fn end_run(&mut self, node: NodeId, told: bool) {
        let conns = std::mem::take(&mut self.nodes[node.0].conns);
        for (stream, side) in conns.into_values() {
            self.end_side(stream, side, told.then_some(Item::Reset));
        }
        let unanswered = self.unanswered(node);
        self.open_tickets = self.open_tickets.saturating_sub(unanswered);
        let ended = &mut self.nodes[node.0];
        ended.running = Running::Nothing;
        ended.run += 1;
        ended.frozen = false;
        ended.held.clear();
        ended.wake = None;
        ended.closing = false;
    }

    /// Ends a process as it should: it says goodbye, and is gone when its connections are.
    pub fn shutdown(&mut self, node: NodeId) {
        self.nodes[node.0].closing = true;
        self.with(node, |machine, now| machine.shutdown(now));
        self.end_if_closed(node);
    }

    pub(crate) fn end_if_closed(&mut self, node: NodeId) {
        let ended = &self.nodes[node.0];
        if ended.closing && ended.conns.is_empty() {
            self.end_run(node, false);
        }
    }

    /// Stops a process, as the signal does: its streams stay, nothing comes out of it.
    pub fn freeze(&mut self, node: NodeId) {
        self.nodes[node.0].frozen = true;
    }

    /// Lets a frozen process go on: with what has come meanwhile, and with its timers.
    pub fn thaw(&mut self, node: NodeId) {
        let thawed = &mut self.nodes[node.0];
        if !std::mem::take(&mut thawed.frozen) {
            return;
        }
        let held = std::mem::take(&mut thawed.held);
        let conns: Vec<(u64, usize)> = thawed.conns.values().copied().collect();
        thawed.wake = None;
        held.into_iter()
            .for_each(|event| self.put(Duration::ZERO, event));
        for (stream, side) in conns {
            self.put(Duration::ZERO, Event::Arrive { stream, side });
        }
        self.settle(node);
    }

    /// Cuts the way between the hosts of two nodes: octets wait, streams do not end.
    pub fn cut(&mut self, one: NodeId, two: NodeId) {
        let hosts = self.hosts(one, two);
        self.cuts.insert(hosts);
    }

    /// Cuts a host off from all others.
    pub fn isolate(&mut self, node: NodeId) {
        let host = self.nodes[node.0].host;
        self.isolated.insert(host);
    }

    /// Mends every cut of a node's host. What waited arrives.
    pub fn mend(&mut self, node: NodeId) {
        let host = self.nodes[node.0].host;
        self.isolated.remove(&host);
        self.cuts.retain(|(one, two)| *one != host && *two != host);
        let ends: Vec<(u64, usize)> = self.ends_of_host(host);
        let latency = self.network.latency;
        for (stream, side) in ends {
            self.put(latency, Event::Arrive { stream, side });
        }
    }

    /// Both ends of every stream that a host has with others.
    fn ends_of_host(&self, host: NodeId) -> Vec<(u64, usize)> {
        let touches = |node: NodeId| self.nodes[node.0].host == host;
        self.streams
            .iter()
            .filter(|(_, stream)| stream.ends.iter().any(|end| touches(end.node)))
            .flat_map(|(id, _)| [(*id, 0), (*id, 1)])
            .collect()
    }

    /// Breaks the streams between two nodes; both learn of it, what is under way is lost.
    pub fn reset(&mut self, one: NodeId, two: NodeId) {
        for (stream, side) in self.streams_between(one, two) {
            let other = self.streams.get(&stream).map(|s| s.ends[1 - side].state);
            self.end_loudly(stream, side);
            if other.is_some() {
                self.end_loudly(stream, 1 - side);
            }
        }
    }

    /// Ends the streams between two nodes at the first one; the second learns of it only when it
    /// writes.
    pub fn lose(&mut self, one: NodeId, two: NodeId) {
        for (stream, side) in self.streams_between(one, two) {
            self.end_loudly(stream, side);
        }
    }

    /// Turns over a bit of what arrives next on the streams between two nodes, in each direction.
    pub fn corrupt(&mut self, one: NodeId, two: NodeId) {
        for (stream, _) in self.streams_between(one, two) {
            if let Some(open) = self.streams.get_mut(&stream) {
                open.ends.iter_mut().for_each(|end| end.corrupt = true);
            }
        }
    }

    /// Ends one end of a stream, and tells the machine there.
    fn end_loudly(&mut self, stream: u64, side: usize) {
        let Some(open) = self.streams.get(&stream) else {
            return;
        };
        let node = open.ends[side].node;
        match open.ends[side].state {
            EndState::Open(conn) => {
                let all_written = open.ends[side].all_written;
                self.end_side(stream, side, None);
                self.closed_here(node, conn, false, all_written);
            }
            // It ends as soon as it is there.
            EndState::Connecting => self.answer_reset(stream, side),
            EndState::Ended => {}
        }
    }

    /// How many streams there are between two nodes.
    pub fn streams(&self, one: NodeId, two: NodeId) -> usize {
        self.streams_between(one, two).len()
    }

    /// The streams between two nodes, with the end at the first one.
    fn streams_between(&self, one: NodeId, two: NodeId) -> Vec<(u64, usize)> {
        let ends = self.nodes[one.0].conns.values().copied();
        ends.filter(|(stream, side)| {
            let open = self.streams.get(stream);
            open.is_some_and(|open| open.ends[1 - side].node == two)
        })
        .collect()
    }

    /// Whether a platform would answer if a node asked the network for it.
    pub(crate) fn answers(&self, asking: NodeId, instance: InstanceId) -> bool {
        self.nodes.iter().enumerate().any(|(at, node)| {
            let here = match &node.running {
                Running::Daemon(mts) => mts.config().instance == instance,
                _ => false,
            };
            here && !node.frozen && !node.closing && !self.is_cut(asking, NodeId(at))
        })
    }
}
