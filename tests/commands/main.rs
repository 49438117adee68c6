//! The commands of the tool, as other programs script them.

#[path = "../support/mod.rs"]
mod support;

mod agents;
mod attach;
mod bench;
mod echo;
mod hiac;
mod key;
mod listen;
mod ping;
mod protocol;
mod send;
mod sniff;
mod text;
mod translate;
