//! The same platform and agents for programs that do not know async, such as control loops.
//!
//! ```
//! use fipa::blocking::Platform;
//! use fipa::{Message, Performative};
//! use std::time::Duration;
//!
//! let robot1 = Platform::start(fipa::Platform::builder().name("robot1").mdns(false)).unwrap();
//! let arm = robot1.agent("arm@robot1").unwrap();
//! let outcomes = arm.send(Message::new(Performative::Inform).to("arm@robot1").content("tick"));
//! assert!(outcomes[0].outcome.is_success());
//! let message = arm.receive_timeout(Duration::from_secs(1)).unwrap().unwrap();
//! assert_eq!(message.content_str(), Some("tick"));
//! assert!(arm.try_receive().is_none());
//! ```
//!
//! [Locks](crate::locks) likewise:
//!
//! ```
//! use fipa::blocking::Platform;
//! use fipa::locks;
//! use std::sync::Arc;
//!
//! let robot1 = Platform::start(fipa::Platform::builder().name("robot1").mdns(false)).unwrap();
//! let owner = robot1.register(locks::registration("locks@robot1")).unwrap();
//! owner.own("gripper", Arc::new(locks::Forgetful::new())).unwrap();
//!
//! let arm = robot1.register(locks::registration("arm@robot1")).unwrap();
//! let guard = arm.lock("gripper").acquire().unwrap();
//! assert!(guard.is_held());
//! guard.release();
//! ```

mod locks;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{Message, Text};
use fipa_directory::{PatternError, Record};
use fipa_link::ReceiverOutcome;
use fipa_mts::Registration;
use tokio::runtime::Runtime;

use crate::{
    ConversationError, Error, Incoming, Monitoring, PlatformBuilder, ReceiveError, RequestError,
    TrySendError,
};

pub use self::locks::{Guard, LockRequest};

/// A [`Platform`](crate::Platform) with a thread of its own.
#[derive(Clone)]
pub struct Platform {
    platform: crate::Platform,
    runtime: Arc<Runtime>,
}

/// An [`Agent`](crate::Agent) whose methods block.
pub struct Agent {
    agent: crate::Agent,
    runtime: Arc<Runtime>,
}

impl Platform {
    /// Starts a platform in this process.
    pub fn start(builder: PlatformBuilder) -> Result<Platform, Error> {
        let runtime = runtime()?;
        let platform = runtime.block_on(builder.start())?;
        Ok(Platform { platform, runtime })
    }

    /// Attaches to the daemon at its usual control socket.
    pub fn attach() -> Result<Platform, Error> {
        Platform::attach_to(crate::default_control_path())
    }

    /// Attaches to the daemon at this control socket.
    pub fn attach_to(control: impl AsRef<Path>) -> Result<Platform, Error> {
        let runtime = runtime()?;
        let platform = runtime.block_on(crate::Platform::attach_to(control))?;
        Ok(Platform { platform, runtime })
    }

    /// Registers an agent under this name.
    pub fn agent(&self, name: impl Into<Text>) -> Result<Agent, Error> {
        self.register(Registration::new(name))
    }

    /// Registers an agent with a description and service type of its own.
    pub fn register(&self, registration: Registration) -> Result<Agent, Error> {
        let agent = self
            .runtime
            .block_on(self.platform.register(registration))?;
        Ok(Agent {
            agent,
            runtime: Arc::clone(&self.runtime),
        })
    }

    /// The agents whose name matches all of a regular expression, by name.
    pub fn search(&self, pattern: &str) -> Result<Vec<Record>, PatternError> {
        self.platform.search(pattern)
    }

    /// The agents that are gone and whose name matches all of a regular expression, by name
    /// ([`search_gone`](crate::Platform::search_gone)).
    pub fn search_gone(&self, pattern: &str) -> Result<Vec<Record>, PatternError> {
        self.platform
            .search_gone(pattern, fipa_directory::Field::Name)
    }

    /// Waits until an agent of exactly this name is known; `None` when the time is over.
    pub fn wait_for(&self, name: &str, timeout: Duration) -> Option<Record> {
        let wait = async { tokio::time::timeout(timeout, self.platform.wait_for(name)).await };
        self.runtime.block_on(wait).ok().flatten()
    }

    /// Deregisters everything and says goodbye.
    pub fn shutdown(self) {
        self.runtime.block_on(self.platform.shutdown());
    }
}

impl Agent {
    /// The agent's name.
    pub fn name(&self) -> &Text {
        self.agent.name()
    }

    /// Sends a message and waits for what becomes of it, 10 s at most.
    pub fn send(&self, message: Message) -> Vec<ReceiverOutcome> {
        self.runtime.block_on(self.agent.send(message))
    }

    /// Sends a message and waits for what becomes of it, for so long at most.
    pub fn send_within(&self, message: Message, timeout: Duration) -> Vec<ReceiverOutcome> {
        self.runtime
            .block_on(self.agent.send_within(message, timeout))
    }

    /// Hands a message over without waiting ([`try_send`](crate::Agent::try_send)); what becomes of
    /// it is not told.
    pub fn try_send(&self, message: Message) -> Result<(), TrySendError> {
        // The letter stays under way.
        self.agent.try_send(message).map(drop)
    }

    /// Waits for the next message.
    pub fn receive(&self) -> Result<Message, ReceiveError> {
        self.runtime.block_on(self.agent.receive())
    }

    /// Waits for the next message; `None` when the time is over.
    pub fn receive_timeout(&self, timeout: Duration) -> Option<Result<Message, ReceiveError>> {
        let wait = async { tokio::time::timeout(timeout, self.agent.receive()).await };
        self.runtime.block_on(wait).ok()
    }

    /// The next message if one is there that can be read. Never waits.
    pub fn try_receive(&self) -> Option<Message> {
        loop {
            let (_, message) = self.agent.try_receive()?;
            match message {
                Ok(message) => return Some(message),
                Err(reason) => tracing::warn!("{}: unreadable letter: {reason}", self.name()),
            }
        }
    }

    /// Deregisters the agent and hands over what it has not received yet
    /// ([`leave`](crate::Agent::leave)).
    pub fn leave(self) -> Vec<Incoming> {
        self.runtime.block_on(self.agent.leave())
    }

    /// Sends a message to one agent and waits for its answer until the deadline.
    pub fn request(&self, message: Message, deadline: Duration) -> Result<Message, RequestError> {
        self.runtime.block_on(self.agent.request(message, deadline))
    }

    /// Has another agent do something, and waits for the end of it
    /// ([`perform`](crate::Agent::perform)).
    pub fn perform(
        &self,
        order: Message,
        deadline: Duration,
    ) -> Result<Message, ConversationError> {
        self.runtime.block_on(self.agent.perform(order, deadline))
    }

    /// Asks another agent a question, and waits for its answer ([`query`](crate::Agent::query)).
    pub fn query(
        &self,
        question: Message,
        deadline: Duration,
    ) -> Result<Message, ConversationError> {
        self.runtime.block_on(self.agent.query(question, deadline))
    }

    /// Proposes something to another agent, and waits until it has accepted
    /// ([`propose`](crate::Agent::propose)).
    pub fn propose(
        &self,
        proposal: Message,
        deadline: Duration,
    ) -> Result<Message, ConversationError> {
        self.runtime
            .block_on(self.agent.propose(proposal, deadline))
    }

    /// What becomes of messages that violate their interaction protocols
    /// ([`set_monitoring`](crate::Agent::set_monitoring)).
    pub fn set_monitoring(&self, monitoring: Monitoring) {
        self.agent.set_monitoring(monitoring);
    }
}

/// One thread runs links and timers while the program is elsewhere.
fn runtime() -> Result<Arc<Runtime>, Error> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .thread_name("fipa")
        .enable_all()
        .build()
        .map(Arc::new)
        .map_err(Error::Runtime)
}
