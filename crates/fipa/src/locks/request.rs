use std::future::IntoFuture;
use std::pin::Pin;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::{Pattern, Record};
use fipa_locking::{Algorithm, FailureReason};
use tokio::sync::oneshot;

use super::driver::Command;
use super::guard::{Guard, Hold};
use super::{AGENT_TYPE, HEARTBEAT};
use crate::{Agent, Error};

/// The heartbeats that there can be.
const SHORTEST: Duration = Duration::from_millis(10);
const LONGEST: Duration = Duration::from_secs(3600);

/// Why a resource is not held.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockError {
    /// It cannot be asked for.
    #[error(transparent)]
    Request(#[from] fipa_locking::RequestError),
    /// There is no such heartbeat.
    #[error("a heartbeat takes between 10 ms and an hour, not {0:?}")]
    Heartbeat(Duration),
    /// It was not granted.
    #[error("{0}")]
    Failed(FailureReason),
    /// It was not granted in time.
    #[error("it was not granted within {0:?}")]
    Timeout(Duration),
    /// The platform has ended, or gives no random numbers.
    #[error(transparent)]
    Platform(#[from] Error),
}

/// A resource to be asked for; awaiting this makes the request.
///
/// When the future is dropped before it is granted, the resource is not wanted any more.
#[must_use = "the request is made by awaiting it"]
pub struct LockRequest<'a> {
    agent: &'a Agent,
    resource: Text,
    algorithm: Algorithm,
    participants: Participants,
    timeout: Option<Duration>,
    heartbeat: Duration,
}

/// Who may want a resource.
pub(super) enum Participants {
    /// The agents of the service type for that.
    OfType,
    /// Those with such names.
    Named(Pattern),
}

impl Participants {
    pub(super) fn include(&self, record: &Record) -> bool {
        match self {
            Participants::OfType => record.entry.kind == *AGENT_TYPE,
            Participants::Named(pattern) => pattern.matches(&record.entry.name),
        }
    }
}

impl<'a> LockRequest<'a> {
    pub(super) fn new(agent: &'a Agent, resource: Text) -> LockRequest<'a> {
        LockRequest {
            agent,
            resource,
            algorithm: Algorithm::RicartAgrawalaExtended,
            participants: Participants::OfType,
            timeout: None,
            heartbeat: HEARTBEAT,
        }
    }

    /// How the agents agree; all must do it in the same way. Default: Ricart and Agrawala's
    /// algorithm, extended.
    pub fn algorithm(mut self, algorithm: Algorithm) -> LockRequest<'a> {
        self.algorithm = algorithm;
        self
    }

    /// Who may want it and who may own it: the agents whose names match, in place of those of the
    /// type [`AGENT_TYPE`]. C++ robots have to be named so.
    pub fn with(mut self, names: Pattern) -> LockRequest<'a> {
        self.participants = Participants::Named(names);
        self
    }

    /// How long it is waited for. Default: until it is granted, or it is known why it will not be.
    pub fn timeout(mut self, timeout: Duration) -> LockRequest<'a> {
        self.timeout = Some(timeout);
        self
    }

    /// How often the agents that depend on each other ask whether the others live, from 10 ms to
    /// an hour; where the owner's is shorter, that counts. A grant lasts three of these, and who is
    /// silent for four is done without. Default: [`HEARTBEAT`].
    pub fn heartbeat(mut self, heartbeat: Duration) -> LockRequest<'a> {
        self.heartbeat = heartbeat;
        self
    }

    async fn acquire(self) -> Result<Guard, LockError> {
        if !(SHORTEST..=LONGEST).contains(&self.heartbeat) {
            return Err(LockError::Heartbeat(self.heartbeat));
        }
        let timeout = self.timeout;
        let granted = self.granted();
        match timeout {
            None => granted.await,
            Some(timeout) => match tokio::time::timeout(timeout, granted).await {
                Ok(result) => result,
                Err(_) => Err(LockError::Timeout(timeout)),
            },
        }
    }

    async fn granted(self) -> Result<Guard, LockError> {
        let locks = self.agent.locks()?;
        let hold = Hold {
            commands: locks.commands.clone(),
            machine: locks.machine.clone(),
            resource: self.resource.clone(),
            id: locks.next_id(),
        };
        let (answer, granted) = oneshot::channel();
        let command = Command::Request {
            resource: self.resource,
            id: hold.id,
            algorithm: self.algorithm,
            heartbeat: self.heartbeat,
            participants: self.participants,
            answer,
        };
        // A driver that has ended answers nothing.
        let _ = locks.commands.send(command);
        let granted = granted.await.map_err(|_| Error::Ended)??;
        Ok(Guard::new(hold, granted))
    }
}

impl<'a> IntoFuture for LockRequest<'a> {
    type Output = Result<Guard, LockError>;
    type IntoFuture = Pin<Box<dyn Future<Output = Self::Output> + Send + 'a>>;

    fn into_future(self) -> Self::IntoFuture {
        Box::pin(self.acquire())
    }
}
