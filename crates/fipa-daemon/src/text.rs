//! The agents of the text format behind the daemon.
//!
//! ```text
//!   Links ── messages ──▶ TextGateway ── register, send ──▶ Fleet
//!         ◀── write ─────             ◀── deliver ─────────
//! ```

use std::time::{Duration, Instant};

use fipa::{Change, ChangeKind, Platform, Registration};
use fipa_gateway::{TextGateway, TextOutput};
use robot_text::PlatformConfig;
use robot_text::links::{Endpoint, LinkEvent, Links};

use crate::fleet::{Fleet, FleetEvent};

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
    fleet: Fleet,
    links: Links,
    bound: Vec<String>,
    began: Instant,
}

impl TextService {
    /// Opens the endpoints.
    pub(crate) async fn start(
        platform: &Platform,
        endpoints: &[Endpoint],
    ) -> Result<TextService, BindTextError> {
        let mut links = Links::new();
        let mut bound = Vec::new();
        for endpoint in endpoints {
            match links.open(endpoint).await {
                Ok(place) => bound.extend(place.map(|place| place.to_string())),
                Err(source) => {
                    let endpoint = endpoint.clone();
                    return Err(BindTextError { endpoint, source });
                }
            }
        }
        Ok(TextService {
            gateway: TextGateway::new(platform.name(), PlatformConfig::default()),
            fleet: Fleet::new(platform),
            links,
            bound,
            began: Instant::now(),
        })
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

    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    fn link_event(&mut self, event: LinkEvent) {
        match event {
            LinkEvent::Opened(stream) => tracing::debug!("text stream {} is open", stream.0),
            LinkEvent::Received(from, message) => {
                let (now, fleet) = (self.now(), &self.fleet);
                self.gateway
                    .received(now, from, message, |name| fleet.knows(name));
            }
            LinkEvent::Unreadable(from, unreadable) => {
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
                } => self.links.write(to, &message, ticket),
            }
        }
    }
}
