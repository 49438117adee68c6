//! The options of the daemon, merged from four sources.
//!
//! ```text
//!   command line ──┐
//!   --config FILE ─┼── Layer: what one source says ── merged, strongest first ── Options
//!   FIPAD_… ───────┤
//!   defaults ──────┘
//! ```
//!
//! **Knows** names, values and precedence of the options. **Never knows** what they do; nothing
//! is opened here but the configuration file.

mod command_line;
mod environment;
mod error;
mod layer;
pub(crate) mod value;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::PathBuf;

use fipa::{Fingerprint, OutboxConfig, Rules};
use fipa_directory::Address;
use fipa_dsd::{DEFAULT_AGENTS, InterfaceSelector, MDNS_PORT};
use fipa_gateway::HiacNames;
use hiac::links::Endpoint as HiacEndpoint;
use hiac::station::{Role, Workgroup};
use robot_text::links::Endpoint;

pub use crate::config_file::DEFAULT_CONFIG;
pub use error::OptionsError;
pub(crate) use layer::Layer;

use crate::config_file;
use crate::text::datagram_address;
use command_line::{CommandLine, Parsed, Subcommand};

/// What the daemon is to do, every option with its final value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// The name of the message transport service, an ASCII word; without it the daemon makes one
    /// from the host name.
    pub name: Option<String>,
    /// The endpoints to listen on, at least one; port 0 takes a free port.
    pub listen: Vec<Address>,
    /// Where letters are taken over HTTP, as `HOST:PORT`, if they are.
    pub http: Option<String>,
    /// The path of the URL under which they are posted; it begins with a slash.
    pub http_path: String,
    /// What is told to others in place of the endpoints; empty: the endpoints themselves. No port
    /// is 0.
    pub advertise: Vec<Address>,
    /// Only daemons of the same scope talk to each other; short enough to be announced.
    pub scope: String,
    /// The folder of the fleet; without it the usual one, if this machine is in a fleet there.
    pub fleet: Option<PathBuf>,
    /// Who is let in; without it, robots of the fleet where there is one, else everybody.
    pub fleet_mode: Option<FleetMode>,
    /// The certificates that are let in, where only those are.
    pub pinned: Vec<Fingerprint>,
    /// Whether an endpoint beyond loopback needs a fleet.
    pub require_fleet: bool,
    /// Who may send to whom, and who may register.
    pub rules: Rules,
    /// Where mDNS is spoken; empty: decided by the endpoints.
    pub interface: Vec<InterfaceSelector>,
    /// Whether mDNS is left alone altogether.
    pub no_mdns: bool,
    /// How many agents are announced to C++ robots at most; 0 announces none.
    pub mdns_agents: usize,
    /// The UDP port of mDNS, not 0.
    pub mdns_port: u16,
    /// Daemons to connect to without being discovered. No port is 0.
    pub peer: Vec<Address>,
    /// The Unix socket on which local programs attach.
    pub control: PathBuf,
    /// Whether standard output carries JSON.
    pub json: bool,
    /// The resources that the daemon lends; none is empty or has a line break.
    pub owns: Vec<String>,
    /// Where HIAC stations are.
    pub hiac: Vec<HiacEndpoint>,
    /// The HIAC address of the daemon and the mask of its workgroup; always there with `hiac`.
    pub hiac_address: Option<Workgroup>,
    /// What HIAC devices are called, and which agents they know.
    pub hiac_names: HiacNames,
    /// Where agents of the text format are.
    pub text: Vec<Endpoint>,
    /// Agents of the text format that are in the directory for good, and where they are: one of
    /// `text`, or the address for datagrams to the agent.
    pub text_agents: BTreeMap<String, Endpoint>,
    /// The file to which what passes is written, if any.
    pub log_letters: Option<PathBuf>,
    /// Octets of the largest letter that is taken, at least 1.
    pub max_letter: usize,
    /// The directory for what survives a restart: letters for robots that are away, and the numbers
    /// of what `owns` lends. Without it nothing does.
    pub state: Option<PathBuf>,
    /// How many letters are stored there, and for how long.
    pub outbox: OutboxConfig,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            name: None,
            listen: vec![Address::tcp("127.0.0.1", 0)],
            http: None,
            http_path: "/acc".to_owned(),
            advertise: Vec::new(),
            scope: String::new(),
            fleet: None,
            fleet_mode: None,
            pinned: Vec::new(),
            require_fleet: false,
            rules: Rules::default(),
            interface: Vec::new(),
            no_mdns: false,
            mdns_agents: DEFAULT_AGENTS,
            mdns_port: MDNS_PORT,
            peer: Vec::new(),
            control: fipa::default_control_path(),
            json: false,
            owns: Vec::new(),
            hiac: Vec::new(),
            hiac_address: None,
            hiac_names: HiacNames::default(),
            text: Vec::new(),
            text_agents: BTreeMap::new(),
            log_letters: None,
            max_letter: 256 << 20,
            state: None,
            outbox: OutboxConfig::default(),
        }
    }
}

/// Who is let in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FleetMode {
    /// Everybody.
    Open,
    /// Robots of the fleet.
    Fleet,
    /// Those robots of the fleet whose certificates are listed.
    Pinned,
}

/// What a command line asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Invocation {
    /// Run the daemon.
    Run(Box<Options>),
    /// Show the tour.
    Demo,
    /// Print [`DEFAULT_CONFIG`].
    Config,
    /// Print this text, help or version, as it is.
    Help(String),
}

/// Reads a command line, the program's name first, and what it leaves open from the
/// configuration file and from the environment.
///
/// `env` tells the value of an environment variable. A value that is not Unicode should be passed
/// with replacement characters rather than as absent, so that it is noticed.
///
/// ```
/// use fipa_daemon::options::{Invocation, parse};
/// let line = ["fipad", "--listen", "0.0.0.0:4100"];
/// let env = |name: &str| (name == "FIPAD_SCOPE").then(|| "plant".to_owned());
/// let Ok(Invocation::Run(options)) = parse(line.map(Into::into).into_iter(), env) else {
///     panic!("the daemon is to run");
/// };
/// assert_eq!(options.listen[0].to_string(), "tcp://0.0.0.0:4100");
/// assert_eq!(options.scope, "plant");
/// ```
pub fn parse(
    args: impl Iterator<Item = OsString>,
    env: impl Fn(&str) -> Option<String>,
) -> Result<Invocation, OptionsError> {
    let line = match CommandLine::read(args)? {
        Parsed::Text(text) => return Ok(Invocation::Help(text)),
        Parsed::Line(line) => line,
    };
    match line.command {
        Some(Subcommand::Demo) => Ok(Invocation::Demo),
        Some(Subcommand::Config) => Ok(Invocation::Config),
        None => merged(*line, env).map(|options| Invocation::Run(Box::new(options))),
    }
}

fn merged(
    line: CommandLine,
    env: impl Fn(&str) -> Option<String>,
) -> Result<Options, OptionsError> {
    let file = match line.config.or_else(|| environment::config(&env)) {
        Some(path) => config_file::load(&path)?,
        None => Layer::default(),
    };
    let variables = environment::layer(&env)?;
    let options = line.options.over(file).over(variables).into_options();
    check_hiac(&options).map_err(OptionsError::Usage)?;
    check_text(&options).map_err(OptionsError::Usage)?;
    check_pinned(&options).map_err(OptionsError::Usage)?;
    Ok(options)
}

/// Certificates are listed if and only if that is who is let in.
fn check_pinned(options: &Options) -> Result<(), String> {
    let mode = options.fleet_mode == Some(FleetMode::Pinned);
    match (mode, options.pinned.is_empty()) {
        (true, true) => Err("--fleet-mode pinned needs --pinned, a fingerprint".to_owned()),
        (false, false) => Err("--pinned needs --fleet-mode pinned".to_owned()),
        _ => Ok(()),
    }
}

/// What only all sources together can get wrong.
fn check_hiac(options: &Options) -> Result<(), String> {
    let Some(group) = options.hiac_address else {
        return match options.hiac.first() {
            None => Ok(()),
            Some(url) => Err(format!(
                "{url} needs --hiac-address, the own address and mask"
            )),
        };
    };
    let employees = options
        .hiac
        .iter()
        .filter(|endpoint| endpoint.role == Role::Employer);
    let given = employees.filter_map(|endpoint| endpoint.address);
    let mut devices = given.chain(options.hiac_names.aliases.keys().copied());
    let fits = |address: &hiac::Address| {
        let level = group.mask.level(*address);
        group.mask.address(group.address, level) == Some(*address)
            && (1..group.mask.broadcast()).contains(&level)
    };
    match devices.find(|address| !fits(address)) {
        None => Ok(()),
        Some(address) => Err(format!(
            "{address} is no address of the workgroup of {} under {}",
            group.address, group.mask
        )),
    }
}

/// A configured agent is where the daemon has a socket or a line.
fn check_text(options: &Options) -> Result<(), String> {
    let has_socket = options
        .text
        .iter()
        .any(|place| matches!(place, Endpoint::Udp(_)));
    let reached = |place: &Endpoint| match place {
        Endpoint::Udp(_) => has_socket && datagram_address(place).is_some_and(|at| at.port() != 0),
        _ => options.text.contains(place),
    };
    match options.text_agents.iter().find(|(_, at)| !reached(at)) {
        None => Ok(()),
        Some((name, place @ Endpoint::Udp(_))) => Err(format!(
            "the text agent {name} at {place} needs an IP address and a port, and a udp:// place \
             of --text to send from"
        )),
        Some((name, place)) => Err(format!(
            "the text agent {name} is at {place}, which is no place of --text"
        )),
    }
}
