//! The commands, one a module: `Args` are its options, `run` is the command on the streams of the
//! process.

pub mod agents;
pub mod ams;
pub mod attach;
pub mod bench;
pub mod decode;
pub mod df;
pub mod doctor;
pub mod echo;
pub mod encode;
pub mod hiac;
pub mod key;
pub mod listen;
pub mod lock;
pub mod ping;
pub mod platform;
pub mod protocol;
pub mod send;
pub mod sniff;
pub mod text;
