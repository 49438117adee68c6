use std::path::Path;
use std::sync::Arc;

use fipa_acl::Text;
use fipa_directory::{Address, Change, Field, InstanceId, Now, Pattern, PatternError, Record};
use fipa_link::Inside;
use fipa_mts::{Notice, Program, ProgramConfig, Registration};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

use crate::agent::Agent;
use crate::backend::Backend;
use crate::clock::Clock;
use crate::node::{Hub, Node};
use crate::room::Room;
use crate::security::Security;
use crate::{CalledBack, Error, PlatformBuilder, Sniffer};

/// A platform: the place where agents live.
///
/// It is either in this process ([`builder`](Platform::builder)), with a message transport service
/// of its own, or a daemon on this machine ([`attach`](Platform::attach)). Agents do not see the
/// difference. When the last clone is dropped, or at [`shutdown`](Platform::shutdown), everything
/// is deregistered.
///
/// ```
/// # async fn example() -> Result<(), fipa::Error> {
/// use fipa::{Message, Performative, Platform};
///
/// let platform = Platform::builder().name("robot1").start().await?;
/// let arm = platform.agent("arm@robot1").await?;
/// let drive = platform.agent("drive@robot1").await?;
/// let outcomes = arm
///     .send(Message::new(Performative::Inform).to("drive@robot1").content("ready"))
///     .await;
/// assert!(outcomes[0].outcome.is_success());
/// assert_eq!(drive.receive().await.unwrap().content_str(), Some("ready"));
/// # Ok(()) }
/// # tokio::runtime::Runtime::new().unwrap().block_on(example()).unwrap();
/// ```
#[derive(Clone)]
pub struct Platform {
    inner: Arc<Inner>,
}

pub(crate) struct Inner {
    pub(crate) backend: Backend,
    pub(crate) clock: Clock,
    /// For what is sent without an agent.
    room: Room,
    tasks: std::sync::Mutex<Vec<JoinHandle<()>>>,
    goodbye: std::sync::Mutex<Option<tokio::sync::oneshot::Sender<()>>>,
    discovery: std::sync::Mutex<Option<JoinHandle<()>>>,
}

impl Platform {
    /// Heeds what the membership in a fleet has learned to be revoked, and what has expired: links
    /// with such robots end, and the others are told. Nothing without a fleet.
    #[cfg(feature = "tls")]
    pub fn check_fleet(&self) {
        if let Backend::Service(node) = &self.inner.backend {
            node.check_fleet();
        }
    }

    /// Begins to describe a platform in this process.
    pub fn builder() -> PlatformBuilder {
        PlatformBuilder::new()
    }

    /// Attaches to the daemon at its usual control socket
    /// ([`default_control_path`](crate::default_control_path)).
    pub async fn attach() -> Result<Platform, Error> {
        Platform::attach_to(crate::default_control_path()).await
    }

    /// Attaches to the daemon at this control socket. When the daemon ends, it is looked for for
    /// 30 s, and agents are attached again.
    pub async fn attach_to(control: impl AsRef<Path>) -> Result<Platform, Error> {
        let path = control.as_ref().to_owned();
        let mut random = [0; 16];
        getrandom::fill(&mut random).map_err(|error| Error::Random(error.to_string()))?;
        let name = format!("program-{}", std::process::id());
        let address = Address::Unix(path.to_string_lossy().into_owned());
        let config = ProgramConfig::new(InstanceId::from_bytes(random), name, address);
        let clock = Clock::start();
        let mut hub = Hub::default();
        // The daemon may have answered before anything more is done here.
        let (mut notices, mut changes) = (hub.notices(), hub.changes());
        let node = Node::start(
            clock,
            Program::new(config, clock.now()),
            hub,
            Security::default(),
        );
        loop {
            match notices.recv().await {
                Some(Notice::DaemonUp) => break,
                Some(Notice::DaemonGivenUp { reason }) => {
                    let reason = reason.to_string();
                    return Err(Error::NoDaemon { path, reason });
                }
                Some(_) => {}
                None => return Err(Error::Ended),
            }
        }
        // The directory is the first thing that a daemon sends. An empty one brings no change, so
        // its coming is asked for, not waited for.
        while !node.with(|_, program, _| program.has_directory()) {
            if node.with(|_, _, hub| hub.has_ended()) {
                return Err(Error::Ended);
            }
            tokio::select! {
                _ = changes.recv() => {}
                () = tokio::time::sleep(std::time::Duration::from_millis(5)) => {}
            }
        }
        Ok(Platform::new(
            Backend::Program(node),
            clock,
            Vec::new(),
            None,
        ))
    }

    pub(crate) fn new(
        backend: Backend,
        clock: Clock,
        tasks: Vec<JoinHandle<()>>,
        discovery: Option<(tokio::sync::oneshot::Sender<()>, JoinHandle<()>)>,
    ) -> Platform {
        let (goodbye, discovery) = discovery.unzip();
        Platform {
            inner: Arc::new(Inner {
                backend,
                clock,
                room: Room::default(),
                tasks: std::sync::Mutex::new(tasks),
                goodbye: std::sync::Mutex::new(goodbye),
                discovery: std::sync::Mutex::new(discovery),
            }),
        }
    }

    /// The name of the message transport service.
    pub fn name(&self) -> Text {
        self.inner
            .backend
            .with(|_, machine, _| machine.service_name())
    }

    /// Where other platforms reach this one now; empty for an attached one. One that listens on
    /// every address of the machine follows what becomes of those.
    pub fn endpoints(&self) -> Vec<Address> {
        match &self.inner.backend {
            Backend::Service(node) => node.with(|_, mts, _| mts.config().endpoints.clone()),
            Backend::Program(_) => Vec::new(),
        }
    }

    /// Under which URLs letters are posted to this platform over HTTP now; empty where it takes
    /// none, and for an attached one.
    pub fn http_urls(&self) -> Vec<Address> {
        match &self.inner.backend {
            Backend::Service(node) => node.with(|_, mts, _| mts.config().http.clone()),
            Backend::Program(_) => Vec::new(),
        }
    }

    /// Registers an agent under this name.
    pub async fn agent(&self, name: impl Into<Text>) -> Result<Agent, Error> {
        self.register(Registration::new(name)).await
    }

    /// Registers an agent with a description and service type of its own.
    pub async fn register(&self, registration: Registration) -> Result<Agent, Error> {
        let name = registration.name.clone();
        let locks = registration.kind == *crate::locks::AGENT_TYPE;
        let (answer, mail) = self.inner.backend.with(|now, machine, hub| {
            let mail = hub.on_mail(&name);
            let (ticket, answer) = hub.expect_registration();
            machine.register(now, ticket, registration);
            (answer, mail)
        });
        // Dropped while waiting: the agent goes again.
        let agent = Agent::new(Arc::clone(&self.inner), name, mail);
        match answer.await {
            Ok(Ok(())) if locks => agent.with_locks(),
            Ok(Ok(())) => Ok(agent),
            Ok(Err(error)) => {
                agent.disown();
                Err(error.into())
            }
            Err(_) => Err(Error::Ended),
        }
    }

    /// Sends a message in the name that it bears, without an agent of its own; answers go to
    /// whoever holds that name.
    pub async fn send_as(
        &self,
        message: fipa_acl::Message,
        timeout: std::time::Duration,
    ) -> Vec<fipa_link::ReceiverOutcome> {
        crate::sending::send(&self.inner, &self.inner.room, message, timeout).await
    }

    /// What the directory holds for exactly this name.
    pub fn find(&self, name: &str) -> Option<Record> {
        self.inner
            .backend
            .with(|_, machine, _| machine.directory().find(name).cloned())
    }

    /// The agents whose name matches all of a regular expression, by name.
    pub fn search(&self, pattern: &str) -> Result<Vec<Record>, PatternError> {
        self.search_field(pattern, Field::Name)
    }

    /// The agents of which a field matches all of a regular expression, by name.
    pub fn search_field(&self, pattern: &str, field: Field) -> Result<Vec<Record>, PatternError> {
        let pattern = Pattern::new(pattern)?;
        let mut found: Vec<Record> = self.inner.backend.with(|_, machine, _| {
            let directory = machine.directory();
            directory.search(&pattern, field).cloned().collect()
        });
        found.sort_by(|a, b| a.entry.name.cmp(&b.entry.name));
        Ok(found)
    }

    /// The agents that are gone and of which a field matches all of a regular expression, by name:
    /// those that went within the last 24 hours, a thousand at most. The
    /// [`since`](Record::since) of each is when it went.
    pub fn search_gone(&self, pattern: &str, field: Field) -> Result<Vec<Record>, PatternError> {
        let pattern = Pattern::new(pattern)?;
        let mut found: Vec<Record> = self.inner.backend.with(|now, machine, _| {
            let gone = machine.directory().tombstones(now);
            let found = gone.filter(|record| pattern.matches_field(record, field));
            found.cloned().collect()
        });
        found.sort_by(|a, b| a.entry.name.cmp(&b.entry.name));
        Ok(found)
    }

    /// Waits until an agent of exactly this name is known. Cancel-safe.
    pub async fn wait_for(&self, name: &str) -> Option<Record> {
        let mut changes = self.watch();
        loop {
            if let Some(record) = self.find(name) {
                return Some(record);
            }
            changes.next().await?;
        }
    }

    /// What changes in the directory from now on.
    pub fn watch(&self) -> Changes {
        Changes(self.inner.backend.with(|_, _, hub| hub.changes()))
    }

    /// What happens to links and peers from now on.
    pub fn notices(&self) -> Notices {
        Notices(self.inner.backend.with(|_, _, hub| hub.notices()))
    }

    /// What the message transport service knows of itself and of others, for people who look for a
    /// fault. `None` from a daemon that does not answer: it is too old for that, or stands still.
    pub async fn facts(&self) -> Option<fipa_link::Facts> {
        let answer = match &self.inner.backend {
            Backend::Service(node) => return Some(node.with(|now, mts, _| mts.facts(now))),
            Backend::Program(node) => node.with(|now, program, hub| {
                program.ask_facts(now);
                hub.expect_facts()
            }),
        };
        let patience = std::time::Duration::from_secs(2);
        tokio::time::timeout(patience, answer).await.ok()?.ok()
    }

    /// Watches what passes the message transport service from now on: letters, and what devices of
    /// the robot say and are told. [`Passed::Begin`](crate::Passed::Begin) comes first. There is
    /// one sniffer at a time: of two the later one goes on.
    pub fn sniff(&self) -> Sniffer {
        Sniffer::new(&self.inner)
    }

    /// Whether somebody watches what passes. An attached platform does not know, and says no.
    pub fn is_watched(&self) -> bool {
        match &self.inner.backend {
            Backend::Service(node) => node.with(|_, mts, _| mts.is_watched()),
            Backend::Program(_) => false,
        }
    }

    /// Shows a message between this platform and a device of its robot to those who watch. It is
    /// not asked for while nobody does. An attached platform has no devices, and shows nothing.
    pub fn passed_inside(&self, message: impl FnOnce() -> Inside) {
        if let Backend::Service(node) = &self.inner.backend {
            node.with(|now, mts, _| {
                if mts.is_watched() {
                    mts.passed_inside(now, message());
                }
            });
        }
    }

    /// Whether the platform `whom`, with which there is a link, reaches this one: it calls back
    /// where this one says it is, if that is the host that the link comes from. `None` from a
    /// platform or a daemon that does not answer: it is too old for that, or stands still.
    pub async fn call_back(&self, whom: InstanceId) -> Option<CalledBack> {
        let answer = match &self.inner.backend {
            Backend::Service(node) => node.with(|now, mts, hub| {
                let (ticket, answer) = hub.expect_call_back();
                mts.ask_call_back(now, ticket, whom);
                answer
            }),
            Backend::Program(node) => node.with(|now, program, hub| {
                let (ticket, answer) = hub.expect_call_back();
                program.ask_call_back(now, ticket, whom);
                answer
            }),
        };
        // An address may take 6 s.
        let patience = std::time::Duration::from_secs(8);
        tokio::time::timeout(patience, answer).await.ok()?.ok()
    }

    /// The time, as the ages in records are counted.
    pub fn now(&self) -> Now {
        self.inner.clock.now()
    }

    /// Deregisters everything, says goodbye to everybody, and waits until that is said, two
    /// seconds at most.
    pub async fn shutdown(self) {
        self.inner.stop();
        let tasks = std::mem::take(&mut *lock(&self.inner.tasks));
        for task in tasks {
            // Aborted; with it the socket is closed, and a control socket's file is gone.
            let _ = task.await;
        }
        let discovery = lock(&self.inner.discovery).take();
        if let Some(task) = discovery {
            let _ = tokio::time::timeout(std::time::Duration::from_secs(2), task).await;
        }
        self.inner
            .backend
            .wait_closed(std::time::Duration::from_secs(1))
            .await;
        if let Backend::Service(node) = &self.inner.backend {
            node.close_store().await;
        }
    }
}

impl Inner {
    fn stop(&self) {
        lock(&self.tasks).iter().for_each(JoinHandle::abort);
        if let Some(goodbye) = lock(&self.goodbye).take() {
            // The task may have ended by itself.
            let _ = goodbye.send(());
        }
        self.backend.with(|now, machine, _| machine.shutdown(now));
        // Whoever watches has been told the last by now.
        self.backend.with(|_, _, hub| hub.end());
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.stop();
    }
}

fn lock<T>(mutex: &std::sync::Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The changes of a directory, as they happen.
#[derive(Debug)]
pub struct Changes(mpsc::UnboundedReceiver<Change>);

impl Changes {
    /// The next change; `None` once the platform has ended. Cancel-safe.
    pub async fn next(&mut self) -> Option<Change> {
        self.0.recv().await
    }
}

/// What happens to links and peers, as it happens.
#[derive(Debug)]
pub struct Notices(mpsc::UnboundedReceiver<Notice>);

impl Notices {
    /// The next notice; `None` once the platform has ended. Cancel-safe.
    pub async fn next(&mut self) -> Option<Notice> {
        self.0.recv().await
    }
}
