//! Streams: octets arrive in order, after a while, in pieces.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::Address;
use fipa_mts::{ConnId, Connected, DialId, Ended};

use crate::events::Event;
use crate::node::NodeId;
use crate::sim::Sim;

/// How a stream behaves.
#[derive(Clone, Debug)]
pub struct Network {
    /// How long octets travel.
    pub latency: Duration,
    /// How much longer they may travel, at random.
    pub jitter: Duration,
    /// Whether octets are cut into pieces at random.
    pub split: bool,
    /// How many octets are written in a second; `None`: any number at once.
    pub octets_per_second: Option<u64>,
}

impl Default for Network {
    /// One millisecond, all at once.
    fn default() -> Network {
        Network {
            latency: Duration::from_millis(1),
            jitter: Duration::ZERO,
            split: false,
            octets_per_second: None,
        }
    }
}

#[derive(Debug)]
pub(crate) struct Stream {
    pub(crate) ends: [End; 2],
    pub(crate) network: Network,
    pub(crate) random: fastrand::Rng,
}

#[derive(Debug)]
pub(crate) struct End {
    pub(crate) node: NodeId,
    run: u64,
    pub(crate) state: EndState,
    /// What was read and did not make a whole frame yet.
    inbox: BytesMut,
    /// What is on its way to this end.
    pub(crate) arriving: VecDeque<(Duration, Item)>,
    last_arrival: Duration,
    /// When this end of a slow stream may write again, and what waits for that.
    pub(crate) free_at: Duration,
    pub(crate) outbox: VecDeque<Bytes>,
    /// Octets that the system at this end has taken.
    pub(crate) taken: usize,
    /// Whether nothing waits to be written by this end.
    pub(crate) all_written: bool,
    pub(crate) wish: Option<Wish>,
    /// A bit of what arrives next is turned over.
    pub(crate) corrupt: bool,
}

/// How an end is to be closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wish {
    /// Once all is written.
    Finish,
    /// Once all is written, or the other side takes no more.
    Close,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EndState {
    Connecting,
    Open(ConnId),
    Ended,
}

#[derive(Debug)]
pub(crate) enum Item {
    Octets(Bytes),
    /// The other end was closed.
    Closed,
    /// The stream is broken.
    Reset,
}

impl Item {
    fn reason(&self) -> &'static str {
        match self {
            Item::Reset => "connection reset by peer",
            Item::Octets(_) | Item::Closed => "the other side closed the connection",
        }
    }
}

impl Stream {
    pub(crate) fn new(network: Network, ends: [(NodeId, u64); 2], seed: u64) -> Stream {
        let end = |(node, run)| End {
            node,
            run,
            state: EndState::Connecting,
            inbox: BytesMut::new(),
            arriving: VecDeque::new(),
            last_arrival: Duration::ZERO,
            free_at: Duration::ZERO,
            outbox: VecDeque::new(),
            taken: 0,
            all_written: true,
            wish: None,
            corrupt: false,
        };
        Stream {
            ends: ends.map(end),
            network,
            random: fastrand::Rng::with_seed(seed),
        }
    }

    /// Puts something on its way to an end; when it arrives.
    pub(crate) fn put(&mut self, now: Duration, to: usize, item: Item) -> Duration {
        let jitter = self.network.jitter.mul_f64(self.random.f64());
        let end = &mut self.ends[to];
        end.last_arrival = end.last_arrival.max(now + self.network.latency + jitter);
        end.arriving.push_back((end.last_arrival, item));
        end.last_arrival
    }
}

impl Sim {
    pub(crate) fn opened(
        &mut self,
        stream: u64,
        side: usize,
        dialled: Option<(DialId, Address)>,
        control: bool,
    ) {
        let Some(opened) = self.streams.get_mut(&stream) else {
            return;
        };
        let (node, other) = (opened.ends[side].node, opened.ends[1 - side].node);
        if self.nodes[node.0].run != opened.ends[side].run {
            self.end_side(stream, side, Some(Item::Reset));
            return;
        }
        if self.nodes[node.0].frozen {
            let event = Event::Opened {
                stream,
                side,
                dialled,
                control,
            };
            self.nodes[node.0].held.push_back(event);
            return;
        }
        let same_host = self.nodes[node.0].host == self.nodes[other.0].host;
        let opening = &mut self.nodes[node.0];
        opening.next_conn += 1;
        let conn = ConnId(opening.next_conn);
        opening.conns.insert(conn, (stream, side));
        opened.ends[side].state = EndState::Open(conn);
        let connected = Connected {
            conn,
            dialled,
            control,
            same_host,
            remote: Text::from(format!("tcp://node-{}:40000", other.0)),
            identity: None,
            lanes: false,
        };
        self.with(node, |machine, now| machine.connected(now, connected));
        self.arrive(stream, side);
    }

    /// Hands over what has arrived, unless the way is cut or the node is frozen: then it waits.
    pub(crate) fn arrive(&mut self, stream: u64, side: usize) {
        loop {
            let now = self.now.mono;
            let Some(open) = self.streams.get_mut(&stream) else {
                return;
            };
            let (node, other) = (open.ends[side].node, open.ends[1 - side].node);
            let EndState::Open(conn) = open.ends[side].state else {
                return;
            };
            let arriving = &mut open.ends[side].arriving;
            if arriving.is_empty() {
                // Most of a million ends are at rest most of the time.
                *arriving = VecDeque::new();
            }
            let due = arriving.front();
            let due = due.is_some_and(|(at, _)| *at <= now);
            let blocked = self.nodes[node.0].frozen || self.is_cut(node, other);
            if !due || blocked {
                return;
            }
            let Some(open) = self.streams.get_mut(&stream) else {
                return;
            };
            match open.ends[side].arriving.pop_front() {
                Some((_, Item::Octets(octets))) => {
                    let mut inbox = std::mem::take(&mut open.ends[side].inbox);
                    let before = inbox.len();
                    inbox.extend_from_slice(&octets);
                    if std::mem::take(&mut open.ends[side].corrupt) {
                        let octet = open.random.usize(before..inbox.len());
                        inbox[octet] ^= 1 << open.random.u8(0..8);
                    }
                    let unread = &mut inbox;
                    self.with(node, |machine, now| machine.received(now, conn, unread));
                    if let Some(open) = self.streams.get_mut(&stream)
                        && !inbox.is_empty()
                    {
                        open.ends[side].inbox = inbox;
                    }
                }
                Some((_, end)) => {
                    let ended = Ended {
                        reason: end.reason(),
                        orderly: matches!(end, Item::Closed),
                        all_written: open.ends[side].all_written,
                    };
                    self.end_side(stream, side, None);
                    self.with(node, |machine, now| machine.closed(now, conn, ended));
                    self.end_if_closed(node);
                }
                None => return,
            }
        }
    }
}
