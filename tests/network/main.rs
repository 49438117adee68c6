//! Several daemons: how they find each other, what reaches whom, and what happens when one goes.

#[path = "../support/mod.rs"]
mod support;

mod attacks;
mod cpp;
mod doctor;
mod ending;
mod faults;
mod hiac;
mod hostile;
mod inside;
mod joining;
mod load;
mod losing;
mod names;
mod outbox;
mod patterns;
mod peers;
mod quic;
mod radio;
mod rates;
mod roaming;
mod text;
mod wires;
