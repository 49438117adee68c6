//! Nodes: made, restarted, discovered.

use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Address, Directory, InstanceId};
use fipa_mts::{Config, Machine, Mts, Program, ProgramConfig};

use crate::node::{Collected, Node, NodeId, Recipe, Running};
use crate::sim::Sim;

/// What mDNS tells of a daemon.
#[derive(Clone)]
struct Announcement {
    of: NodeId,
    instance: InstanceId,
    name: Text,
    addresses: Vec<Address>,
}

impl Sim {
    /// A daemon with the usual settings on a host of its own.
    pub fn daemon(&mut self, name: &str) -> NodeId {
        self.daemon_with(name, |_| ())
    }

    /// A daemon on a host of its own. It listens at its endpoints - `tcp://NAME:4100` unless they
    /// are set - and at a control socket.
    pub fn daemon_with(&mut self, name: &str, set: impl FnOnce(&mut Config)) -> NodeId {
        let node = NodeId(self.nodes.len());
        let mut config = Config::new(self.instance(), name);
        config.endpoints = vec![Address::tcp(name, 4100)];
        set(&mut config);
        let mut listening = vec![(control_socket(node), true)];
        listening.extend(config.endpoints.iter().map(|at| (at.clone(), false)));
        for (address, control) in &listening {
            self.addresses.insert(address.clone(), (node, *control));
        }
        let recipe = Recipe::Daemon(Box::new(config));
        self.nodes.push(Node::new(recipe, node, listening));
        self.start(node);
        node
    }

    /// A program on the host of a daemon, with the usual settings.
    pub fn program(&mut self, name: &str, daemon: NodeId) -> NodeId {
        self.program_with(name, daemon, |_| ())
    }

    /// A program on the host of a daemon.
    pub fn program_with(
        &mut self,
        name: &str,
        daemon: NodeId,
        set: impl FnOnce(&mut ProgramConfig),
    ) -> NodeId {
        let node = NodeId(self.nodes.len());
        let control = control_socket(self.nodes[daemon.0].host);
        let mut config = ProgramConfig::new(self.instance(), name, control);
        set(&mut config);
        let recipe = Recipe::Program(Box::new(config));
        let host = self.nodes[daemon.0].host;
        self.nodes.push(Node::new(recipe, host, Vec::new()));
        self.start(node);
        node
    }

    /// Starts a node anew that crashed or was shut down: with another instance id, the same name
    /// and addresses, and the peers that it was given. Its agents are gone.
    pub fn restart(&mut self, node: NodeId) {
        if self.is_up(node) {
            self.crash(node);
        }
        let instance = self.instance();
        match &mut self.nodes[node.0].recipe {
            Recipe::Daemon(config) => config.instance = instance,
            Recipe::Program(config) => config.instance = instance,
            Recipe::Robot => {}
        }
        self.start(node);
    }

    pub(crate) fn start(&mut self, node: NodeId) {
        let now = self.now;
        let stored = self.read_disk(node);
        let starting = &mut self.nodes[node.0];
        starting.run += 1;
        starting.running = match starting.recipe.clone() {
            Recipe::Daemon(config) => {
                let mut mts = Mts::new(*config);
                mts.restore(now, stored);
                for peer in &starting.peers {
                    mts.add_peer(now, peer.clone());
                }
                Running::Daemon(Box::new(mts))
            }
            Recipe::Program(config) => Running::Program(Box::new(Program::new(*config, now))),
            Recipe::Robot => Running::Robot(Box::default()),
        };
        self.settle(node);
    }

    fn instance(&mut self) -> InstanceId {
        let mut octets = [0; 16];
        self.random.fill(&mut octets);
        InstanceId::from_bytes(octets)
    }

    /// Whether a process runs there.
    pub fn is_up(&self, node: NodeId) -> bool {
        self.nodes[node.0].machine().is_some()
    }

    /// Where a daemon is reached first.
    pub fn address(&self, node: NodeId) -> Address {
        let mut listening = self.nodes[node.0].listening.iter();
        let found = listening.find(|(_, control)| !control);
        found
            .map(|(address, _)| address.clone())
            .expect("a daemon that listens")
    }

    /// Gives a daemon the address of a peer.
    pub fn add_peer(&mut self, node: NodeId, peer: Address) {
        self.nodes[node.0].peers.push(peer.clone());
        let now = self.now;
        if let Running::Daemon(mts) = &mut self.nodes[node.0].running {
            mts.add_peer(now, peer);
        }
        self.settle(node);
    }

    /// Tells a daemon where it is reached from now on, and lets it listen there.
    pub fn set_endpoints(&mut self, node: NodeId, endpoints: Vec<Address>) {
        let moved = &mut self.nodes[node.0];
        self.addresses
            .retain(|_, (there, control)| *there != node || *control);
        moved.listening.retain(|(_, control)| *control);
        for address in &endpoints {
            moved.listening.push((address.clone(), false));
            self.addresses.insert(address.clone(), (node, false));
        }
        let now = self.now;
        if let Running::Daemon(mts) = &mut moved.running {
            mts.set_endpoints(now, endpoints);
        }
        self.settle(node);
    }

    /// mDNS: every daemon finds every other that it can reach.
    pub fn discover_all(&mut self) {
        for node in 0..self.nodes.len() {
            self.discover(NodeId(node));
        }
    }

    /// mDNS: every daemon that is there finds this one, if it is there.
    pub fn discover(&mut self, found: NodeId) {
        let Some(announcement) = self.announcement(found) else {
            return;
        };
        for node in (0..self.nodes.len()).map(NodeId) {
            self.hear(node, &announcement);
        }
    }

    /// mDNS on a bad network: what every daemon says goes to every other as a packet of its own, of
    /// which one in four is lost and one in eight comes twice. They take up to a second, so that
    /// they overtake each other and arrive after the end of who sent them.
    pub fn discover_badly(&mut self) {
        for found in (0..self.nodes.len()).map(NodeId) {
            let Some(announcement) = self.announcement(found) else {
                continue;
            };
            for node in (0..self.nodes.len()).map(NodeId) {
                let copies = match self.random.u8(0..8) {
                    0 | 1 => 0,
                    2 => 2,
                    _ => 1,
                };
                for _ in 0..copies {
                    let delay = Duration::from_millis(self.random.u64(0..1000));
                    let announcement = announcement.clone();
                    self.after(delay, move |sim| sim.hear(node, &announcement));
                }
            }
        }
    }

    /// What mDNS tells of a node, if a daemon runs there.
    fn announcement(&self, of: NodeId) -> Option<Announcement> {
        let Running::Daemon(mts) = &self.nodes[of.0].running else {
            return None;
        };
        let config = mts.config();
        Some(Announcement {
            of,
            instance: config.instance,
            name: config.name.clone(),
            addresses: config.endpoints.clone(),
        })
    }

    fn hear(&mut self, node: NodeId, said: &Announcement) {
        if node == said.of || self.nodes[node.0].frozen || self.is_cut(node, said.of) {
            return;
        }
        let now = self.now;
        if let Running::Daemon(mts) = &mut self.nodes[node.0].running {
            let (name, addresses) = (said.name.clone(), said.addresses.clone());
            mts.discovered(now, said.instance, name, addresses);
            self.settle(node);
        }
    }

    /// The daemon that runs on a node.
    ///
    /// # Panics
    ///
    /// When none does.
    pub fn mts(&self, node: NodeId) -> &Mts {
        match &self.nodes[node.0].running {
            Running::Daemon(mts) => mts,
            _ => panic!("no daemon runs at {node:?}"),
        }
    }

    /// The id of the daemon that runs on a node.
    pub fn instance_of(&self, node: NodeId) -> InstanceId {
        self.mts(node).config().instance
    }

    /// The directory of a node.
    ///
    /// # Panics
    ///
    /// When nothing runs there.
    pub fn directory(&self, node: NodeId) -> &Directory {
        let machine = self.nodes[node.0].machine();
        machine.map(Machine::directory).expect("a node that runs")
    }

    /// The names in the directory of a node, sorted; one that several hold is there as often.
    pub fn names(&self, node: NodeId) -> Vec<Text> {
        let records = self.directory(node).iter();
        let mut names: Vec<Text> = records.map(|record| record.entry.name.clone()).collect();
        names.sort();
        names
    }

    /// What a node has told.
    pub fn collected(&self, node: NodeId) -> &Collected {
        &self.nodes[node.0].collected
    }

    /// Forgets what a node has told of notices, changes and dials.
    pub fn forget(&mut self, node: NodeId) {
        let collected = &mut self.nodes[node.0].collected;
        collected.notices.clear();
        collected.changes.clear();
        collected.dials.clear();
    }
}

fn control_socket(host: NodeId) -> Address {
    Address::Unix(format!("/run/fipa-{}.sock", host.0))
}
