//! Writing to streams, and ending them.

use std::time::Duration;

use fipa_mts::ConnId;

use crate::events::Event;
use crate::net::{EndState, Item, Wish};
use crate::node::{NodeId, Running};
use crate::robot::{Habit, WINDOW};
use crate::sim::Sim;

/// Octets that a slow stream takes at once.
const PIECE: usize = 64 << 10;

impl Sim {
    /// Writes what a machine has for a connection, as far as the stream takes it now.
    pub(crate) fn pump(&mut self, node: NodeId, conn: ConnId) {
        let Some((stream, side)) = self.nodes[node.0].conns.get(&conn).copied() else {
            return;
        };
        let clock = self.now;
        let now = clock.mono;
        let mut arrivals = Vec::new();
        let mut into_nothing = false;
        while let Some(open) = self.streams.get_mut(&stream) {
            let room = match &self.nodes[open.ends[1 - side].node.0].running {
                Running::Robot(robot) if robot.habit == Habit::Stalls => {
                    WINDOW.saturating_sub(open.ends[1 - side].taken)
                }
                _ => usize::MAX,
            };
            let from = &mut open.ends[side];
            let slow = open.network.octets_per_second.is_some() && from.free_at > now;
            from.all_written = false;
            if slow || room == 0 {
                let given_up = room == 0 && from.wish == Some(Wish::Close);
                self.arrivals(stream, 1 - side, arrivals);
                if given_up {
                    self.end_side(stream, side, Some(Item::Closed));
                    self.closed_here(node, conn, true, false);
                }
                return;
            }
            let machine = self.nodes[node.0].machine_mut();
            let part = from.outbox.pop_front();
            let Some(mut part) = part.or_else(|| machine?.poll_transmit(clock, conn)) else {
                from.all_written = true;
                break;
            };
            if open.ends[1 - side].state == EndState::Ended {
                into_nothing = true;
                continue;
            }
            let mut piece = part.len().min(room);
            let mut written = now;
            if open.network.split && piece > 1 && open.random.bool() {
                piece = open.random.usize(1..piece);
            }
            if let Some(speed) = open.network.octets_per_second {
                piece = piece.min(PIECE);
                let from = &mut open.ends[side];
                from.free_at = now + Duration::from_secs_f64(piece as f64 / speed as f64);
                written = from.free_at;
                let run = self.nodes[node.0].run;
                self.queue.put(written, Event::Pump { node, run, conn });
            }
            let rest = part.split_off(piece);
            if !rest.is_empty() {
                open.ends[side].outbox.push_front(rest);
            }
            open.ends[1 - side].taken += part.len();
            self.nodes[node.0].collected.octets += part.len() as u64;
            arrivals.push(open.put(written, 1 - side, Item::Octets(part)));
        }
        self.arrivals(stream, 1 - side, arrivals);
        if into_nothing {
            self.answer_reset(stream, side);
        }
        let closing = self.streams.get(&stream);
        if closing.is_some_and(|open| open.ends[side].wish.is_some()) {
            self.end_side(stream, side, Some(Item::Closed));
            self.closed_here(node, conn, true, true);
        }
        // What waited for room on the connection may have been refused.
        self.settle(node);
    }

    /// A host whose process is gone says so to whoever writes; one without power says nothing.
    pub(crate) fn answer_reset(&mut self, stream: u64, side: usize) {
        let now = self.now.mono;
        if let Some(open) = self.streams.get_mut(&stream)
            && self.nodes[open.ends[1 - side].node.0].machine().is_some()
        {
            let at = open.put(now, side, Item::Reset);
            self.arrivals(stream, side, vec![at]);
        }
    }

    fn arrivals(&mut self, stream: u64, side: usize, mut at: Vec<Duration>) {
        at.dedup();
        for at in at {
            self.queue.put(at, Event::Arrive { stream, side });
        }
    }

    /// Closes a connection as it is wished.
    pub(crate) fn close(&mut self, node: NodeId, conn: ConnId, wish: Wish) {
        if let Some((stream, side)) = self.nodes[node.0].conns.get(&conn).copied()
            && let Some(open) = self.streams.get_mut(&stream)
        {
            open.ends[side].wish = Some(wish);
            self.pump(node, conn);
        }
    }

    /// Breaks a connection off.
    pub(crate) fn abort(&mut self, node: NodeId, conn: ConnId) {
        if let Some((stream, side)) = self.nodes[node.0].conns.get(&conn).copied() {
            self.end_side(stream, side, Some(Item::Reset));
            self.closed_here(node, conn, true, false);
        }
    }

    /// The machine at an end of a stream, and the connection that it is there.
    pub(crate) fn machine_end(&self, stream: u64, side: usize) -> Option<(NodeId, ConnId)> {
        let end = &self.streams.get(&stream)?.ends[side];
        match end.state {
            EndState::Open(conn) => Some((end.node, conn)),
            EndState::Connecting | EndState::Ended => None,
        }
    }

    /// Ends one end of a stream; the other one is told, or not.
    pub(crate) fn end_side(&mut self, stream: u64, side: usize, told: Option<Item>) {
        let now = self.now.mono;
        let Some(open) = self.streams.get_mut(&stream) else {
            return;
        };
        if let EndState::Open(conn) = open.ends[side].state {
            self.nodes[open.ends[side].node.0].conns.remove(&conn);
        }
        open.ends[side].state = EndState::Ended;
        open.ends[side].arriving.clear();
        if open.ends[1 - side].state == EndState::Ended {
            self.streams.remove(&stream);
        } else if let Some(told) = told {
            let at = open.put(now, 1 - side, told);
            self.arrivals(stream, 1 - side, vec![at]);
        }
    }
}
