//! The distributed service directory: how the daemons of several robots find each other.
//!
//! Every daemon announces one service instance by multicast DNS and listens for those of the
//! others. What it learns is only who is there and at which addresses; the directory of agents is
//! told over the link that is opened to such an address.
//!
//! Only the module `mdns` knows which library speaks mDNS; no type of that library is public.
mod config;
mod error;
mod event;
mod interface;
mod mdns;

pub use config::{InterfaceSelector, MDNS_PORT, MdnsConfig, ParseSelectorError, free_mdns_port};
pub use error::MdnsError;
pub use event::{DiscoveredPeer, DiscoveryEvent};
pub use mdns::Mdns;
