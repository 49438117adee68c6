//! The same work on fipad, zenoh, NATS, ZeroMQ and gRPC: letters from one program to another, with
//! a process in the middle.
//!
//! ```text
//! source ──▶ middle ──▶ sink      letters that arrive a second, and what the middle takes for each
//! asker ───▶ middle ──▶ echo      there and back, one by one
//!       ◀───        ◀───
//! ```
//!
//! Run it on a machine that does nothing else; it takes about two minutes:
//!
//! ```text
//! cargo run --release --manifest-path benches/peers/Cargo.toml [zenoh] [nats] [zeromq] [grpc]
//! ```
//!
//! It builds zenoh, and libzmq with the C++ compiler of the system. The server of NATS is that of
//! the system (Debian: `nats-server`); without it NATS is skipped.
//!
//! What is the same for all: both ends are in this process, each with its own connection over
//! loopback TCP (agents: over the Unix socket of the daemon) and its own thread, the middle is a
//! process of its own, all that is Rust is built alike, settings are the usual ones except where
//! the code says why. A letter's content is counted when its sink has it. Only content is of the
//! size that is told: names, envelopes and heads come on top.
//!
//! What is not the same is what each of them guarantees, and does for it:
//!
//! - fipad: every letter has an envelope with sender, receiver, date and outcome; the sender learns
//!   of each one whether it was delivered. `agents` is the library at both ends, where messages are
//!   encoded, decoded and sorted: to be compared with the libraries of the others. `bare ends`
//!   write and confirm letters that they have ready: what the daemon alone can do, no rival's ends
//!   are spared like that.
//! - zenoh: reliable and in order from hop to hop, blocking; the sender learns nothing.
//! - NATS: at most once, whoever does not keep up loses messages. The window that prevents it is
//!   this program's, kept with counters in memory.
//! - ZeroMQ: PUSH and PULL through a proxy, in order and blocking; no names, no outcomes. REQ and
//!   REP there and back.
//! - gRPC: a client's stream to a server that passes it on to another one's; in order and blocking.

mod compare;
mod end;
mod middle;
mod peers;

use std::process::ExitCode;

use compare::Field;
use peers::{Agents, Bare, Grpc, Nats, Peer, Zenoh, ZeroMq};

/// Starts one of them, or says what that needs.
type Start = fn() -> Result<Box<dyn Peer>, &'static str>;

/// Those that ours are compared with.
const RIVALS: [(&str, Start); 4] = [
    ("zenoh", || Ok(Box::new(Zenoh::start()))),
    ("nats", || Ok(Box::new(Nats::start().ok_or("nats-server")?))),
    ("zeromq", || Ok(Box::new(ZeroMq::start()))),
    ("grpc", || Ok(Box::new(Grpc::start()))),
];

/// Octets of content, one way.
const ONE_WAY: [usize; 3] = [256, 1 << 10, 64 << 10];

/// Octets of content, there and back.
const THERE_AND_BACK: usize = 100;

fn main() -> ExitCode {
    if fipa_benches::daemons::is_daemon() {
        return fipa_daemon::main();
    }
    match middle::name().as_deref() {
        Some("zenoh") => peers::zenoh::route(),
        Some("zeromq") => peers::zeromq::proxy(),
        Some("grpc") => peers::grpc::relay(),
        Some(other) => panic!("no middle is called {other}"),
        None => compare(),
    }
    ExitCode::SUCCESS
}

fn compare() {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let rivals = RIVALS.iter();
    let rivals = rivals.filter(|(name, _)| wanted.is_empty() || wanted.iter().any(|w| w == name));
    let started = rivals.filter_map(|(_, start)| match start() {
        Ok(rival) => Some(rival),
        Err(needs) => {
            println!("skipped: needs {needs}");
            None
        }
    });
    let rivals: Vec<_> = started.collect();
    if rivals.is_empty() {
        return println!("skipped: needs one at least to compare with");
    }
    let mut field = Field {
        rivals,
        agents: Box::new(Agents::start()),
        bare: Box::new(Bare::start()),
    };
    for octets in ONE_WAY {
        field.one_way(octets);
    }
    field.round_trips(THERE_AND_BACK);
}
