//! The clock, the queue, and what each event does.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::time::Duration;

use fipa_directory::{Address, Now};
use fipa_mts::{Announced, ConnId, Ended, Machine, Output};

use crate::disk::Write;
use crate::events::{Event, Queue};
use crate::net::{Network, Stream, Wish};
use crate::node::{Node, NodeId, Running, Told};

/// How long the network is asked whether a platform is there.
const VERIFY: Duration = Duration::from_secs(1);

/// Machines on a simulated clock and network.
#[derive(Debug)]
pub struct Sim {
    pub(crate) now: Now,
    pub(crate) random: fastrand::Rng,
    pub(crate) seed: u64,
    pub(crate) queue: Queue,
    pub(crate) nodes: Vec<Node>,
    /// Who listens where: the node, and whether it is its control socket. Kept while it is down.
    pub(crate) addresses: HashMap<Address, (NodeId, bool)>,
    pub(crate) streams: BTreeMap<u64, Stream>,
    pub(crate) next_stream: u64,
    pub(crate) network: Network,
    /// Networks of pairs of hosts that are unlike the usual one.
    pub(crate) networks: HashMap<(NodeId, NodeId), Network>,
    /// Pairs of hosts that cannot reach each other, and hosts that reach nobody.
    pub(crate) cuts: BTreeSet<(NodeId, NodeId)>,
    pub(crate) isolated: BTreeSet<NodeId>,
    pub(crate) next_ticket: u64,
    pub(crate) open_tickets: usize,
}

impl Sim {
    /// A simulation without nodes.
    pub fn new(seed: u64) -> Sim {
        Sim {
            now: Now {
                mono: Duration::from_secs(1_000_000),
                unix_millis: 1_795_341_600_000,
            },
            random: fastrand::Rng::with_seed(seed),
            seed,
            queue: Queue::default(),
            nodes: Vec::new(),
            addresses: HashMap::new(),
            streams: BTreeMap::new(),
            next_stream: 0,
            network: Network::default(),
            networks: HashMap::new(),
            cuts: BTreeSet::new(),
            isolated: BTreeSet::new(),
            next_ticket: 0,
            open_tickets: 0,
        }
    }

    /// The time.
    pub fn now(&self) -> Now {
        self.now
    }

    /// The generator of the simulation, for what a test draws itself.
    pub fn random(&mut self) -> &mut fastrand::Rng {
        &mut self.random
    }

    pub(crate) fn put(&mut self, span: Duration, event: Event) {
        self.queue.put(self.now.mono + span, event);
    }

    pub(crate) fn advance(&mut self, to: Duration) {
        if to > self.now.mono {
            self.now = self.now.plus(to - self.now.mono);
        }
    }

    pub(crate) fn step(&mut self) {
        let Some((at, event)) = self.queue.pop() else {
            return;
        };
        self.advance(at);
        match event {
            Event::Wake { node, run } => self.wake(node, run),
            Event::Dial(dialling) => self.dial_next(dialling),
            Event::Opened {
                stream,
                side,
                dialled,
                control,
            } => self.opened(stream, side, dialled, control),
            Event::Arrive { stream, side } => self.arrive(stream, side),
            Event::Call(call) => call(self),
            Event::Pump { node, run, conn } if self.runs(node, run) => self.pump(node, conn),
            event => self.tell_machine(event),
        }
    }

    /// Events that are a call of a machine, and wait while it is frozen.
    fn tell_machine(&mut self, event: Event) {
        let (node, run) = match &event {
            Event::DialFailed { node, run, .. }
            | Event::Closed { node, run, .. }
            | Event::Unanswered { node, run, .. } => (*node, *run),
            _ => return,
        };
        if !self.runs(node, run) {
            return;
        }
        if self.nodes[node.0].frozen {
            self.nodes[node.0].held.push_back(event);
            return;
        }
        match event {
            Event::DialFailed { dial, reason, .. } => {
                self.with(node, |machine, now| machine.dial_failed(now, dial, &reason));
            }
            Event::Closed {
                conn,
                orderly,
                all_written,
                ..
            } => {
                let ended = Ended {
                    reason: "closed",
                    orderly,
                    all_written,
                };
                self.with(node, |machine, now| machine.closed(now, conn, ended));
                self.end_if_closed(node);
            }
            Event::Unanswered { announced, .. } => {
                let now = self.now;
                if let Running::Daemon(mts) = &mut self.nodes[node.0].running {
                    match announced {
                        Announced::Platform(instance) => mts.undiscovered(now, instance),
                        Announced::Agent(name) => mts.neighbour_gone(now, &name),
                    }
                }
                self.settle(node);
            }
            _ => {}
        }
    }

    pub(crate) fn runs(&self, node: NodeId, run: u64) -> bool {
        self.nodes[node.0].run == run
    }

    /// Calls a machine, if there is one, and does what it wants done.
    pub(crate) fn with(&mut self, node: NodeId, call: impl FnOnce(&mut dyn Machine, Now)) {
        let now = self.now;
        if let Some(machine) = self.nodes[node.0].machine_mut() {
            call(machine, now);
            self.settle(node);
        }
    }

    fn wake(&mut self, node: NodeId, run: u64) {
        let now = self.now;
        let woken = &mut self.nodes[node.0];
        if woken.run != run || woken.wake != Some(now.mono) {
            return;
        }
        woken.wake = None;
        if woken.frozen {
            return;
        }
        if let Some(machine) = woken.machine_mut()
            && machine.poll_timeout().is_some_and(|at| at <= now.mono)
        {
            machine.handle_timeout(now);
            let again = machine.poll_timeout();
            assert!(
                again.is_none_or(|at| at > now.mono),
                "{node:?} wants to be woken again and again"
            );
        }
        self.settle(node);
    }

    /// Does what a machine wants done, and plans when it is woken.
    pub(crate) fn settle(&mut self, node: NodeId) {
        if std::mem::replace(&mut self.nodes[node.0].settling, true) {
            return;
        }
        while let Some(output) = self.nodes[node.0]
            .machine_mut()
            .and_then(Machine::poll_output)
        {
            self.act(node, output);
        }
        self.nodes[node.0].settling = false;
        let now = self.now.mono;
        let settled = &mut self.nodes[node.0];
        let next = settled.machine().and_then(Machine::poll_timeout);
        let next = next.map(|at| at.max(now));
        if let Some(at) = next
            && settled.wake.is_none_or(|planned| at < planned)
        {
            settled.wake = Some(at);
            let run = settled.run;
            self.queue.put(at, Event::Wake { node, run });
        }
    }

    fn act(&mut self, node: NodeId, output: Output) {
        let at = self.now.mono;
        let run = self.nodes[node.0].run;
        match output {
            Output::Dial {
                dial, addresses, ..
            } => self.dial(node, dial, addresses),
            Output::Transmit(conn) => self.pump(node, conn),
            Output::Close(conn) => self.close(node, conn, Wish::Close),
            Output::Finish(conn) => self.close(node, conn, Wish::Finish),
            Output::Abort(conn) => self.abort(node, conn),
            Output::Verify(announced) => {
                let answered = match &announced {
                    Announced::Platform(instance) => self.answers(node, *instance),
                    Announced::Agent(name) => self.answers_for(node, name),
                };
                let verified = &mut self.nodes[node.0].collected.verified;
                verified.push(announced.clone());
                if !answered {
                    let event = Event::Unanswered {
                        node,
                        run,
                        announced,
                    };
                    self.put(VERIFY, event);
                }
            }
            Output::Outcome { ticket, outcomes } => {
                let told = Told { at, outcomes };
                let collected = &mut self.nodes[node.0].collected;
                let before = collected.outcomes.insert(ticket, told);
                assert!(before.is_none(), "{node:?}: ticket {ticket} was told twice");
                self.open_tickets = self.open_tickets.saturating_sub(1);
            }
            Output::Store(letter) => self.write_disk(node, Write::Store(Box::new(letter))),
            Output::Unstore(key) => self.write_disk(node, Write::Unstore(key)),
            output => self.collect(node, output),
        }
    }

    /// A connection's own end was closed; the machine hears of it as of any other end.
    pub(crate) fn closed_here(
        &mut self,
        node: NodeId,
        conn: ConnId,
        orderly: bool,
        all_written: bool,
    ) {
        let run = self.nodes[node.0].run;
        let event = Event::Closed {
            node,
            run,
            conn,
            orderly,
            all_written,
        };
        self.put(Duration::ZERO, event);
    }
}
