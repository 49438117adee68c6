//! The keys of the TXT record.

/// The instance id, 32 hexadecimal digits. Without it an entry is not resolved yet.
pub(super) const ID: &str = "id";
/// The name of the daemon, for people.
pub(super) const NAME: &str = "name";
/// The scope: other scopes are ignored.
pub(super) const SCOPE: &str = "scope";
/// The UDP port of QUIC, where that is spoken.
pub(super) const QUIC: &str = "quic";
/// The version of this record.
pub(super) const VERSION: &str = "v";
/// The version written and understood here.
pub(super) const CURRENT_VERSION: &str = "1";

/// How many bytes of value fit beside `key` into one TXT string of 255 bytes.
pub(super) const fn room(key: &str) -> usize {
    255 - key.len() - 1
}
