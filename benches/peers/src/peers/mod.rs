//! Those that are compared, each behind the same few calls.

use std::time::Duration;

mod agents;
mod bare;
pub(crate) mod grpc;
mod nats;
pub(crate) mod zenoh;
pub(crate) mod zeromq;

pub(crate) use self::agents::Agents;
pub(crate) use self::bare::Bare;
pub(crate) use self::grpc::Grpc;
pub(crate) use self::nats::Nats;
pub(crate) use self::zenoh::Zenoh;
pub(crate) use self::zeromq::ZeroMq;

/// One of those that are compared: its ends are in this process, its middle is another.
pub(crate) trait Peer {
    /// What it is, with its version.
    fn name(&self) -> String;

    /// Makes ready for what is to be measured.
    fn prepare(&mut self) {}

    /// The process in the middle.
    fn middle(&self) -> u32;

    /// Sends letters one way and waits until all of them are at the sink.
    fn one_way(&mut self, work: Work);

    /// Times letters that go there and come back, one after the other.
    fn round_trips(&mut self, octets: usize, count: usize) -> Vec<Duration>;
}

/// What is to be sent.
#[derive(Clone, Copy)]
pub(crate) struct Work {
    /// Octets of content of each letter: what a peer writes around it comes on top.
    pub(crate) octets: usize,
    pub(crate) letters: usize,
    /// How many may be under way, where the peer has no bound of its own.
    pub(crate) window: usize,
}
