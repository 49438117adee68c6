//! Letters beside the main stream: those of each urgency on a stream of their own, where the
//! connection has several.
//!
//! ```text
//!   main    hello  facts …  receipts …                       after 3 letters, goodbye
//!   lane 0                         after 2 facts, letter  letter
//!   lane 2                         after 2 facts, letter
//! ```
//!
//! Streams are not in step with each other. What has to be in order says so: a letter waits for
//! the facts that were told before it (its sender may be an agent that was just registered), and
//! the goodbye waits for the letters before it. Receipts and heartbeats wait for nothing.

use crate::incoming::Incoming;
use crate::outgoing::Outgoing;
use crate::{Frame, LANES};

/// How far the reading of one stream has got.
#[derive(Debug, Default)]
pub(crate) struct Reading {
    /// A large letter of which a part has come.
    pub(crate) incoming: Option<Incoming>,
    /// What follows is not taken before so many frames have come that it waits for.
    after: u64,
}

/// The lanes of a link, and what is counted so that they keep in order what has to be.
#[derive(Debug, Default)]
pub(crate) struct Lanes {
    pub(crate) out: [Outgoing; LANES],
    pub(crate) reading: [Reading; LANES],
    /// Facts that each lane says it waits for.
    told: [u64; LANES],
    facts_sent: u64,
    facts_heard: u64,
    letters_sent: u64,
    letters_heard: u64,
}

impl Lanes {
    /// What goes before a frame on the main stream.
    pub(crate) fn sends_on_main(&mut self, frame: &Frame) -> Option<Frame> {
        self.facts_sent += u64::from(is_fact(frame));
        let last = matches!(frame, Frame::Goodbye(_)) && self.letters_sent > 0;
        last.then_some(Frame::After(self.letters_sent))
    }

    /// What goes before a letter on a lane.
    pub(crate) fn sends_letter(&mut self, lane: usize) -> Option<Frame> {
        self.letters_sent += 1;
        let told = self.told.get_mut(lane)?;
        let news = *told != self.facts_sent;
        *told = self.facts_sent;
        news.then_some(Frame::After(self.facts_sent))
    }

    /// Counts what has come.
    pub(crate) fn heard(&mut self, lane: Option<usize>, frame: &Frame) {
        match lane {
            Some(_) => self.letters_heard += u64::from(matches!(frame, Frame::Letter(_))),
            None => self.facts_heard += u64::from(is_fact(frame)),
        }
    }

    /// Whether a stream waits for what comes on another.
    pub(crate) fn is_held(&self, lane: Option<usize>, reading: &Reading) -> bool {
        let come = match lane {
            Some(_) => self.facts_heard,
            None => self.letters_heard,
        };
        come < reading.after
    }
}

impl Reading {
    pub(crate) fn wait_for(&mut self, count: u64) {
        self.after = count;
    }
}

/// What a letter may rely on.
fn is_fact(frame: &Frame) -> bool {
    !matches!(
        frame,
        Frame::Receipt { .. } | Frame::Ping(_) | Frame::Pong(_) | Frame::After(_)
    )
}
