//! For tests: machines on a simulated clock and network.
//!
//! ```text
//!   Sim ── queue of events ──▶ node: Mts | Program | robot ──▶ outputs
//!    │ clock                     ▲                        │ dial, transmit, close
//!    │ faults: crash, cut,       └── streams: latency, ◀──┘ outcomes, notices, mail: kept
//!    └ freeze, reset                 jitter, splits
//! ```
//!
//! **Knows** time, addresses, streams and what goes wrong with them. **Never knows** what the
//! octets mean. Nothing here waits: an hour of a fleet is a matter of its events. The same seed
//! gives the same run.
//!
//! ```
//! use std::time::Duration;
//! use fipa_sim::Sim;
//!
//! let mut sim = Sim::new(1);
//! let (one, two) = (sim.daemon("one"), sim.daemon("two"));
//! sim.register(one, "ping");
//! sim.register(two, "pong");
//! sim.discover_all();
//! sim.run_for(Duration::from_secs(1));
//! let ticket = sim.send(one, "ping", &["pong"], "hello");
//! sim.run_until_quiet(Duration::from_secs(1));
//! assert_eq!(sim.outcomes(one, ticket)[0].outcome.as_str(), "delivered");
//! assert_eq!(sim.contents(two, "pong"), ["hello"]);
//! ```

mod agents;
mod dial;
mod disk;
mod events;
mod faults;
mod net;
mod node;
mod nodes;
mod robot;
mod run;
mod sim;
mod write;

pub use net::Network;
pub use node::{Collected, NodeId, Told};
pub use robot::{Habit, Then};
pub use sim::Sim;
