use std::net::SocketAddr;
use std::path::PathBuf;
use std::slice::from_ref;
use std::sync::Arc;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId};
use fipa_dsd::{DEFAULT_AGENTS, InterfaceSelector, MDNS_PORT, MdnsConfig};
#[cfg(feature = "tls")]
use fipa_fleet::Membership;
use fipa_mts::{Config, Mts, OutboxConfig, Rules};
use fipa_outbox::Opened;
use fipa_transport::Listener;
#[cfg(feature = "tls")]
use fipa_transport::Tls;
use fipa_transport::http::HttpServer;

use crate::addresses::{self, reached_at, socket_address};
use crate::backend::Backend;
use crate::clock::Clock;
use crate::discovery::{self, Discovery};
use crate::http;
use crate::letters::{BoundPlugIn, LetterTransport, PlugIns};
use crate::management;
use crate::names::{self, NameLock};
use crate::node::{Hub, Node};
use crate::security::Security;
use crate::{Error, Platform};

/// A platform in this process, being described.
///
/// Without any setting it listens at a free port on loopback, finds other platforms on this
/// machine by mDNS, and bears a name made from the host's.
#[derive(Clone, Debug)]
pub struct PlatformBuilder {
    name: Option<String>,
    scope: String,
    listen: Vec<String>,
    advertise: Vec<String>,
    peers: Vec<String>,
    interfaces: Vec<InterfaceSelector>,
    mdns: bool,
    mdns_port: u16,
    mdns_agents: usize,
    control: Option<PathBuf>,
    max_letter: Option<usize>,
    state: Option<PathBuf>,
    outbox: OutboxConfig,
    http: Option<(String, String)>,
    rules: Rules,
    transports: PlugIns,
    #[cfg(feature = "tls")]
    fleet: Option<Arc<Membership>>,
}

/// Octets of the largest letter, unless told otherwise.
const MAX_LETTER: usize = 256 << 20;

impl PlatformBuilder {
    pub(crate) fn new() -> PlatformBuilder {
        PlatformBuilder {
            name: None,
            scope: String::new(),
            listen: Vec::new(),
            advertise: Vec::new(),
            peers: Vec::new(),
            interfaces: Vec::new(),
            mdns: true,
            mdns_port: MDNS_PORT,
            mdns_agents: DEFAULT_AGENTS,
            control: None,
            max_letter: None,
            state: None,
            outbox: OutboxConfig::default(),
            http: None,
            rules: Rules::default(),
            transports: PlugIns::default(),
            #[cfg(feature = "tls")]
            fleet: None,
        }
    }

    /// The name of the message transport service. Default `mts@HOST`, or `mts-XXXX@HOST` where
    /// that is taken.
    #[must_use]
    pub fn name(mut self, name: impl Into<String>) -> PlatformBuilder {
        self.name = Some(name.into());
        self
    }

    /// The fleet; platforms of other fleets are not found, and links to them are refused.
    #[must_use]
    pub fn scope(mut self, scope: impl Into<String>) -> PlatformBuilder {
        self.scope = scope.into();
        self
    }

    /// Adds an endpoint: `tcp://HOST:PORT`, `HOST:PORT`, `quic://HOST:PORT`, or one of a
    /// [transport](Self::transport) that is plugged in. Default `tcp://127.0.0.1:0`; port 0 takes a
    /// free one, and `0.0.0.0` means every address of the machine.
    #[must_use]
    pub fn listen(mut self, endpoint: impl Into<String>) -> PlatformBuilder {
        self.listen.push(endpoint.into());
        self
    }

    /// Adds an address that others are told instead of the endpoints.
    #[must_use]
    pub fn advertise(mut self, address: impl Into<String>) -> PlatformBuilder {
        self.advertise.push(address.into());
        self
    }

    /// Adds the address of a platform that is dialled for ever. mDNS goes on beside it.
    ///
    /// A URL `http://…` is that of a platform of another make, such as JADE's: its AMS is asked for
    /// its agents again and again. It is answered at the [HTTP endpoint](Self::http) of this one.
    /// The name of the platform is found out, unless it stands behind a `#`.
    #[must_use]
    pub fn peer(mut self, address: impl Into<String>) -> PlatformBuilder {
        self.peers.push(address.into());
        self
    }

    /// Adds an interface or network on which mDNS is spoken.
    #[must_use]
    pub fn interface(mut self, interface: InterfaceSelector) -> PlatformBuilder {
        self.interfaces.push(interface);
        self
    }

    /// Whether mDNS is spoken; it is unless told otherwise.
    #[must_use]
    pub fn mdns(mut self, spoken: bool) -> PlatformBuilder {
        self.mdns = spoken;
        self
    }

    /// The UDP port of mDNS, for platforms that want to be undisturbed by others. Default 5353.
    #[must_use]
    pub fn mdns_port(mut self, port: u16) -> PlatformBuilder {
        self.mdns_port = port;
        self
    }

    /// How many agents are announced to C++ robots at most; 0 announces none. Default 200.
    #[must_use]
    pub fn mdns_agents(mut self, most: usize) -> PlatformBuilder {
        self.mdns_agents = most;
        self
    }

    /// The Unix socket at which local programs attach. Default: none.
    #[must_use]
    pub fn control(mut self, path: impl Into<PathBuf>) -> PlatformBuilder {
        self.control = Some(path.into());
        self
    }

    /// Octets of the largest letter. Default 256 MiB.
    #[must_use]
    pub fn max_letter(mut self, octets: usize) -> PlatformBuilder {
        self.max_letter = Some(octets);
        self
    }

    /// The directory in which letters are stored whose receiver's robot is away when their deadline
    /// passes; they are sent when it is there again, after a restart too. It is made where it is
    /// missing, and belongs to one platform at a time. Default: none, and nothing is stored.
    #[must_use]
    pub fn state(mut self, directory: impl Into<PathBuf>) -> PlatformBuilder {
        self.state = Some(directory.into());
        self
    }

    /// How many letters are stored, and for how long; without [`state`](Self::state) of no use.
    #[must_use]
    pub fn outbox(mut self, limits: OutboxConfig) -> PlatformBuilder {
        self.outbox = limits;
        self
    }

    /// Takes letters over HTTP as well (FIPA SC00084F), as JADE posts them, at this `HOST:PORT`;
    /// port 0 takes a free one. Others are told of `path`, such as `/acc`.
    ///
    /// An [advertised](Self::advertise) address `http://…` is told instead.
    #[must_use]
    pub fn http(mut self, endpoint: impl Into<String>, path: impl Into<String>) -> PlatformBuilder {
        self.http = Some((endpoint.into(), path.into()));
        self
    }

    /// Plugs a transport in, beside those that are built in.
    #[must_use]
    pub fn transport(mut self, transport: Arc<dyn LetterTransport>) -> PlatformBuilder {
        self.transports.add(transport);
        self
    }

    /// Who may send to whom, and who may register. Default: everybody may.
    #[must_use]
    pub fn rules(mut self, rules: Rules) -> PlatformBuilder {
        self.rules = rules;
        self
    }

    /// The membership in a fleet: links are then only with robots that prove to be of it, and the
    /// platform bears the name of its certificate. Without a fleet everybody is let in.
    #[cfg(feature = "tls")]
    #[must_use]
    pub fn fleet(mut self, membership: impl Into<Arc<Membership>>) -> PlatformBuilder {
        self.fleet = Some(membership.into());
        self
    }

    /// Binds, announces, and begins to dial. To be called within a tokio runtime.
    pub async fn start(mut self) -> Result<Platform, Error> {
        let security = self.security()?;
        let mut octets = [0; 16];
        getrandom::fill(&mut octets).map_err(|error| Error::Random(error.to_string()))?;
        let instance = InstanceId::from_bytes(octets);
        self.check_schemes()?;
        let (listeners, plugged, bound) = self.bind(&security).await?;
        let outbox = self.state.as_ref().map(fipa_outbox::open).transpose()?;
        let control = self.bind_control().await?;
        let http = self.bind_http().await?;
        let endpoints = self.endpoints(&bound)?;
        let (name, lock, discovery) = self.announce(instance, &bound).await?;

        let mut config = Config::new(instance, name);
        config.scope = Text::from(self.scope.as_str());
        config.endpoints = endpoints;
        config.rules = std::mem::take(&mut self.rules);
        config.fleet = self.robots();
        config.mdns_port = discovery.is_some().then_some(self.mdns_port);
        config.http = self.urls(http.as_ref().map(|(_, url)| url))?;
        config.schemes = self.transports.schemes();
        if let Some(max) = self.max_letter {
            config.max_letter = max;
            config.limits.max_octets = max;
        }
        config.outbox = outbox.is_some().then(|| self.outbox.clone());
        let clock = Clock::start();
        let node = Node::start(clock, Mts::new(config), Hub::default(), security);
        node.plug_in(self.transports.clone());
        if let Some(outbox) = outbox {
            start_outbox(&node, outbox)?;
        }
        #[cfg(feature = "tls")]
        node.check_fleet();
        for endpoint in plugged {
            endpoint.serve(&node)?;
        }
        let mut tasks = Vec::new();
        for listener in listeners {
            tasks.push(tokio::spawn(node.clone().accept_from(listener, false)));
        }
        if let Some(listener) = control {
            tasks.push(tokio::spawn(node.clone().accept_from(listener, true)));
        }
        let http_bound = http.map(|(server, url)| {
            tasks.push(tokio::spawn(server.serve(http::Inbox::of(&node))));
            url
        });
        let told = |http: bool| !self.advertised(http).is_ok_and(|told| told.is_empty());
        let follow = addresses::follow(
            node.clone(),
            Some(bound).filter(|_| !told(false)),
            http_bound.filter(|_| !told(true)),
        );
        tasks.push(tokio::spawn(follow));
        tasks.push(management::start(&node, &instance.to_string())?);
        for peer in &self.peers {
            match peer.parse()? {
                url @ Address::Http { .. } => {
                    let name = peer.split_once('#').map(|(_, name)| Text::from(name));
                    tasks.push(management::start_platform(&node, url, name));
                }
                address => node.with(|now, mts, _| mts.add_peer(now, address)),
            }
        }
        let discovery = discovery.map(|found| discovery::run(&node, found, lock));
        let backend = Backend::Service(node);
        Ok(Platform::new(backend, clock, tasks, discovery))
    }

    /// By what others are let in. The name becomes that of the certificate.
    #[cfg(feature = "tls")]
    fn security(&mut self) -> Result<Security, Error> {
        let Some(fleet) = &self.fleet else {
            return Security::open();
        };
        let certified = fleet.name().to_owned();
        if let Some(name) = self.name.replace(certified.clone())
            && name != certified
        {
            return Err(Error::NotCertified { name, certified });
        }
        let tls = Tls::new(Arc::clone(fleet)).map_err(|error| Error::Key(error.to_string()))?;
        Security::of(tls)
    }

    #[cfg(not(feature = "tls"))]
    fn security(&mut self) -> Result<Security, Error> {
        Security::open()
    }

    /// The robots that are known to be in the fleet, where there is one.
    fn robots(&self) -> Option<Vec<Text>> {
        #[cfg(feature = "tls")]
        return self
            .fleet
            .as_ref()
            .map(|fleet| fleet.robots().map(Text::from).collect());
        #[cfg(not(feature = "tls"))]
        return None;
    }

    /// Whether all addresses are of transports that there are, and peers at such of links.
    fn check_schemes(&self) -> Result<(), Error> {
        for address in self.listen.iter().chain(&self.advertise) {
            self.transports.check(&address.parse()?)?;
        }
        let none = PlugIns::default();
        for address in &self.peers {
            none.check(&address.parse()?)?;
        }
        Ok(())
    }

    /// Binds all endpoints, and tells where they are.
    async fn bind(
        &self,
        security: &Security,
    ) -> Result<(Vec<Listener>, Vec<BoundPlugIn>, Vec<Address>), Error> {
        let (mut listeners, mut plugged, mut bound) = (Vec::new(), Vec::new(), Vec::new());
        for endpoint in self.listen_or_default() {
            let address = endpoint.parse()?;
            match self.transports.bind(&address)? {
                Some(endpoint) => {
                    bound.push(endpoint.address.clone());
                    plugged.push(endpoint);
                }
                None => {
                    let listener = security.bind(&address).await?;
                    bound.push(listener.address().clone());
                    listeners.push(listener);
                }
            }
        }
        Ok((listeners, plugged, bound))
    }

    fn listen_or_default(&self) -> Vec<&str> {
        match &self.listen[..] {
            [] => vec!["tcp://127.0.0.1:0"],
            given => given.iter().map(String::as_str).collect(),
        }
    }

    async fn bind_control(&self) -> Result<Option<Listener>, Error> {
        let Some(path) = &self.control else {
            return Ok(None);
        };
        let address = Address::Unix(path.to_string_lossy().into_owned());
        match Listener::bind(&address).await {
            Ok(listener) => Ok(Some(listener)),
            Err(error) if error.source.kind() == std::io::ErrorKind::AddrInUse => {
                Err(Error::ControlInUse(path.clone()))
            }
            Err(error) => Err(error.into()),
        }
    }

    /// What others are told: the advertised addresses, else the endpoints, with every address of
    /// the machine in place of the unspecified one.
    fn endpoints(&self, bound: &[Address]) -> Result<Vec<Address>, Error> {
        match self.advertised(false)? {
            told if told.is_empty() => Ok(reached_at(bound)),
            told => Ok(told),
        }
    }

    /// Under which URLs others post letters to it.
    fn urls(&self, bound: Option<&Address>) -> Result<Vec<Address>, Error> {
        match self.advertised(true)? {
            told if told.is_empty() => Ok(reached_at(bound.map_or(&[], from_ref))),
            told => Ok(told),
        }
    }

    fn advertised(&self, http: bool) -> Result<Vec<Address>, Error> {
        let parsed = self.advertise.iter().map(|address| address.parse());
        let told: Vec<Address> = parsed.collect::<Result<_, _>>()?;
        Ok(told
            .into_iter()
            .filter(|address| address.is_http() == http)
            .collect())
    }

    async fn bind_http(&self) -> Result<Option<(HttpServer, Address)>, Error> {
        let Some((endpoint, path)) = &self.http else {
            return Ok(None);
        };
        let max_letter = self.max_letter.unwrap_or(MAX_LETTER);
        let server = http::bind(endpoint, path, max_letter).await?;
        Ok(Some(server))
    }

    /// Settles the name, and begins to speak mDNS.
    async fn announce(
        &self,
        instance: InstanceId,
        bound: &[Address],
    ) -> Result<(String, Option<NameLock>, Option<Discovery>), Error> {
        if let Some(name) = &self.name {
            if !Text::from(name.as_str()).is_word() {
                return Err(Error::Name(name.clone()));
            }
            let discovery = self.discovery(instance, name, bound)?;
            return Ok((name.clone(), None, discovery));
        }
        let (usual, other) = names::default_names(instance);
        let Some(lock) = NameLock::take(&usual) else {
            let discovery = self.discovery(instance, &other, bound)?;
            return Ok((other, None, discovery));
        };
        let Some(mut discovery) = self.discovery(instance, &usual, bound)? else {
            return Ok((usual, Some(lock), None));
        };
        if discovery.is_name_taken(&usual).await {
            discovery.shutdown().await;
            let discovery = self.discovery(instance, &other, bound)?;
            return Ok((other, None, discovery));
        }
        Ok((usual, Some(lock), Some(discovery)))
    }

    fn discovery(
        &self,
        instance: InstanceId,
        name: &str,
        bound: &[Address],
    ) -> Result<Option<Discovery>, Error> {
        let (endpoints, quic) = announced(bound);
        if !self.mdns || endpoints.is_empty() {
            return Ok(None);
        }
        let discovery = Discovery::start(MdnsConfig {
            instance,
            name: name.to_owned(),
            scope: self.scope.clone(),
            endpoints,
            quic,
            interfaces: self.interfaces.clone(),
            agents: self.mdns_agents,
            port: self.mdns_port,
        })?;
        Ok(Some(discovery))
    }
}

/// The sockets that mDNS announces, and the port of QUIC. One port is announced beside that of QUIC:
/// of TCP, unless others reach us over QUIC alone.
fn announced(bound: &[Address]) -> (Vec<SocketAddr>, Option<u16>) {
    let is_quic = |address: &&Address| matches!(address, Address::Quic { .. });
    let links = bound.iter().filter(|address| address.is_link());
    let (quic, tcp): (Vec<&Address>, Vec<&Address>) = links.partition(is_quic);
    let sockets = |all: Vec<&Address>| -> Vec<SocketAddr> {
        all.into_iter().filter_map(socket_address).collect()
    };
    let (quic, tcp) = (sockets(quic), sockets(tcp));
    let outer = |all: &[SocketAddr]| all.iter().find(|at| !at.ip().is_loopback()).copied();
    let alone = tcp.is_empty() || outer(&tcp).is_none() && outer(&quic).is_some();
    let endpoints = if alone { quic.clone() } else { tcp };
    let port = match outer(&endpoints) {
        Some(_) => outer(&quic),
        None => quic.first().copied(),
    };
    (endpoints, port.map(|at| at.port()))
}

/// Hands over what an earlier run has stored, and begins to store.
fn start_outbox(node: &Arc<Node<Mts>>, mut outbox: Opened) -> Result<(), Error> {
    let letters = outbox.take_letters();
    let service = Arc::downgrade(node);
    let stored = move |key, result: Result<(), String>| {
        if let Some(node) = service.upgrade() {
            let result = result.map_err(Text::from);
            node.with(|now, mts, _| mts.stored(now, key, result));
        }
    };
    node.set_store(outbox.start(stored).map_err(Error::Runtime)?);
    node.with(|now, mts, _| mts.restore(now, letters));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_reach_is_announced() {
        let told = |bound: &[&str]| {
            let bound: Vec<Address> = bound.iter().map(|a| a.parse().unwrap()).collect();
            let (endpoints, quic) = announced(&bound);
            let endpoints: Vec<String> = endpoints.iter().map(SocketAddr::to_string).collect();
            (endpoints.join(" "), quic)
        };
        let only_tcp = ["tcp://127.0.0.1:1", "tcp://10.0.0.1:2"];
        assert_eq!(told(&only_tcp), ("127.0.0.1:1 10.0.0.1:2".to_owned(), None));
        let both = ["quic://10.0.0.1:3", "tcp://10.0.0.1:2"];
        assert_eq!(told(&both), ("10.0.0.1:2".to_owned(), Some(3)));
        let only_quic = ["quic://127.0.0.1:3"];
        assert_eq!(told(&only_quic), ("127.0.0.1:3".to_owned(), Some(3)));
        let quic_to_others = ["tcp://127.0.0.1:1", "quic://0.0.0.0:3"];
        assert_eq!(told(&quic_to_others), ("0.0.0.0:3".to_owned(), Some(3)));
        let quic_within = ["tcp://0.0.0.0:1", "quic://127.0.0.1:3"];
        assert_eq!(told(&quic_within), ("0.0.0.0:1".to_owned(), None));
    }
}
