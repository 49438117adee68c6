//! The start of mDNS: everything that `mdns-sd` would keep to itself is found out here.
use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::thread;
use std::time::Duration;

use mdns_sd::{DaemonEvent, Error, IfKind, IfPredicate, Receiver, ServiceDaemon};
use socket2::{Domain, Protocol, Socket, Type};
use tokio::time::Instant;

use super::announce::{SERVICE_TYPE, announcement};
use super::announcer::Announcer;
use super::ears::Ears;
use super::peers::Peers;
use super::{Mdns, REPEAT_EVERY, Running, refused};
use crate::interface::{Rule, describe, usable_interfaces};
use crate::service_directory::ServiceType;
use crate::service_directory::answer::Teller;
use crate::service_directory::browser::Browser;
use crate::service_directory::responder::Responder;
use crate::{DiscoveryEvent, MdnsConfig, MdnsError};

/// How long the thread of `mdns-sd` has to carry out the first commands.
const STARTED_WITHIN: Duration = Duration::from_secs(2);

/// See [`Mdns::start`].
pub(super) fn start(config: MdnsConfig) -> Result<Mdns, MdnsError> {
    if config.port == 0 {
        return Err(MdnsError::NoPort);
    }
    let interfaces = usable_interfaces()?;
    let rule = Rule::new(&config, &interfaces)?;
    let service = announcement(&config, &rule)?;
    check_port(config.port, &rule)?;

    let daemon = Running(ServiceDaemon::new_with_port(config.port).map_err(refused)?);
    let monitor = insist(|| daemon.0.monitor())?;
    // A single rule, asked for every interface, also for those that appear later.
    let asked = rule.clone();
    let silent = IfPredicate::new(move |interface| !asked.speaks_on(interface));
    insist(|| {
        daemon
            .0
            .disable_interface(IfKind::Predicate(silent.clone()))
    })?;
    insist(|| daemon.0.register(service.clone()))?;
    let events = insist(|| daemon.0.browse(SERVICE_TYPE))?;
    check_announced(&daemon.0, &monitor)?;
    let service_type = ServiceType::of_scope(&config.scope);
    let queue = match service_type {
        Some(_) => VecDeque::new(),
        None => VecDeque::from([no_service_type(&config.scope)]),
    };
    let now = std::time::Instant::now();
    let reach = rule.reach(&interfaces);
    let begun = |service_type| Browser::new(service_type, config.instance, fastrand::u64(..), now);
    let responder = |service_type| {
        let teller = Teller {
            service_type,
            host: format!("fipa-{}-agents", &config.instance.to_string()[..16]),
            addresses: reach.ipv4(),
        };
        Responder::new(teller, config.port, fastrand::u64(..), now)
    };
    let responder = service_type.clone().map(responder);
    Ok(Mdns {
        daemon,
        service,
        monitor,
        events,
        announcer: Announcer::new(config.instance, service_type.clone(), config.agents, reach),
        rule,
        browser: service_type.map(begun),
        responder,
        ears: Ears::new(config.port),
        deaf: false,
        agents_at: Instant::now(),
        rescan_at: Instant::now(),
        peers: Peers::new(config.instance, config.scope),
        queue,
        repeat_every: REPEAT_EVERY,
        repeat_at: Instant::now() + REPEAT_EVERY,
        doubt_until: None,
        stopped: false,
    })
}

fn no_service_type(scope: &str) -> DiscoveryEvent {
    DiscoveryEvent::Warning(format!(
        "no agent is announced to C++ robots, nor are theirs found: the scope `{scope}` makes no \
         DNS-SD service type"
    ))
}

/// Offers a command a few times to a queue that is full for the moment.
pub(super) fn insist<T>(mut command: impl FnMut() -> mdns_sd::Result<T>) -> Result<T, MdnsError> {
    for _ in 0..50 {
        match command() {
            Err(Error::Again) => thread::sleep(Duration::from_millis(1)),
            done => return done.map_err(refused),
        }
    }
    Err(MdnsError::Busy)
}

/// Opens the UDP port as `mdns-sd` will do, because it does not tell when it could not.
fn check_port(port: u16, rule: &Rule) -> Result<(), MdnsError> {
    let families = [
        SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)),
        (Ipv6Addr::UNSPECIFIED, port).into(),
    ];
    for address in families
        .into_iter()
        .filter(|a| rule.listens_on(a.is_ipv4()))
    {
        open(address).map_err(|source| MdnsError::Socket { port, source })?;
    }
    Ok(())
}

fn open(address: SocketAddr) -> io::Result<Socket> {
    let socket = Socket::new(
        Domain::for_address(address),
        Type::DGRAM,
        Some(Protocol::UDP),
    )?;
    if address.is_ipv6() {
        socket.set_only_v6(true)?;
    }
    socket.set_reuse_address(true)?;
    #[cfg(unix)]
    socket.set_reuse_port(true)?;
    socket.bind(&address.into())?;
    Ok(socket)
}

/// Waits until the first commands were carried out and looks at what came of them.
fn check_announced(
    daemon: &ServiceDaemon,
    monitor: &Receiver<DaemonEvent>,
) -> Result<(), MdnsError> {
    let status = insist(|| daemon.status())?;
    status
        .recv_timeout(STARTED_WITHIN)
        .map_err(|_| MdnsError::Stopped)?;
    let mut announced = false;
    for event in monitor.try_iter() {
        match event {
            DaemonEvent::Error(error) => return Err(refused(error)),
            DaemonEvent::Announce(..) => announced = true,
            _ => {}
        }
    }
    if announced {
        return Ok(());
    }
    Err(MdnsError::NotAnnounced {
        available: describe(&usable_interfaces()?),
    })
}
