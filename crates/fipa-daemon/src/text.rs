//! The agents of the text format behind the daemon.
//!
//! ```text
//!   Links ── messages ──▶ TextGateway ── register, send ──▶ Fleet
//!         ◀── write ─────             ◀── deliver ─────────
//! ```

use std::collections::{BTreeMap, HashMap};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use fipa::{Change, ChangeKind, Inside, Platform, Registration, Text};
use fipa_gateway::{TextGateway, TextOutput};
use fipa_json::{text_to_json, unreadable_text_to_json};
use robot_text::links::{Endpoint, LinkEvent, Links};
use robot_text::{Place, PlatformConfig, StreamId};
use serde_json::Value;

use crate::fleet::{Fleet, FleetEvent};
use crate::options::Options;

/// A place for text agents that cannot be bound.
#[derive(Debug, thiserror::Error)]
#[error("cannot bind {endpoint}: {source}")]
pub(crate) struct BindTextError {
    endpoint: Endpoint,
    source: std::io::Error,
}

/// The text platform of the daemon.
pub(crate) struct TextService {
    gateway: TextGateway,
    /// Configured agents, and where they are.
    agents: BTreeMap<String, Endpoint>,
    fleet: Fleet,
    links: Links,
    bound: Vec<String>,
    /// Where streams lead.
    streams: HashMap<StreamId, String>,
    began: Instant,
}

impl TextService {
    /// Opens the endpoints, and registers the configured agents.
    pub(crate) async fn start(
        platform: &Platform,
        options: &Options,
    ) -> Result<TextService, BindTextError> {
        let mut links = Links::new();
        let mut bound = Vec::new();
        for endpoint in &options.text {
            match links.open(endpoint).await {
                Ok(place) => bound.extend(place.map(|place| place.to_string())),
                Err(source) => {
                    let endpoint = endpoint.clone();
                    return Err(BindTextError { endpoint, source });
                }
            }
        }
        let mut service = TextService {
            gateway: TextGateway::new(platform.name(), PlatformConfig::default()),
            agents: options.text_agents.clone(),
            fleet: Fleet::new(platform),
            links,
            bound,
            streams: HashMap::new(),
            began: Instant::now(),
        };
        for (name, endpoint) in &options.text_agents {
            service.gateway.configure(name);
            if let Some(address) = datagram_address(endpoint) {
                service.declare(name, Place::Datagram(address));
            }
        }
        service.settle();
        Ok(service)
    }

    /// The places that are bound.
    pub(crate) fn bound(&self) -> &[String] {
        &self.bound
    }

    /// Handles the next thing that happens. Cancel-safe.
    pub(crate) async fn run(&mut self) {
        let wake = self.gateway.poll_timeout().map(|at| self.began + at);
        let timeout = async {
            match wake {
                Some(wake) => tokio::time::sleep_until(wake.into()).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            event = self.links.next() => self.link_event(event),
            event = self.fleet.next() => self.fleet_event(event),
            () = timeout => self.gateway.handle_timeout(self.began.elapsed()),
        }
        self.settle();
    }

    /// An agent that is gone does not want what it asked for any more.
    pub(crate) fn directory_changed(&mut self, change: &Change) {
        if change.kind == ChangeKind::Removed {
            self.gateway.agent_gone(&change.record.entry.name);
        }
    }

    /// Shows a message to those who watch what passes.
    fn show(&self, incoming: bool, place: Place, form: impl FnOnce() -> Value) {
        self.fleet.passed_inside(|| Inside {
            protocol: Text::from_static("text"),
            incoming,
            place: match place {
                Place::Datagram(address) => Text::from(format!("udp://{address}")),
                Place::Stream(stream) => {
                    let place = self.streams.get(&stream).map(String::as_str);
                    Text::from(place.unwrap_or_default())
                }
            },
            form: Text::from(form().to_string()),
        });
    }

    fn declare(&mut self, name: &str, place: Place) {
        if let Err(error) = self.gateway.declare_at(name, place) {
            tracing::error!("the text agent {name} cannot be at {place:?}: {error}");
        }
    }

    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    fn link_event(&mut self, event: LinkEvent) {
        match event {
            LinkEvent::Opened {
                stream,
                endpoint,
                place,
            } => {
                tracing::debug!("text stream {} to {place} is open at {endpoint}", stream.0);
                self.streams.insert(stream, place);
                let agents = self.agents.iter();
                let here = agents.filter(|(_, place)| **place == endpoint && is_one_stream(place));
                let names: Vec<String> = here.map(|(name, _)| name.clone()).collect();
                for name in names {
                    self.declare(&name, Place::Stream(stream));
                }
            }
            LinkEvent::Received(from, message) => {
                self.show(true, from, || text_to_json(&message));
                let (now, fleet) = (self.now(), &self.fleet);
                self.gateway
                    .received(now, from, message, |name| fleet.knows(name));
            }
            LinkEvent::Unreadable(from, unreadable) => {
                self.show(true, from, || unreadable_text_to_json(&unreadable));
                tracing::warn!(
                    "a text message from {from:?} cannot be read: {}",
                    unreadable.fault
                );
            }
            LinkEvent::Written(ticket, result) => {
                let failure = result.err();
                let result = failure.as_deref().map_or(Ok(()), Err);
                self.gateway.written(ticket, result);
            }
            LinkEvent::Closed(stream, reason) => {
                tracing::info!("text stream {} has ended: {reason}", stream.0);
                self.gateway.stream_closed(stream);
                self.streams.remove(&stream);
            }
            LinkEvent::Failed(endpoint, reason) => {
                tracing::debug!("{endpoint} cannot be opened: {reason}");
            }
        }
    }

    fn fleet_event(&mut self, event: FleetEvent) {
        match event {
            FleetEvent::Message { to, message } => {
                self.gateway.deliver(self.now(), &to, &message);
            }
            FleetEvent::Undelivered { message, reason } => {
                self.gateway.undelivered(self.now(), &message, &reason);
            }
        }
    }

    fn settle(&mut self) {
        while let Some(output) = self.gateway.poll_output() {
            match output {
                TextOutput::Register(name) => self.fleet.register(Registration::new(name)),
                TextOutput::Deregister(name) => self.fleet.deregister(&name),
                TextOutput::Send(message) => self.fleet.send(message),
                TextOutput::Write {
                    to,
                    message,
                    ticket,
                } => {
                    self.show(false, to, || text_to_json(&message));
                    self.links.write(to, &message, ticket);
                }
            }
        }
    }
}

/// The address of an agent that is reached by datagrams.
pub(crate) fn datagram_address(endpoint: &Endpoint) -> Option<SocketAddr> {
    match endpoint {
        Endpoint::Udp(place) => place.parse().ok(),
        _ => None,
    }
}

/// Whether all that is there is at the other end of one stream, not of those that come.
fn is_one_stream(endpoint: &Endpoint) -> bool {
    matches!(endpoint, Endpoint::TcpDial(_) | Endpoint::Serial { .. })
}
