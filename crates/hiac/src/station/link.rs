//! One link: whether its partner is there, and what was agreed with it.

use alloc::string::String;
use core::time::Duration;

use super::queue::Queue;
use super::types::{LinkConfig, Role, StationConfig};
use crate::edcp::Decoder;
use crate::sys::{Checks, FRAGMENTS, NUMBERS, Parameters, Types};
use crate::{Address, Growing, Mask};

/// What comes at the very end of the period still counts.
const LATE: Duration = Duration::from_millis(1);

/// Where the setting up of a connection stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    /// It waits for an INCON, or has been refused.
    Idle,
    /// It sends INCON.
    Calling {
        /// When next.
        next: Duration,
        /// For an employee that passes over: how long, whatever the answer is.
        until: Option<Duration>,
    },
    Connected,
}

/// A new position for the employee of a link, until it agrees.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recon {
    pub(super) local: Address,
    pub(super) peer: Address,
    pub(super) next: Duration,
}

/// What is known of a partner.
#[derive(Clone, Debug)]
pub(super) struct Partner {
    pub(super) period: Duration,
    pub(super) largest: usize,
    pub(super) checks: Checks,
    pub(super) types: Types,
    pub(super) abilities: u8,
    pub(super) name: Option<String>,
}

impl Partner {
    pub(super) fn of(parameters: &Parameters<'_>) -> Partner {
        let period = parameters.period.unwrap_or(1000);
        let largest = parameters.largest.unwrap_or(65_536);
        Partner {
            period: Duration::from_millis(period.into()),
            largest: usize::try_from(largest).unwrap_or(usize::MAX),
            checks: parameters.checks.unwrap_or(Checks::SUM),
            types: parameters.types.unwrap_or(Types::ALL),
            abilities: parameters.abilities.unwrap_or(NUMBERS | FRAGMENTS),
            name: parameters.name.map(Into::into),
        }
    }

    pub(super) fn confirms(&self) -> bool {
        self.abilities & NUMBERS != 0
    }

    pub(super) fn joins(&self) -> bool {
        self.confirms() && self.abilities & FRAGMENTS != 0
    }
}

#[derive(Debug)]
pub(super) struct Link {
    pub(super) role: Role,
    pub(super) config: LinkConfig,
    pub(super) state: State,
    pub(super) decoder: Decoder<Growing>,
    /// What the decoder had heard when it was last looked at.
    heard: u32,
    last_heard: Duration,
    last_written: Duration,
    alive_due: bool,
    /// The mask of the subnetwork; `None` before the first INCON.
    pub(super) mask: Option<Mask>,
    /// The own address in it.
    pub(super) local: Address,
    pub(super) peer: Address,
    /// Which workgroup it is of, for an employer.
    pub(super) group: usize,
    pub(super) partner: Partner,
    pub(super) recon: Option<Recon>,
    pub(super) queue: Queue,
}

impl Link {
    pub(super) fn new(config: LinkConfig, station: &StationConfig) -> Link {
        let limit = usize::try_from(station.largest).unwrap_or(usize::MAX);
        Link {
            role: config.role,
            config,
            state: State::Idle,
            decoder: Decoder::new(Growing::new(limit.max(64))),
            heard: 0,
            last_heard: Duration::ZERO,
            last_written: Duration::ZERO,
            alive_due: false,
            mask: None,
            local: Address(0),
            peer: Address(0),
            group: 0,
            partner: Partner::of(&Parameters::default()),
            recon: None,
            queue: Queue::default(),
        }
    }

    pub(super) fn is_connected(&self) -> bool {
        self.state == State::Connected
    }

    /// The mask under which packets of the link are read.
    pub(super) fn is_within(&self, address: Address) -> bool {
        self.mask
            .is_some_and(|mask| mask.same_subnetwork(self.local, address))
    }

    pub(super) fn is_broadcast(&self, address: Address) -> bool {
        let level = self
            .mask
            .map(|mask| mask.level(address) == mask.broadcast());
        self.is_within(address) && level == Some(true)
    }

    /// Whether the link's level addresses can name it.
    pub(super) fn has_level(&self, address: Address) -> bool {
        let named = self
            .mask
            .map(|mask| mask.address(self.local, mask.level(address)));
        self.is_within(address) && named == Some(Some(address))
    }

    /// Whether it is the partner, or below it.
    pub(super) fn leads_to(&self, address: Address) -> bool {
        let block = |mask: Mask| mask.same_block(self.peer, address);
        self.is_connected() && self.mask.is_some_and(block)
    }

    pub(super) fn connect(&mut self, now: Duration, partner: Partner) {
        self.state = State::Connected;
        self.partner = partner;
        self.last_heard = now;
        self.last_written = now;
        self.alive_due = false;
    }

    /// Notes whether the partner was heard.
    pub(super) fn listen(&mut self, now: Duration) {
        let heard = self.decoder.heard();
        if heard != self.heard {
            self.heard = heard;
            self.last_heard = now;
        }
    }

    pub(super) fn written(&mut self, now: Duration) {
        self.last_written = now;
        self.alive_due = false;
    }

    pub(super) fn take_alive(&mut self) -> bool {
        core::mem::take(&mut self.alive_due)
    }

    pub(super) fn is_lost(&self, now: Duration) -> bool {
        self.is_connected() && now >= self.last_heard + self.partner.period + LATE
    }

    pub(super) fn handle_timeout(&mut self, now: Duration) {
        let silent = now >= self.last_written + self.partner.period / 2;
        if self.is_connected() && silent && !self.queue.in_flight() {
            self.alive_due = true;
        }
    }

    pub(super) fn next_timeout(&self) -> Option<Duration> {
        let call = match self.state {
            State::Calling { next, until } => Some(until.map_or(next, |until| until.min(next))),
            _ => None,
        };
        let connected = self.is_connected();
        let lost = connected.then(|| self.last_heard + self.partner.period + LATE);
        let says_something = self.alive_due || self.queue.in_flight();
        let alive =
            (connected && !says_something).then(|| self.last_written + self.partner.period / 2);
        let recon = self.recon.map(|recon| recon.next);
        let times = [call, lost, alive, recon, self.queue.next_timeout()];
        times.into_iter().flatten().min()
    }
}
