use std::net::SocketAddr;

use fipa_acl::Text;
use fipa_directory::InstanceId;

use crate::DiscoveredAgent;

/// What was learned about the other daemons, and about agents in the directory of C++ robots.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DiscoveryEvent {
    /// A daemon is there, or its name or addresses are no longer those reported before.
    Found(DiscoveredPeer),
    /// A daemon said goodbye, or could not be reached any more.
    Lost(InstanceId),
    /// An agent is announced in the way of `fipa_services`, or its announcement is no longer that
    /// reported before. What this daemon announces itself is never reported.
    AgentFound(DiscoveredAgent),
    /// An agent that was reported is announced no longer.
    AgentGone {
        /// Its name.
        name: Text,
        /// The daemon that announced it, where one of this program did.
        instance: Option<InstanceId>,
    },
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
    /// The UDP port at which it speaks QUIC at these addresses, if it does.
    pub quic: Option<u16>,
}
