//! `fipad` with UDT: it takes `--listen udt://HOST:PORT` beside its other endpoints, and sends to
//! agents of C++ robots at such addresses.
//!
//! ```text
//! cargo run --example fipad-udt -- --listen tcp://0.0.0.0:4100 --listen udt://0.0.0.0:4101
//! ```

use std::process::ExitCode;
use std::sync::Arc;

use fipa_udt::UdtTransport;

fn main() -> ExitCode {
    fipa_daemon::main_with(&[Arc::new(UdtTransport::new())])
}
