use std::collections::BTreeMap;
use std::path::PathBuf;

use fipa::{Fingerprint, OutboxConfig, Rules};
use fipa_directory::Address;
use fipa_dsd::InterfaceSelector;
use fipa_gateway::HiacNames;
use hiac::links::Endpoint as HiacEndpoint;
use hiac::station::Workgroup;
use robot_text::links::Endpoint;

use super::{FleetMode, Options, value};

/// What one source says; `None` where it says nothing.
///
/// As the options of the command line it is the one list of all options: their long names are the
/// keys of the configuration file and, in capitals, the environment variables.
#[derive(Debug, Default, clap::Args)]
pub(crate) struct Layer {
    /// The name of this daemon's message transport service [default: from the host name]
    // From a file it may be empty, which stands for the default and still beats weaker sources.
    #[arg(long, value_name = "NAME", value_parser = value::name)]
    pub(crate) name: Option<String>,
    /// An endpoint, tcp:// or quic://, repeatable; port 0 takes a free port [default:
    /// tcp://127.0.0.1:0]
    #[arg(long, value_name = "URL|HOST:PORT", value_parser = value::listen_address)]
    pub(crate) listen: Option<Vec<Address>>,
    /// Where letters are taken over HTTP, as JADE posts them; port 0 takes a free port [default:
    /// nowhere]
    #[arg(long, value_name = "HOST:PORT", value_parser = value::http_endpoint)]
    pub(crate) http: Option<String>,
    /// The path of the URL under which others post them [default: /acc]
    #[arg(long, value_name = "PATH", value_parser = value::http_path)]
    pub(crate) http_path: Option<String>,
    /// What others are told instead of the endpoints, repeatable
    #[arg(long, value_name = "URL", value_parser = value::peer_address)]
    pub(crate) advertise: Option<Vec<Address>>,
    /// The fleet; only daemons of the same scope talk to each other [default: none]
    #[arg(long, value_name = "NAME", value_parser = value::scope)]
    pub(crate) scope: Option<String>,
    /// The folder of the fleet [default: fipa/fleet in $XDG_CONFIG_HOME, if this machine joined one]
    // Empty in a file stands for the default.
    #[arg(long, value_name = "DIR")]
    pub(crate) fleet: Option<PathBuf>,
    /// Who is let in: open, fleet or pinned [default: fleet if this machine joined one, else open]
    #[arg(long, value_name = "MODE", value_parser = value::fleet_mode)]
    pub(crate) fleet_mode: Option<FleetMode>,
    /// The fingerprint of a certificate that is let in, repeatable; for --fleet-mode pinned
    #[arg(long, value_name = "FINGERPRINT", value_parser = value::fingerprint)]
    pub(crate) pinned: Option<Vec<Fingerprint>>,
    /// Refuse to listen beyond loopback without a fleet
    #[arg(long, num_args = 0, default_missing_value = "true")]
    pub(crate) require_fleet: Option<bool>,
    /// Who may send and register; from the file alone.
    #[arg(skip)]
    pub(crate) rules: Option<Rules>,
    /// Where mDNS is spoken, repeatable [default: where the endpoints are]
    #[arg(long, value_name = "NAME|CIDR", value_parser = value::interface)]
    pub(crate) interface: Option<Vec<InterfaceSelector>>,
    /// Neither announce this daemon by mDNS nor look for others
    #[arg(long, num_args = 0, default_missing_value = "true")]
    pub(crate) no_mdns: Option<bool>,
    /// How many agents are announced to C++ robots at most; 0 announces none [default: 200]
    #[arg(long, value_name = "N", value_parser = value::count_text)]
    pub(crate) mdns_agents: Option<usize>,
    /// The UDP port of mDNS [default: 5353]
    #[arg(long, value_name = "PORT", value_parser = value::port_text, hide = true)]
    pub(crate) mdns_port: Option<u16>,
    /// A daemon to connect to that mDNS does not find, repeatable
    #[arg(long, value_name = "URL", value_parser = value::peer_address)]
    pub(crate) peer: Option<Vec<Address>>,
    /// The Unix socket for local programs [default: fipad.sock in $XDG_RUNTIME_DIR]
    // As for the name, empty in a file stands for the default.
    #[arg(long, value_name = "PATH")]
    pub(crate) control: Option<PathBuf>,
    /// Print JSON, one object a line
    #[arg(long, num_args = 0, default_missing_value = "true")]
    pub(crate) json: Option<bool>,
    /// A resource that the daemon owns, and lends to one agent at a time, repeatable; its numbers
    /// are kept under --state
    #[arg(long, value_name = "RESOURCE", value_parser = value::resource)]
    pub(crate) owns: Option<Vec<String>>,
    /// Where HIAC stations are, repeatable: tcp://HOST:PORT[?listen], tls:// with ca=FILE or
    /// cert=FILE&key=FILE, or serial:///dev/...?baud=115200; with address=A or role=employee
    /// behind ? or &
    #[arg(long, value_name = "URL", value_parser = value::hiac_endpoint)]
    pub(crate) hiac: Option<Vec<HiacEndpoint>>,
    /// The own HIAC address, and the mask of the workgroup that the daemon employs
    #[arg(long, value_name = "ADDRESS/MASK", value_parser = value::hiac_workgroup)]
    pub(crate) hiac_address: Option<Workgroup>,
    /// What HIAC devices are called; from the file alone.
    #[arg(skip)]
    pub(crate) hiac_names: Option<HiacNames>,
    /// Where agents of the text format are, repeatable: udp://HOST:PORT, tcp://HOST:PORT[?listen]
    /// or serial:///dev/...?baud=115200
    #[arg(long, value_name = "URL", value_parser = value::text_endpoint)]
    pub(crate) text: Option<Vec<Endpoint>>,
    /// Text agents that are there for good; from the file alone.
    #[arg(skip)]
    pub(crate) text_agents: Option<BTreeMap<String, Endpoint>>,
    /// A file that gets every letter that passes, as JSON [default: none]
    // As for the name, empty in a file stands for the default.
    #[arg(long, value_name = "FILE")]
    pub(crate) log_letters: Option<PathBuf>,
    /// The size of the largest letter that is taken [default: 268435456]
    #[arg(long, value_name = "BYTES", value_parser = value::letter_size_text)]
    pub(crate) max_letter: Option<usize>,
    /// The directory for letters to robots that are away, which are sent when those are back;
    /// without it none are stored [default: none]
    // As for the name, empty in a file stands for the default.
    #[arg(long, value_name = "DIR")]
    pub(crate) state: Option<PathBuf>,
    /// The table of the file that has no option.
    #[arg(skip)]
    pub(crate) outbox: Option<OutboxConfig>,
}

impl Layer {
    /// What this source says, and where it says nothing, what the weaker one says.
    pub(crate) fn over(self, weaker: Layer) -> Layer {
        Layer {
            name: self.name.or(weaker.name),
            listen: self.listen.or(weaker.listen),
            http: self.http.or(weaker.http),
            http_path: self.http_path.or(weaker.http_path),
            advertise: self.advertise.or(weaker.advertise),
            scope: self.scope.or(weaker.scope),
            fleet: self.fleet.or(weaker.fleet),
            fleet_mode: self.fleet_mode.or(weaker.fleet_mode),
            pinned: self.pinned.or(weaker.pinned),
            require_fleet: self.require_fleet.or(weaker.require_fleet),
            rules: self.rules.or(weaker.rules),
            interface: self.interface.or(weaker.interface),
            no_mdns: self.no_mdns.or(weaker.no_mdns),
            mdns_agents: self.mdns_agents.or(weaker.mdns_agents),
            mdns_port: self.mdns_port.or(weaker.mdns_port),
            peer: self.peer.or(weaker.peer),
            control: self.control.or(weaker.control),
            json: self.json.or(weaker.json),
            owns: self.owns.or(weaker.owns),
            hiac: self.hiac.or(weaker.hiac),
            hiac_address: self.hiac_address.or(weaker.hiac_address),
            hiac_names: self.hiac_names.or(weaker.hiac_names),
            text: self.text.or(weaker.text),
            text_agents: self.text_agents.or(weaker.text_agents),
            log_letters: self.log_letters.or(weaker.log_letters),
            max_letter: self.max_letter.or(weaker.max_letter),
            state: self.state.or(weaker.state),
            outbox: self.outbox.or(weaker.outbox),
        }
    }

    /// The options, with the defaults where nothing was said.
    pub(crate) fn into_options(self) -> Options {
        let default = Options::default();
        let is_given = |path: &PathBuf| !path.as_os_str().is_empty();
        let control = self.control.filter(is_given);
        Options {
            name: self.name.filter(|name| !name.is_empty()),
            listen: self.listen.unwrap_or(default.listen),
            http: self.http.filter(|endpoint| !endpoint.is_empty()),
            http_path: self.http_path.unwrap_or(default.http_path),
            advertise: self.advertise.unwrap_or(default.advertise),
            scope: self.scope.unwrap_or(default.scope),
            fleet: self.fleet.filter(|path| !path.as_os_str().is_empty()),
            fleet_mode: self.fleet_mode,
            pinned: self.pinned.unwrap_or(default.pinned),
            require_fleet: self.require_fleet.unwrap_or(default.require_fleet),
            rules: self.rules.unwrap_or(default.rules),
            interface: self.interface.unwrap_or(default.interface),
            no_mdns: self.no_mdns.unwrap_or(default.no_mdns),
            mdns_agents: self.mdns_agents.unwrap_or(default.mdns_agents),
            mdns_port: self.mdns_port.unwrap_or(default.mdns_port),
            peer: self.peer.unwrap_or(default.peer),
            control: control.unwrap_or(default.control),
            json: self.json.unwrap_or(default.json),
            owns: self.owns.unwrap_or(default.owns),
            hiac: self.hiac.unwrap_or(default.hiac),
            hiac_address: self.hiac_address.or(default.hiac_address),
            hiac_names: self.hiac_names.unwrap_or(default.hiac_names),
            text: self.text.unwrap_or(default.text),
            text_agents: self.text_agents.unwrap_or(default.text_agents),
            log_letters: self.log_letters.filter(is_given),
            max_letter: self.max_letter.unwrap_or(default.max_letter),
            state: self.state.filter(|path| !path.as_os_str().is_empty()),
            outbox: self.outbox.unwrap_or(default.outbox),
        }
    }
}
