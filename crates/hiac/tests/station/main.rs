//! Stations on simulated lines, with a simulated clock.

mod connection;
mod examples;
mod hierarchy;
mod net;
mod numbers;
mod permissions;
mod services;
