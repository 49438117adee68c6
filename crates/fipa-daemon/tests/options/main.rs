//! The options of the daemon: where they come from, and what is said about wrong ones.

mod errors;
mod given;
mod invocations;
mod sources;
