//! The agents that a gateway has in the fleet.

use std::collections::HashMap;
use std::time::Duration;

use fipa::{Agent, DEFAULT_TIMEOUT, Inside, Message, Platform, ReceiveError, Registration, Text};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;

/// What comes from the fleet and waits for the gateway.
const WAITING: usize = 64;

/// How often a name is registered, and the time in between.
const ATTEMPTS: usize = 5;
const PAUSE: Duration = Duration::from_millis(200);

/// Agents of the daemon itself.
pub(crate) struct Fleet {
    platform: Platform,
    agents: HashMap<Text, Listening>,
    events: mpsc::Sender<FleetEvent>,
    receiver: mpsc::Receiver<FleetEvent>,
}

/// The task of an agent in the fleet; the agent goes with it.
struct Listening(AbortHandle);

impl Drop for Listening {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// What the fleet has to say.
pub(crate) enum FleetEvent {
    /// A message for an agent.
    Message { to: Text, message: Box<Message> },
    /// A message of an agent did not arrive.
    Undelivered {
        message: Box<Message>,
        reason: String,
    },
}

impl Fleet {
    pub(crate) fn new(platform: &Platform) -> Fleet {
        let (events, receiver) = mpsc::channel(WAITING);
        Fleet {
            platform: platform.clone(),
            agents: HashMap::new(),
            events,
            receiver,
        }
    }

    /// The next thing that the fleet says. Cancel-safe.
    pub(crate) async fn next(&mut self) -> FleetEvent {
        // A sender is kept here, so the channel never ends.
        match self.receiver.recv().await {
            Some(event) => event,
            None => std::future::pending().await,
        }
    }

    /// Whether an agent of this name is known.
    pub(crate) fn knows(&self, name: &str) -> bool {
        self.platform.find(name).is_some()
    }

    /// Shows a message between the daemon and a device to those who watch what passes.
    pub(crate) fn passed_inside(&self, message: impl FnOnce() -> Inside) {
        self.platform.passed_inside(message);
    }

    pub(crate) fn register(&mut self, registration: Registration) {
        let (platform, events) = (self.platform.clone(), self.events.clone());
        let name = registration.name.clone();
        let task = tokio::spawn(async move {
            // Who comes back at once may find its own name still there.
            let mut error = None;
            for _ in 0..ATTEMPTS {
                match platform.register(registration.clone()).await {
                    Ok(agent) => return listen(agent, events).await,
                    Err(refused) => error = Some(refused),
                }
                tokio::time::sleep(PAUSE).await;
            }
            if let Some(error) = error {
                let name = registration.name;
                tracing::error!("{name} does not appear in the fleet: {error}");
            }
        });
        self.agents.insert(name, Listening(task.abort_handle()));
    }

    pub(crate) fn deregister(&mut self, name: &Text) {
        self.agents.remove(name);
    }

    /// Sends a message of an agent.
    pub(crate) fn send(&self, message: Box<Message>) {
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
