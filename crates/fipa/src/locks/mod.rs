//! Locks among agents, without a server: [`Agent::lock`] and [`Agent::own`].
//!
//! ```text
//!   agent.lock ──▶ LockRequest ──▶ ┌────────┐ ◀── messages of the locks, out of the agent's mail
//!   Guard ◀── granted, lost ────── │ Driver │ ◀── directory: who may want it, who is gone
//!     └── released, dropped ─────▶ └────────┘ ──▶ fipa_locking::LockAgent ──▶ letters
//! ```
//!
//! A resource has an owner, one agent that lends it and numbers the grants, and agents that want
//! it: the participants. Those are the agents of the service type [`AGENT_TYPE`], unless a request
//! names others. What holds, and what is sent, is documented in `fipa_locking`.
//!
//! **Knows** the mail, the directory and the clock of an agent. **Never knows** how agents agree:
//! `fipa_locking` does.
//!
//! ```
//! # async fn example() -> Result<(), Box<dyn std::error::Error>> {
//! use fipa::{Platform, locks};
//! use std::sync::Arc;
//!
//! let robot1 = Platform::builder().name("robot1").mdns(false).start().await?;
//! let owner = robot1.register(locks::registration("locks@robot1")).await?;
//! owner.own("gripper", Arc::new(locks::Forgetful::new())).await?;
//!
//! let arm = robot1.register(locks::registration("arm@robot1")).await?;
//! let guard = arm.lock("gripper").await?;
//! println!("grant {:?}", guard.fencing());
//! tokio::select! {
//!     reason = guard.lost() => println!("stop at once: {reason}"),
//!     () = async { /* use it */ } => guard.release().await,
//! }
//! # Ok(()) }
//! # tokio::runtime::Runtime::new().unwrap().block_on(example()).unwrap();
//! ```

mod driver;
mod guard;
mod keep;
mod lives;
mod request;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fipa_acl::{Message, Text};
use fipa_locking::{Config, LockAgent};
use fipa_mts::Registration;
use tokio::sync::{mpsc, oneshot};
use tokio::task::AbortHandle;

use crate::clock::Clock;
use crate::{Agent, Error};
use driver::{Command, Driver};

pub use fipa_locking::{
    Algorithm, FailureReason, ListError, LockView, LossReason, Record, list_query, read_list,
};
pub use guard::Guard;
pub use keep::{Forgetful, Keep};
pub use request::{LockError, LockRequest};

/// The service type of agents that take part in locks.
pub const AGENT_TYPE: &str = "fipa-lock";

/// The heartbeat of owners, and of requests that name none.
pub const HEARTBEAT: Duration = Duration::from_secs(5);

/// The registration of an agent that takes part in locks.
pub fn registration(name: impl Into<Text>) -> Registration {
    Registration {
        kind: Text::from_static(AGENT_TYPE),
        ..Registration::new(name)
    }
}

/// Whether a message of the agent's mail is for its locks.
pub(crate) fn takes(message: &Message) -> bool {
    LockAgent::takes(message)
}

/// Why an agent does not own a resource.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OwnError {
    /// It has no name, or there are too many.
    #[error(transparent)]
    Resource(#[from] fipa_locking::RequestError),
    /// What was kept of it cannot be read.
    #[error(transparent)]
    Kept(std::io::Error),
    /// The platform has ended, or gives no random numbers.
    #[error(transparent)]
    Platform(#[from] Error),
}

/// The locks of an agent: its driver, which ends with it.
pub(crate) struct Locks {
    commands: mpsc::UnboundedSender<Command>,
    machine: Machine,
    driver: AbortHandle,
    requests: AtomicU64,
}

impl Locks {
    /// What tells a request from the others.
    fn next_id(&self) -> u64 {
        self.requests.fetch_add(1, Ordering::Relaxed)
    }
}

impl Drop for Locks {
    fn drop(&mut self) {
        self.driver.abort();
    }
}

/// The state machine with its clock: the driver's, and looked at by guards.
#[derive(Clone)]
struct Machine {
    agent: Arc<Mutex<LockAgent>>,
    clock: Clock,
}

impl Machine {
    fn now(&self) -> Duration {
        self.clock.now().mono
    }

    fn lock(&self) -> MutexGuard<'_, LockAgent> {
        self.agent.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Agent {
    /// Asks for a resource that some agent owns. The request is described further by the methods
    /// of [`LockRequest`], and made by awaiting it.
    ///
    /// Agents that want to be waited for are registered with the service type [`AGENT_TYPE`].
    pub fn lock(&self, resource: impl Into<Text>) -> LockRequest<'_> {
        LockRequest::new(self, resource.into())
    }

    /// Owns a resource from now on, until the agent goes: lends it to one agent at a time, each
    /// time with a greater number, which is kept by `keep` before it is told.
    ///
    /// # Errors
    /// The resource has no name, or there are too many; what was kept of it cannot be read; the
    /// platform has ended.
    pub async fn own(
        &self,
        resource: impl Into<Text>,
        keep: Arc<dyn Keep>,
    ) -> Result<(), OwnError> {
        let resource = resource.into();
        let record = keep::recall(Arc::clone(&keep), resource.clone()).await;
        let record = record.map_err(OwnError::Kept)?;
        let (answer, owned) = oneshot::channel();
        let command = Command::Own {
            resource,
            record,
            keep,
            answer,
        };
        // A driver that has ended answers nothing.
        let _ = self.locks()?.commands.send(command);
        Ok(owned.await.map_err(|_| Error::Ended)??)
    }

    /// Others expect answers of an agent of the type [`AGENT_TYPE`] from the beginning.
    pub(crate) fn with_locks(self) -> Result<Agent, Error> {
        self.locks()?;
        Ok(self)
    }

    /// The locks, whose driver begins when they are needed first.
    fn locks(&self) -> Result<&Locks, Error> {
        if let Some(locks) = self.locks.get() {
            return Ok(locks);
        }
        let mut config = Config::new(self.name.clone(), 0);
        let mut random = [0; 8];
        getrandom::fill(&mut random).map_err(|error| Error::Random(error.to_string()))?;
        config.heartbeat = HEARTBEAT;
        config.first_conversation = u64::from_be_bytes(random) >> 16;
        Ok(self.locks.get_or_init(|| {
            let machine = Machine {
                agent: Arc::new(Mutex::new(LockAgent::new(config))),
                clock: self.platform.clock,
            };
            let (commands, receiver) = mpsc::unbounded_channel();
            let driver = Driver::new(self, machine.clone(), receiver);
            Locks {
                commands,
                machine,
                driver: tokio::spawn(driver.run()).abort_handle(),
                requests: AtomicU64::new(0),
            }
        }))
    }
}
