//! Locks with real daemons and commands: who holds what, and what becomes of it when somebody dies.

#[path = "../support/mod.rs"]
mod support;

mod command;
mod counting;
mod cpp;
mod dying;
mod robots;
