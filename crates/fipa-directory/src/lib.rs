//! The directory of agents: who is where, who says so, and how sure that is.
//!
//! **Knows** entries and their locations, exact and regular-expression search, which message
//! transport service vouches for an entry, and what changed. **Never knows** how an entry
//! travelled: time comes in as an argument, changes come out as values.
//!
//! ```
//! use fipa_directory::{Directory, Entry, Field, InstanceId, Now, Pattern, Source};
//!
//! let mut directory = Directory::new();
//! let robot2 = InstanceId::from_bytes([2; 16]);
//! directory.put(Now::default(), robot2, Source::Mdns, Entry::new("drive@robot2"));
//! let pattern = Pattern::new("drive@.*").unwrap();
//! let found: Vec<_> = directory.search(&pattern, Field::Name).collect();
//! assert_eq!(found[0].entry.name, "drive@robot2");
//! ```

mod address;
mod entry;
mod instance;
mod now;
mod pattern;
mod store;
mod tombstones;

pub use address::{Address, ParseAddressError};
pub use entry::{Entry, Location, MESSAGE_TRANSPORT, Record, Source, State};
pub use instance::{InstanceId, ParseInstanceIdError};
pub use now::Now;
pub use pattern::{Field, Pattern, PatternError};
pub use store::{Change, ChangeKind, Directory};
