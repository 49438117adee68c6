//! A node: a machine, where it listens, and what it has told.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use fipa_acl::{Letter, Text};
use fipa_directory::{Address, Change};
use fipa_link::{ReceiverOutcome, Sniffed};
use fipa_mts::{
    Announced, Config, ConnId, Machine, Mts, Notice, Program, ProgramConfig, RegisterError,
};

use crate::disk::Disk;
use crate::events::Event;
use crate::robot::Robot;

/// A node of the simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub usize);

/// What became of a submission, and when.
#[derive(Clone, Debug)]
pub struct Told {
    /// When it was told, on the simulated clock.
    pub at: Duration,
    /// The outcomes.
    pub outcomes: Vec<ReceiverOutcome>,
}

/// What a node has told so far, over all its runs.
#[derive(Debug, Default)]
pub struct Collected {
    /// By ticket. A ticket that is told of twice ends the simulation with a panic.
    pub outcomes: BTreeMap<u64, Told>,
    /// By ticket.
    pub registrations: BTreeMap<u64, Result<(), RegisterError>>,
    /// With their times.
    pub notices: Vec<(Duration, Notice)>,
    /// Changes of the directory, with their times.
    pub changes: Vec<(Duration, Change)>,
    /// Letters that were taken out of mailboxes, by agent.
    pub mail: BTreeMap<Text, Vec<Letter>>,
    /// What passed the service while it was watched.
    pub sniffed: Vec<Sniffed>,
    /// What the network was to be asked for.
    pub verified: Vec<Announced>,
    /// Dials that were asked for, with their times.
    pub dials: Vec<(Duration, Vec<Address>)>,
    /// Octets that were written to streams.
    pub octets: u64,
}

/// What runs on a node.
#[derive(Debug)]
pub(crate) enum Running {
    Daemon(Box<Mts>),
    Program(Box<Program>),
    Robot(Box<Robot>),
    /// It crashed or was shut down.
    Nothing,
}

/// How to start it again.
#[derive(Clone, Debug)]
pub(crate) enum Recipe {
    Daemon(Box<Config>),
    Program(Box<ProgramConfig>),
    Robot,
}

#[derive(Debug)]
pub(crate) struct Node {
    pub(crate) running: Running,
    pub(crate) recipe: Recipe,
    /// The host that it runs on, numbered by the daemon there.
    pub(crate) host: NodeId,
    /// Where it listens, and whether that is the control socket.
    pub(crate) listening: Vec<(Address, bool)>,
    /// Agents of a robot that mDNS tells of.
    pub(crate) announced: Vec<Text>,
    /// Peers that it was given, and is given again when it is restarted.
    pub(crate) peers: Vec<Address>,
    /// Counts its runs; what belongs to an earlier one is dropped.
    pub(crate) run: u64,
    /// Its connections: the stream, and which end of it.
    pub(crate) conns: BTreeMap<ConnId, (u64, usize)>,
    pub(crate) next_conn: u64,
    pub(crate) frozen: bool,
    /// What waits until it thaws.
    pub(crate) held: VecDeque<Event>,
    /// When it will be woken next.
    pub(crate) wake: Option<Duration>,
    pub(crate) closing: bool,
    /// What its machine wants done is being done.
    pub(crate) settling: bool,
    /// Whether mail is taken out as soon as it comes.
    pub(crate) reading: bool,
    /// Tickets of the letters that this run has submitted.
    pub(crate) submitted: Vec<u64>,
    pub(crate) disk: Disk,
    pub(crate) collected: Collected,
}

impl Node {
    pub(crate) fn new(recipe: Recipe, host: NodeId, listening: Vec<(Address, bool)>) -> Node {
        Node {
            running: Running::Nothing,
            recipe,
            host,
            listening,
            announced: Vec::new(),
            peers: Vec::new(),
            run: 0,
            conns: BTreeMap::new(),
            next_conn: 0,
            frozen: false,
            held: VecDeque::new(),
            wake: None,
            closing: false,
            settling: false,
            reading: true,
            submitted: Vec::new(),
            disk: Disk::default(),
            collected: Collected::default(),
        }
    }

    pub(crate) fn machine(&self) -> Option<&dyn Machine> {
        match &self.running {
            Running::Daemon(mts) => Some(mts.as_ref()),
            Running::Program(program) => Some(program.as_ref()),
            Running::Robot(robot) => Some(robot.as_ref()),
            Running::Nothing => None,
        }
    }

    pub(crate) fn machine_mut(&mut self) -> Option<&mut dyn Machine> {
        match &mut self.running {
            Running::Daemon(mts) => Some(mts.as_mut()),
            Running::Program(program) => Some(program.as_mut()),
            Running::Robot(robot) => Some(robot.as_mut()),
            Running::Nothing => None,
        }
    }
}
