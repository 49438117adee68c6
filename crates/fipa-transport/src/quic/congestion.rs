//! How much is under way at once over a radio, which loses packets though nobody sends too much.
//!
//! Cubic (RFC 9438) takes each loss for a sign that a queue is full, and sends less; where one packet
//! in a hundred is lost on its way it soon sends next to nothing. Here it hears of a loss only where
//! more speaks for such a queue: packets take longer than when nothing waited, or more of them are
//! lost than a radio loses by itself.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::congestion::{Controller, ControllerFactory, ControllerMetrics, Cubic, CubicConfig};
use quinn_proto::RttEstimator;

/// The share of octets that a radio may lose by itself.
const LOSSES: f64 = 0.25;

/// Octets over which the share is taken.
const SPAN: f64 = 128e3;

/// How much longer than ever a round trip may be where nothing waits: this, and a quarter.
const SLACK: Duration = Duration::from_millis(10);

/// Makes a [`Patient`] of each path.
#[derive(Debug)]
pub(super) struct Patience;

impl ControllerFactory for Patience {
    fn build(self: Arc<Self>, now: Instant, mtu: u16) -> Box<dyn Controller> {
        Box::new(Patient {
            cubic: Cubic::new(Arc::new(CubicConfig::default()), now, mtu),
            way: Way::default(),
        })
    }
}

/// Cubic, for a radio.
#[derive(Clone, Debug)]
struct Patient {
    cubic: Cubic,
    way: Way,
}

/// What is known of a path.
#[derive(Clone, Copy, Debug, Default)]
struct Way {
    /// The share of octets that were lost lately.
    lost: f64,
    /// A queue has made the last round trips longer.
    is_longer: bool,
}

impl Way {
    fn arrived(&mut self, octets: u64, round_trip: Duration, shortest: Duration) {
        self.count(octets, 0.0);
        self.is_longer = round_trip > shortest + shortest / 4 + SLACK;
    }

    fn lost(&mut self, octets: u64) {
        self.count(octets, 1.0);
    }

    fn count(&mut self, octets: u64, lost: f64) {
        let weight = (octets as f64 / SPAN).min(1.0);
        self.lost += weight * (lost - self.lost);
    }

    /// Whether too much is sent, as far as that can be told.
    fn is_full(&self) -> bool {
        self.is_longer || self.lost > LOSSES
    }
}

impl Controller for Patient {
    fn on_sent(&mut self, now: Instant, octets: u64, last: u64) {
        self.cubic.on_sent(now, octets, last);
    }

    fn on_ack(
        &mut self,
        now: Instant,
        sent: Instant,
        octets: u64,
        app_limited: bool,
        rtt: &RttEstimator,
    ) {
        self.way.arrived(octets, rtt.get(), rtt.min());
        self.cubic.on_ack(now, sent, octets, app_limited, rtt);
    }

    fn on_end_acks(&mut self, now: Instant, under_way: u64, app_limited: bool, last: Option<u64>) {
        self.cubic.on_end_acks(now, under_way, app_limited, last);
    }

    fn on_congestion_event(&mut self, now: Instant, sent: Instant, all_lost: bool, octets: u64) {
        self.way.lost(octets);
        // A router that marks packets has told of its queue, and lost none.
        if octets == 0 || all_lost || self.way.is_full() {
            self.cubic.on_congestion_event(now, sent, all_lost, octets);
        }
    }

    fn on_mtu_update(&mut self, mtu: u16) {
        self.cubic.on_mtu_update(mtu);
    }

    fn window(&self) -> u64 {
        self.cubic.window()
    }

    fn metrics(&self) -> ControllerMetrics {
        self.cubic.metrics()
    }

    fn clone_box(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }

    fn initial_window(&self) -> u64 {
        self.cubic.initial_window()
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKET: u64 = 1200;
    const SHORTEST: Duration = Duration::from_millis(20);

    /// A path on which of so many packets every so-many-th is lost, and whose round trips take so
    /// long.
    fn way(packets: u64, every: u64, round_trip: Duration) -> Way {
        let mut way = Way::default();
        for packet in 1..=packets {
            match packet % every {
                0 => way.lost(PACKET),
                _ => way.arrived(PACKET, round_trip, SHORTEST),
            }
        }
        way
    }

    /// How much may be under way after a packet was lost on this path.
    fn after_a_loss(way: Way) -> (u64, u64) {
        let now = Instant::now();
        let cubic = Cubic::new(Arc::new(CubicConfig::default()), now, PACKET as u16);
        let before = cubic.window();
        let mut patient = Patient { cubic, way };
        patient.on_congestion_event(now, now, false, PACKET);
        (before, patient.window())
    }

    #[test]
    fn as_much_is_sent_as_before_when_a_radio_loses_a_packet() {
        for every in [5, 20, 100] {
            let (before, after) = after_a_loss(way(1000, every, SHORTEST));
            assert_eq!(after, before, "one of {every}");
        }
    }

    #[test]
    fn less_is_sent_when_packets_wait_in_a_queue() {
        let (before, after) = after_a_loss(way(1000, 100, 2 * SHORTEST));
        assert!(after < before);
    }

    #[test]
    fn less_is_sent_when_more_is_lost_than_by_a_radio() {
        let (before, after) = after_a_loss(way(1000, 3, SHORTEST));
        assert!(after < before);
    }

    #[test]
    fn less_is_sent_when_a_router_asks_for_it_or_nothing_arrives() {
        let now = Instant::now();
        for (all_lost, octets) in [(false, 0), (true, PACKET)] {
            let mut controller = Arc::new(Patience).build(now, PACKET as u16);
            let before = controller.window();
            controller.on_congestion_event(now, now, all_lost, octets);
            assert!(controller.window() < before);
        }
    }
}
