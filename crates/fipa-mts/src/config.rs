use std::time::Duration;

use fipa_acl::Text;
use fipa_codec::Limits;
use fipa_directory::{Address, InstanceId};

use crate::{OutboxConfig, Rules};

/// What a message transport service is made with.
#[derive(Clone, Debug)]
pub struct Config {
    /// This run; drawn at random by the caller.
    pub instance: InstanceId,
    /// The service's name.
    pub name: Text,
    /// The fleet; links to other fleets are refused.
    pub scope: Text,
    /// The robots of the fleet that are known from the beginning, where there is a fleet key: then
    /// links are only with robots that prove their names.
    pub fleet: Option<Vec<Text>>,
    /// Who may send to whom, and who may register.
    pub rules: Rules,
    /// Where others reach it, as they are told.
    pub endpoints: Vec<Address>,
    /// The UDP port at which mDNS is spoken for it, if it is; for people who look for a fault.
    pub mdns_port: Option<u16>,
    /// The URLs under which letters are posted to it over HTTP, as others are told.
    pub http: Vec<Address>,
    /// The schemes of the addresses to which letters are handed over one by one, by transports that
    /// its host has plugged in.
    pub schemes: Vec<Text>,
    /// Octets of the largest letter.
    pub max_letter: usize,
    /// What the decoder of envelopes accepts.
    pub limits: Limits,
    /// How long the outcome of a letter is waited for, however long its sender would.
    pub longest_wait: Duration,
    /// How long a peer whose link broke may take to come back before its agents are removed.
    pub grace: Duration,
    /// Letters that wait in one mailbox at most.
    pub mailbox_letters: usize,
    /// Octets that wait for one peer or in one mailbox at most.
    pub queue_octets: usize,
    /// Connections that others may have open with us, programs of this host aside.
    pub max_connections: usize,
    /// Those of one address among them.
    pub max_connections_an_address: usize,
    /// What is stored for robots that are away; `None`: nothing. The host must do what
    /// [`Output::Store`](crate::Output::Store) asks for.
    pub outbox: Option<OutboxConfig>,
    /// Seed of the jitter.
    pub seed: u64,
}

impl Config {
    /// The usual settings for a service of this name.
    pub fn new(instance: InstanceId, name: impl Into<Text>) -> Config {
        let octets = instance.as_bytes();
        let seed = octets
            .iter()
            .fold(0, |seed: u64, o| seed.rotate_left(8) ^ u64::from(*o));
        Config {
            instance,
            name: name.into(),
            scope: Text::default(),
            fleet: None,
            rules: Rules::default(),
            endpoints: Vec::new(),
            mdns_port: None,
            http: Vec::new(),
            schemes: Vec::new(),
            max_letter: 256 << 20,
            limits: Limits::default(),
            longest_wait: Duration::from_secs(600),
            grace: Duration::from_secs(2),
            mailbox_letters: 10_000,
            queue_octets: 64 << 20,
            max_connections: 4096,
            max_connections_an_address: 1024,
            outbox: None,
            seed,
        }
    }
}

/// What the program's end of a control link is made with.
#[derive(Clone, Debug)]
pub struct ProgramConfig {
    /// This run; drawn at random by the caller.
    pub instance: InstanceId,
    /// What the daemon may call the program in its log.
    pub name: Text,
    /// The daemon's control socket.
    pub control: Address,
    /// How long a lost daemon is looked for before the program gives up.
    pub patience: Duration,
    /// Octets of the largest letter.
    pub max_letter: usize,
    /// What the decoder of envelopes accepts.
    pub limits: Limits,
    /// Letters that wait in one mailbox at most.
    pub mailbox_letters: usize,
    /// Octets that wait in one mailbox at most.
    pub queue_octets: usize,
    /// Whether the directory is wanted.
    pub watch: bool,
}

impl ProgramConfig {
    /// The usual settings.
    pub fn new(instance: InstanceId, name: impl Into<Text>, control: Address) -> ProgramConfig {
        ProgramConfig {
            instance,
            name: name.into(),
            control,
            patience: Duration::from_secs(30),
            max_letter: 256 << 20,
            limits: Limits::default(),
            mailbox_letters: 10_000,
            queue_octets: 64 << 20,
            watch: true,
        }
    }
}
