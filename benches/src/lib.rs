//! What the benches have in common: daemons as processes, and plain sockets to compare with.

pub mod daemons;
pub mod plain;
pub mod table;
