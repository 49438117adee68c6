//! Robots of another make: a letter a connection, the end of the stream ends it, nothing is ever
//! answered.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Letter, Text};
use fipa_directory::{Address, Directory, Entry, Now};
use fipa_mts::{
    ConnId, Connected, DialId, Ended, Machine, Mts, Output, RegisterError, Registration, Submission,
};

use crate::node::{Node, NodeId, Recipe, Running};
use crate::sim::Sim;

/// Octets that a robot's system takes for it while it reads nothing.
pub(crate) const WINDOW: usize = 64 << 10;

/// What a robot of another make does with what is written to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Habit {
    /// It reads to the end of the stream.
    #[default]
    Reads,
    /// It accepts connections and reads nothing: its system takes 64 KiB of each.
    Stalls,
    /// It breaks a connection off once so many octets have come.
    Breaks(usize),
}

/// What a robot does once it has written something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Then {
    /// It ends the stream, as it should.
    Ends,
    /// It does nothing more.
    Stalls,
    /// It breaks the connection off.
    Breaks,
}

/// A robot of another make.
#[derive(Debug, Default)]
pub(crate) struct Robot {
    pub(crate) habit: Habit,
    reading: BTreeMap<ConnId, BytesMut>,
    letters: BTreeMap<ConnId, Bytes>,
    accepted: usize,
    /// What is to be written once a dial has led somewhere.
    dials: BTreeMap<DialId, (Bytes, Then)>,
    writing: BTreeMap<ConnId, VecDeque<Bytes>>,
    outputs: VecDeque<Output>,
    directory: Directory,
    next_dial: u64,
}

impl Machine for Robot {
    fn connected(&mut self, _now: Now, connected: Connected) {
        let conn = connected.conn;
        let written = connected.dialled.and_then(|(d, _)| self.dials.remove(&d));
        let Some((octets, then)) = written else {
            self.accepted += 1;
            self.reading.insert(conn, BytesMut::new());
            return;
        };
        self.writing.insert(conn, VecDeque::from([octets]));
        self.outputs.push_back(Output::Transmit(conn));
        match then {
            Then::Ends => self.outputs.push_back(Output::Finish(conn)),
            Then::Breaks => self.outputs.push_back(Output::Abort(conn)),
            Then::Stalls => {}
        }
    }

    fn dial_failed(&mut self, _now: Now, dial: DialId, _reason: &str) {
        self.dials.remove(&dial);
    }

    fn received(&mut self, _now: Now, conn: ConnId, octets: &mut BytesMut) {
        let come = octets.split();
        if let Some(letter) = self.reading.get_mut(&conn) {
            letter.unsplit(come);
            if let Habit::Breaks(at) = self.habit
                && letter.len() >= at
            {
                self.reading.remove(&conn);
                self.outputs.push_back(Output::Abort(conn));
            }
        }
    }

    fn closed(&mut self, _now: Now, conn: ConnId, ended: Ended<'_>) {
        self.writing.remove(&conn);
        if let Some(letter) = self.reading.remove(&conn)
            && ended.orderly
            && !letter.is_empty()
        {
            self.letters.insert(conn, letter.freeze());
            self.outputs.push_back(Output::Close(conn));
        }
    }

    fn poll_transmit(&mut self, _now: Now, conn: ConnId) -> Option<Bytes> {
        self.writing.get_mut(&conn)?.pop_front()
    }

    fn poll_timeout(&self) -> Option<Duration> {
        None
    }

    fn handle_timeout(&mut self, _now: Now) {}

    fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn register(&mut self, _now: Now, ticket: u64, registration: Registration) {
        let result = Err(RegisterError::Name(registration.name));
        self.outputs
            .push_back(Output::Registered { ticket, result });
    }

    fn deregister(&mut self, _now: Now, _name: &str) {}

    fn leave(&mut self, _now: Now, ticket: u64, name: &str) {
        self.outputs.push_back(Output::Left {
            ticket,
            name: Text::from(name),
            letters: Vec::new(),
        });
    }

    fn submit(&mut self, _now: Now, submission: Submission) {
        let (ticket, outcomes) = (submission.ticket, Vec::new());
        self.outputs.push_back(Output::Outcome { ticket, outcomes });
    }

    fn sniff(&mut self, _now: Now, _on: bool) {}

    fn take_mail(&mut self, _name: &str) -> Option<Letter> {
        None
    }

    fn directory(&self) -> &Directory {
        &self.directory
    }

    fn service_name(&self) -> Text {
        Text::default()
    }

    fn shutdown(&mut self, _now: Now) {}
}

impl Sim {
    /// A robot of another make on a host of its own, which listens at `tcp://NAME:9999`.
    pub fn robot(&mut self, name: &str) -> NodeId {
        let node = NodeId(self.nodes.len());
        let address = Address::tcp(name, 9999);
        self.addresses.insert(address.clone(), (node, false));
        let listening = vec![(address, false)];
        self.nodes.push(Node::new(Recipe::Robot, node, listening));
        self.start(node);
        node
    }

    /// Sets what a robot does with what is written to it from now on.
    pub fn set_habit(&mut self, robot: NodeId, habit: Habit) {
        self.robot_at(robot).habit = habit;
        let ends = self.nodes[robot.0].conns.values().copied();
        let ends: Vec<(u64, usize)> = ends.collect();
        for (stream, side) in ends {
            if let Some((node, conn)) = self.machine_end(stream, 1 - side) {
                self.pump(node, conn);
            }
        }
    }

    /// mDNS: every daemon that is there finds this agent of a robot.
    pub fn announce(&mut self, robot: NodeId, entry: &Entry) {
        let announced = &mut self.nodes[robot.0].announced;
        if !announced.contains(&entry.name) {
            announced.push(entry.name.clone());
        }
        self.each_daemon(|mts, now| mts.neighbour_found(now, entry.clone()));
    }

    /// mDNS: an agent of a robot has said goodbye.
    pub fn withdraw(&mut self, robot: NodeId, name: &str) {
        self.nodes[robot.0].announced.retain(|known| known != name);
        self.each_daemon(|mts, now| mts.neighbour_gone(now, name));
    }

    fn each_daemon(&mut self, call: impl Fn(&mut Mts, Now)) {
        let now = self.now;
        for node in (0..self.nodes.len()).map(NodeId) {
            if let Running::Daemon(mts) = &mut self.nodes[node.0].running {
                call(mts, now);
                self.settle(node);
            }
        }
    }

    /// Has a robot write something to an address, on a connection of its own.
    pub fn robot_writes(&mut self, robot: NodeId, to: Address, octets: Bytes, then: Then) {
        let writing = self.robot_at(robot);
        writing.next_dial += 1;
        let (dial, addresses) = (DialId(writing.next_dial), vec![to]);
        writing.dials.insert(dial, (octets, then));
        writing.outputs.push_back(Output::Dial {
            dial,
            addresses,
            link: true,
        });
        self.settle(robot);
    }

    /// What a robot has read to the end of a stream, in the order in which it accepted the
    /// connections; those that brought nothing are left out.
    pub fn robot_letters(&mut self, robot: NodeId) -> Vec<Bytes> {
        self.robot_at(robot).letters.values().cloned().collect()
    }

    /// How many connections a robot has accepted.
    pub fn robot_accepted(&mut self, robot: NodeId) -> usize {
        self.robot_at(robot).accepted
    }

    fn robot_at(&mut self, node: NodeId) -> &mut Robot {
        match &mut self.nodes[node.0].running {
            Running::Robot(robot) => robot,
            _ => panic!("no robot runs at {node:?}"),
        }
    }

    /// Whether the network would hear of this agent if it was asked.
    pub(crate) fn answers_for(&self, asking: NodeId, name: &Text) -> bool {
        self.nodes.iter().enumerate().any(|(at, node)| {
            let here = node.machine().is_some() && node.announced.contains(name);
            here && !node.frozen && !self.is_cut(asking, NodeId(at))
        })
    }
}
