//! The HIAC devices behind the daemon.
//!
//! ```text
//!   Node ── events ──▶ HiacGateway ── register, send ──▶ Fleet
//!        ◀── send ───              ◀── deliver ─────────
//! ```

use std::time::Duration;

use fipa::{Change, ChangeKind, Platform, Registration, Text};
use fipa_gateway::{HiacGateway, HiacOutput};
use hiac::links::{Endpoint, Node, NodeEvent, Place};
use hiac::station::StationConfig;

use crate::fleet::{Fleet, FleetEvent};
use crate::options::Options;
use crate::packets::Packets;

/// How long devices have to take what is still to be said to them.
const FAREWELL: Duration = Duration::from_millis(500);

/// A place for devices that cannot be bound.
#[derive(Debug, thiserror::Error)]
#[error("cannot bind {endpoint}: {source}")]
pub(crate) struct BindHiacError {
    endpoint: Endpoint,
    source: std::io::Error,
}

/// The HIAC station of the daemon.
pub(crate) struct HiacService {
    node: Node,
    gateway: HiacGateway,
    fleet: Fleet,
    bound: Vec<String>,
}

impl HiacService {
    /// Opens the endpoints.
    pub(crate) async fn start(
        platform: &Platform,
        options: &Options,
    ) -> Result<HiacService, BindHiacError> {
        let listens = |endpoint: &Endpoint| {
            let place = &endpoint.place;
            matches!(place, Place::TcpListen(_) | Place::TlsListen(..))
        };
        let mut node = Node::new(StationConfig {
            address: options.hiac_address.map(|group| group.address),
            workgroups: options.hiac_address.into_iter().collect(),
            aliases: options.hiac_names.aliases.keys().copied().collect(),
            listens: options.hiac.iter().any(listens),
            ..StationConfig::default()
        });
        node.set_watcher(Box::new(Packets(platform.clone())));
        let mut bound = Vec::new();
        for endpoint in &options.hiac {
            match node.open(endpoint).await {
                Ok(place) => bound.extend(place.map(|place| place.to_string())),
                Err(source) => {
                    let endpoint = endpoint.clone();
                    return Err(BindHiacError { endpoint, source });
                }
            }
        }
        Ok(HiacService {
            node,
            gateway: HiacGateway::new(platform.name(), options.hiac_names.clone()),
            fleet: Fleet::new(platform),
            bound,
        })
    }

    /// The places that are bound.
    pub(crate) fn bound(&self) -> &[String] {
        &self.bound
    }

    /// Handles the next thing that happens. Cancel-safe.
    pub(crate) async fn run(&mut self) {
        let wake = self.gateway.poll_timeout();
        let wait = wake.map(|at| at.saturating_sub(self.node.now()));
        let timeout = async {
            match wait {
                Some(wait) => tokio::time::sleep(wait).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            event = self.node.next() => self.node_event(event),
            event = self.fleet.next() => self.fleet_event(event),
            () = timeout => {
                let now = self.node.now();
                self.gateway.handle_timeout(now, self.node.station());
            }
        }
        self.settle();
    }

    /// An agent that is gone does not want what it asked for any more.
    pub(crate) fn directory_changed(&mut self, change: &Change) {
        if change.kind == ChangeKind::Removed {
            self.gateway.agent_gone(&change.record.entry.name);
        }
    }

    /// Lets the last words reach the devices.
    pub(crate) async fn end(mut self) {
        self.node.drain(FAREWELL).await;
    }

    fn node_event(&mut self, event: NodeEvent) {
        match event {
            NodeEvent::Station(event) => {
                let now = self.node.now();
                self.gateway.event(now, self.node.station(), event);
            }
            NodeEvent::Opened(link) => tracing::debug!("HIAC link {} is open", link.0),
            NodeEvent::Closed(link, reason) => {
                tracing::info!("HIAC link {} has ended: {reason}", link.0);
            }
            NodeEvent::Failed(endpoint, reason) => {
                tracing::debug!("{endpoint} cannot be opened: {reason}");
            }
        }
    }

    fn fleet_event(&mut self, event: FleetEvent) {
        let now = self.node.now();
        let station = self.node.station();
        match event {
            FleetEvent::Message { to, message } => {
                self.gateway.deliver(now, station, &to, &message);
            }
            FleetEvent::Undelivered { message, reason } => {
                self.gateway.undelivered(now, station, &message, &reason);
            }
        }
    }

    fn settle(&mut self) {
        while let Some(output) = self.gateway.poll_output() {
            match output {
                HiacOutput::Register { name, description } => {
                    let mut registration = Registration::new(name);
                    registration.description = Text::from(description);
                    self.fleet.register(registration);
                }
                HiacOutput::Deregister(name) => self.fleet.deregister(&name),
                HiacOutput::Send(message) => self.fleet.send(message),
            }
        }
    }
}
