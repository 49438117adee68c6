use std::net::SocketAddr;

use fipa_directory::InstanceId;

/// What was learned about the other daemons.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DiscoveryEvent {
    /// A daemon is there, or its name or addresses are no longer those reported before.
    Found(DiscoveredPeer),
    /// A daemon said goodbye, or could not be reached any more.
    Lost(InstanceId),
    /// Discovery may be impaired; the text is for the log.
    Warning(String),
}

/// A daemon that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiscoveredPeer {
    /// The identity of that run of the daemon.
    pub instance: InstanceId,
    /// Its name, for people; possibly cut, possibly given to several daemons.
    pub name: String,
    /// Where it may be reached, in the order in which it should be tried: loopback, IPv4, IPv6,
    /// link-local IPv6 (with the scope id of the interface it was heard on). Never empty. Some
    /// may be stale, and a link-local address may belong to another interface of that host.
    pub addresses: Vec<SocketAddr>,
}
