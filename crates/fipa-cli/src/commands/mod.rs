//! The commands, one a module: `Args` are its options, `run` is the command on the streams of the
//! process.

pub mod decode;
pub mod encode;
