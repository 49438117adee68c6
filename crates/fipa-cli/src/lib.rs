//! The tool `fipa`: its commands, what they print and how they end.
//!
//! ```text
//!   main ── Cli (options) ── Command ── commands::{decode, encode}
//!                                            └── forms: the one place that knows the representations
//! ```
//!
//! **Knows** options, exit codes, files and standard streams. **Never knows** how a
//! representation or a JSON form looks.
//!
//! Each command has a function over octets in memory and a [`Write`](std::io::Write), and a thin
//! `run` that opens the files.

mod attached;
pub mod chart;
mod cli;
pub mod commands;
mod exit;
pub mod forms;
mod json_values;
mod sniffed;
mod streams;
mod times;
mod verdicts;

pub use cli::{Cli, Command, main, run};
pub use exit::Failure;
