//! Platforms like JADE's beside ours, over HTTP.

#[path = "../support/mod.rs"]
mod support;

mod agents;
mod fake;
mod load;
mod recordings;
mod refused;
mod replay;
mod tools;
