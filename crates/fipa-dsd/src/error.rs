use std::io;
use std::net::SocketAddr;

use fipa_acl::Text;
use fipa_directory::InstanceId;

use crate::InterfaceSelector;

/// Why multicast DNS could not be started or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MdnsError {
    /// No endpoint was given, so there is nothing to announce.
    #[error("no listening endpoint to announce")]
    NoEndpoint,
    /// The endpoint has port 0: announced is what is listened on, not what was asked for.
    #[error("endpoint {0} has no port")]
    EndpointWithoutPort(SocketAddr),
    /// The mDNS port is 0.
    #[error("0 is not an mDNS port")]
    NoPort,
    /// The scope does not fit into a TXT string. It is not cut, because it must be compared whole.
    #[error("the scope has {length} bytes; at most {most} fit into an announcement")]
    ScopeTooLong {
        /// Length of the scope in bytes.
        length: usize,
        /// The greatest length in bytes.
        most: usize,
    },
    /// The interfaces of this host could not be listed.
    #[error("cannot list the network interfaces")]
    Interfaces(#[source] io::Error),
    /// A selector matches none of the interfaces that are up.
    #[error("no interface matches `{selector}`; there are: {available}")]
    NoInterface {
        /// The selector that matches nothing.
        selector: InterfaceSelector,
        /// The interfaces that could have been chosen, with their addresses.
        available: String,
    },
    /// The UDP port cannot be shared with whoever holds it, or may not be opened.
    #[error("cannot open UDP port {port} for mDNS")]
    Socket {
        /// The UDP port.
        port: u16,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// Nothing went out: none of the interfaces mDNS is spoken on holds a listening address, or
    /// none of them lets us join the multicast group.
    #[error("nothing could be announced on any interface; there are: {available}")]
    NotAnnounced {
        /// The interfaces that were there, with their addresses.
        available: String,
    },
    /// The mDNS machinery refused, in its own words.
    #[error("mDNS: {0}")]
    Refused(String),
    /// The mDNS machinery is overloaded and took no further command.
    #[error("mDNS is overloaded")]
    Busy,
    /// The mDNS machinery has stopped.
    #[error("mDNS has stopped")]
    Stopped,
    /// No such daemon is known at present.
    #[error("daemon {0} is not known to mDNS")]
    UnknownPeer(InstanceId),
    /// No such agent is announced at present.
    #[error("agent {0} is not known to mDNS")]
    UnknownAgent(Text),
}
