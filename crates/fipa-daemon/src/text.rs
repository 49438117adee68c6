//! The agents of the text format behind the daemon.
//!
//! ```text
//!   Links ── messages ──▶ TextGateway ── register, send ──▶ fipa::Agent (one each)
//!         ◀── write ─────             ◀── deliver ─────────
//! ```

use std::collections::HashMap;
use std::time::{Duration, Instant};

use fipa::{
    Agent, Change, ChangeKind, DEFAULT_TIMEOUT, Error, Message, Platform, ReceiveError, Text,
};
use fipa_gateway::{TextGateway, TextOutput};
use robot_text::PlatformConfig;
use robot_text::links::{Endpoint, LinkEvent, Links};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;

/// What comes from the fleet and waits for the gateway.
const WAITING: usize = 64;

/// A place for text agents that cannot be bound.
#[derive(Debug, thiserror::Error)]
#[error("cannot bind {endpoint}: {source}")]
pub(crate) struct BindTextError {
    endpoint: Endpoint,
    source: std::io::Error,
}

/// The text platform of the daemon.
pub(crate) struct TextService {
    platform: Platform,
    gateway: TextGateway,
    links: Links,
    bound: Vec<String>,
    agents: HashMap<Text, Listening>,
    events: mpsc::Sender<FleetEvent>,
    from_fleet: mpsc::Receiver<FleetEvent>,
    began: Instant,
}

/// The task of an agent in the fleet; the agent goes with it.
struct Listening(AbortHandle);

impl Drop for Listening {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// What the fleet has to say.
enum FleetEvent {
    Registered(Result<Agent, (Text, Error)>),
    Message {
        to: Text,
        message: Box<Message>,
    },
    Undelivered {
        message: Box<Message>,
        reason: String,
    },
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
        let (events, from_fleet) = mpsc::channel(WAITING);
        Ok(TextService {
            gateway: TextGateway::new(platform.name(), PlatformConfig::default()),
            platform: platform.clone(),
            links,
            bound,
            agents: HashMap::new(),
            events,
            from_fleet,
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
            Some(event) = self.from_fleet.recv() => self.fleet_event(event),
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
                let (now, platform) = (self.now(), &self.platform);
                let fleet = |name: &str| platform.find(name).is_some();
                self.gateway.received(now, from, message, fleet);
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
            FleetEvent::Registered(Ok(agent)) => {
                let name = agent.name().clone();
                let task = tokio::spawn(listen(agent, self.events.clone()));
                self.agents.insert(name, Listening(task.abort_handle()));
            }
            FleetEvent::Registered(Err((name, error))) => {
                tracing::error!("the text agent {name} does not appear in the fleet: {error}");
            }
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
                TextOutput::Register(name) => self.register(name),
                TextOutput::Deregister(name) => {
                    self.agents.remove(&name);
                }
                TextOutput::Send(message) => self.send(message),
                TextOutput::Write {
                    to,
                    message,
                    ticket,
                } => self.links.write(to, &message, ticket),
            }
        }
    }

    fn register(&mut self, name: Text) {
        let (platform, events) = (self.platform.clone(), self.events.clone());
        tokio::spawn(async move {
            let registered = platform.agent(name.clone()).await;
            let event = FleetEvent::Registered(registered.map_err(|error| (name, error)));
            // The daemon ends.
            let _ = events.send(event).await;
        });
    }

    fn send(&mut self, message: Box<Message>) {
        let (platform, events) = (self.platform.clone(), self.events.clone());
        tokio::spawn(async move {
            let outcomes = platform.send_as((*message).clone(), DEFAULT_TIMEOUT).await;
            let failed = outcomes
                .iter()
                .find(|outcome| !outcome.outcome.is_success());
            if let Some(failed) = failed {
                let reason = failed.reason.to_string();
                // The daemon ends.
                let _ = events
                    .send(FleetEvent::Undelivered { message, reason })
                    .await;
            }
        });
    }
}

/// Hands on what comes for an agent.
async fn listen(agent: Agent, events: mpsc::Sender<FleetEvent>) {
    loop {
        let message = match agent.receive().await {
            Ok(message) => Box::new(message),
            Err(ReceiveError::Ended) => return,
            Err(error) => {
                tracing::warn!("{}: {error}", agent.name());
                continue;
            }
        };
        let to = agent.name().clone();
        if events
            .send(FleetEvent::Message { to, message })
            .await
            .is_err()
        {
            return;
        }
    }
}
