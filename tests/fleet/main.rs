//! Fleets: who is let in, and what others are told.

#[path = "../support/mod.rs"]
mod support;

mod over_quic;
mod place;
mod readme;
mod rules;
mod stranger;
mod strangers;
mod without;
