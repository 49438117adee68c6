use std::sync::Arc;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::Pattern;
use tokio::runtime::Runtime;

use super::Agent;
use crate::locks::{Algorithm, Keep, LockError, LossReason, OwnError};

/// A resource to be asked for, by [`acquire`](LockRequest::acquire); otherwise a
/// [`LockRequest`](crate::locks::LockRequest).
#[must_use = "the request is made by `acquire`"]
pub struct LockRequest<'a> {
    request: crate::locks::LockRequest<'a>,
    runtime: &'a Arc<Runtime>,
}

/// A resource that is held, a [`Guard`](crate::locks::Guard) whose methods block: until this is
/// dropped or [released](Guard::release), the agent goes, or it is lost.
#[must_use = "the resource is given back when the guard is dropped"]
pub struct Guard {
    guard: crate::locks::Guard,
    runtime: Arc<Runtime>,
}

impl Agent {
    /// Asks for a resource that some agent owns ([`lock`](crate::Agent::lock)).
    pub fn lock(&self, resource: impl Into<Text>) -> LockRequest<'_> {
        LockRequest {
            request: self.agent.lock(resource),
            runtime: &self.runtime,
        }
    }

    /// Owns a resource from now on, until the agent goes ([`own`](crate::Agent::own)).
    ///
    /// # Errors
    /// The resource has no name, or there are too many; what was kept of it cannot be read; the
    /// platform has ended.
    pub fn own(&self, resource: impl Into<Text>, keep: Arc<dyn Keep>) -> Result<(), OwnError> {
        self.runtime.block_on(self.agent.own(resource, keep))
    }
}

impl<'a> LockRequest<'a> {
    /// How the agents agree; all must do it in the same way. Default: Ricart and Agrawala's
    /// algorithm, extended.
    pub fn algorithm(self, algorithm: Algorithm) -> Self {
        self.but(|request| request.algorithm(algorithm))
    }

    /// Who may want it and who may own it: the agents whose names match, in place of those of the
    /// type [`AGENT_TYPE`](crate::locks::AGENT_TYPE).
    pub fn with(self, names: Pattern) -> Self {
        self.but(|request| request.with(names))
    }

    /// How long it is waited for. Default: until it is granted, or it is known why it will not be.
    pub fn timeout(self, timeout: Duration) -> Self {
        self.but(|request| request.timeout(timeout))
    }

    /// How often the agents that depend on each other ask whether the others live
    /// ([`heartbeat`](crate::locks::LockRequest::heartbeat)).
    pub fn heartbeat(self, heartbeat: Duration) -> Self {
        self.but(|request| request.heartbeat(heartbeat))
    }

    fn but(
        self,
        change: impl FnOnce(crate::locks::LockRequest<'a>) -> crate::locks::LockRequest<'a>,
    ) -> Self {
        let LockRequest { request, runtime } = self;
        let request = change(request);
        LockRequest { request, runtime }
    }

    /// Makes the request, and waits for what becomes of it.
    ///
    /// # Errors
    /// It cannot be asked for, or is not granted, or not in time; the platform has ended.
    pub fn acquire(self) -> Result<Guard, LockError> {
        let LockRequest { request, runtime } = self;
        let guard = runtime.block_on(request.into_future())?;
        Ok(Guard {
            guard,
            runtime: Arc::clone(runtime),
        })
    }
}

impl Guard {
    /// The resource.
    pub fn resource(&self) -> &Text {
        self.guard.resource()
    }

    /// The number of this grant ([`fencing`](crate::locks::Guard::fencing)).
    pub fn fencing(&self) -> Option<u64> {
        self.guard.fencing()
    }

    /// Whether it is held now. Never waits: a control loop asks in each of its turns.
    pub fn is_held(&self) -> bool {
        self.guard.is_held()
    }

    /// Waits until it is lost, and says why. Whatever uses the resource stops then.
    pub fn lost(&self) -> LossReason {
        self.runtime.block_on(self.guard.lost())
    }

    /// Waits until it is lost; `None` when the time is over.
    pub fn lost_within(&self, timeout: Duration) -> Option<LossReason> {
        let wait = async { tokio::time::timeout(timeout, self.guard.lost()).await };
        self.runtime.block_on(wait).ok()
    }

    /// Gives it back, and waits until those who are to know have been told, a second at most.
    /// Dropping the guard gives it back as well, without waiting.
    pub fn release(self) {
        self.runtime.block_on(self.guard.release());
    }
}
