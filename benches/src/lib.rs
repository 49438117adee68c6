//! What the benches have in common: daemons as processes, plain sockets to compare with, and the
//! codecs' operations beside those of rivals.

pub mod daemons;
pub mod messages;
pub mod operations;
pub mod partner;
pub mod plain;
pub mod relay;
pub mod rivals;
pub mod rounds;
pub mod table;
