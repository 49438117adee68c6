use fipa_acl::Text;
use fipa_directory::{Entry, InstanceId};

/// How many agents a daemon announces to its C++ neighbours if it is not told otherwise.
///
/// A robot that joins late has to take in all announcements of a network at once, and beyond some
/// thousand of them its socket loses most.
pub const DEFAULT_AGENTS: usize = 200;

/// An agent that was found in the distributed directory of the C++ `fipa_services`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiscoveredAgent {
    /// The daemon that announces it, where one of this program does.
    pub instance: Option<InstanceId>,
    /// What was announced. The locations are those that this host may use, in the order of
    /// trying; the timestamp is 0 where none was told that can be read.
    pub entry: Entry,
}

/// Why an agent is not announced to C++ neighbours. Over a link it is known all the same.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LeftOut {
    /// The scope of the daemon does not make a DNS-SD service type.
    #[error(
        "the scope is no DNS-SD service type: C++ neighbours need a scope of at most 30 letters, \
         digits, `-` and `_`"
    )]
    Scope,
    /// The name does not fit into a label of DNS.
    #[error("the name has {0} octets; C++ neighbours can be told names of 1 to 63 octets")]
    NameLength(usize),
    /// Another agent of this daemon has the same label: C++ neighbours tell neither capital from
    /// small letters nor `.` from `?`.
    #[error("to C++ neighbours the name is the same as that of `{0}`")]
    NameTaken(Text),
    /// No location is left that another host could use.
    #[error("no location of it can be reached from where mDNS is spoken")]
    NoLocation,
    /// The service type alone is longer than an announcement may be.
    #[error("its service type does not fit into an announcement of 1300 octets")]
    TooLong,
    /// As many agents as allowed are announced already. It is announced when one of them leaves.
    #[error("{0} agents are announced already, which is the limit")]
    Limit(usize),
}

/// Which agents of a daemon are announced to C++ neighbours, and which are not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AgentsReport {
    /// How many are announced.
    pub announced: usize,
    /// How many wait until one of the announced leaves.
    pub waiting: usize,
    /// Those that cannot be announced, by name.
    pub left_out: Vec<(Text, LeftOut)>,
    /// Those announced with fewer locations or a shorter description than they have, by name.
    pub shortened: Vec<Text>,
}
