//! The queue of what will happen.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use fipa_directory::Address;
use fipa_mts::{Announced, ConnId, DialId};

use crate::{NodeId, Sim};

pub(crate) enum Event {
    /// A machine's time has come.
    Wake { node: NodeId, run: u64 },
    /// A dial tries its next address.
    Dial(Dialling),
    /// A dial has tried all of them.
    DialFailed {
        node: NodeId,
        run: u64,
        dial: DialId,
        reason: String,
    },
    /// A stream is there, at one of its ends.
    Opened {
        stream: u64,
        side: usize,
        dialled: Option<(DialId, Address)>,
        control: bool,
    },
    /// Something reaches an end of a stream.
    Arrive { stream: u64, side: usize },
    /// An end of a slow stream may write again.
    Pump {
        node: NodeId,
        run: u64,
        conn: ConnId,
    },
    /// A machine's own end of a stream is closed.
    Closed {
        node: NodeId,
        run: u64,
        conn: ConnId,
        orderly: bool,
        all_written: bool,
    },
    /// The network was asked whether something is there, and nobody answered.
    Unanswered {
        node: NodeId,
        run: u64,
        announced: Announced,
    },
    /// What a test wants done.
    Call(Box<dyn FnOnce(&mut Sim)>),
}

#[derive(Clone, Debug)]
pub(crate) struct Dialling {
    pub(crate) node: NodeId,
    pub(crate) run: u64,
    pub(crate) dial: DialId,
    pub(crate) addresses: Vec<Address>,
    pub(crate) next: usize,
}

impl fmt::Debug for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Event::Wake { .. } => "wake",
            Event::Dial(_) => "dial",
            Event::DialFailed { .. } => "dial failed",
            Event::Opened { .. } => "opened",
            Event::Arrive { .. } => "arrive",
            Event::Pump { .. } => "pump",
            Event::Closed { .. } => "closed",
            Event::Unanswered { .. } => "unanswered",
            Event::Call(_) => "call",
        })
    }
}

/// Events by time; those of one time in the order in which they were put.
#[derive(Debug, Default)]
pub(crate) struct Queue {
    events: BTreeMap<(Duration, u64), Event>,
    put: u64,
    timers: usize,
}

impl Queue {
    pub(crate) fn put(&mut self, at: Duration, event: Event) {
        self.timers += usize::from(is_timer(&event));
        self.put += 1;
        self.events.insert((at, self.put), event);
    }

    pub(crate) fn next_at(&self) -> Option<Duration> {
        self.events.first_key_value().map(|((at, _), _)| *at)
    }

    pub(crate) fn pop(&mut self) -> Option<(Duration, Event)> {
        let ((at, _), event) = self.events.pop_first()?;
        self.timers -= usize::from(is_timer(&event));
        Some((at, event))
    }

    /// Whether nothing but timers waits.
    pub(crate) fn is_quiet(&self) -> bool {
        self.events.len() == self.timers
    }
}

fn is_timer(event: &Event) -> bool {
    matches!(event, Event::Wake { .. })
}
