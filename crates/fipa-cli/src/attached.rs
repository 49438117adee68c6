//! What the commands have in common that talk to a daemon.

use std::future::Future;
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use fipa::{Agent, Error, Platform, Registration, Text};
use serde_json::Value;
use tokio::signal::unix::{SignalKind, signal};

use crate::Failure;

/// Where the daemon is.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Control {
    /// The daemon's control socket
    #[arg(long, value_name = "PATH", env = "FIPAD_CONTROL")]
    control: Option<PathBuf>,
}

impl Control {
    /// Attaches to the daemon; without one the error says no more than that.
    pub(crate) async fn try_attach(&self) -> Result<Platform, Error> {
        match &self.control {
            Some(path) => Platform::attach_to(path).await,
            None => Platform::attach().await,
        }
    }

    /// Attaches to the daemon.
    pub(crate) async fn attach(&self) -> Result<Platform, Failure> {
        self.try_attach().await.map_err(|error| match error {
            Error::NoDaemon { .. } => {
                Failure::environment(format_args!("{error}; start one with `fipad`"))
            }
            error => Failure::environment(error),
        })
    }
}

/// Runs a command that waits.
pub(crate) fn run<T>(command: impl Future<Output = Result<T, Failure>>) -> Result<T, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(Failure::environment)?;
    let result = runtime.block_on(command);
    // Reading standard input cannot be broken off, and nobody needs to wait for it.
    runtime.shutdown_background();
    result
}

/// Registers an agent. A name that somebody holds is a "no", one that cannot be is wrong usage.
pub(crate) async fn register(
    platform: &Platform,
    name: &str,
    description: Option<&str>,
) -> Result<Agent, Failure> {
    let mut registration = Registration::new(name);
    if let Some(description) = description {
        registration.description = Text::from(description);
    }
    platform.register(registration).await.map_err(failure_of)
}

pub(crate) fn failure_of(error: Error) -> Failure {
    match error {
        Error::Register(fipa::RegisterError::Name(_)) => Failure::malformed(error),
        Error::Register(fipa::RegisterError::NoDaemon) => Failure::environment(error),
        Error::Register(_) => Failure::no(error),
        error => Failure::environment(error),
    }
}

/// Tells on standard error that letters can reach the agent.
pub(crate) fn say_attached(agent: &Agent) {
    // Nobody needs to listen there.
    let _ = writeln!(io::stderr(), "attached {}", agent.name());
}

/// Waits for SIGINT or SIGTERM. Made before it is waited for, so that none is missed.
pub(crate) fn interrupted() -> Result<impl Future<Output = ()>, Failure> {
    let mut interrupt = signal(SignalKind::interrupt()).map_err(Failure::environment)?;
    let mut terminate = signal(SignalKind::terminate()).map_err(Failure::environment)?;
    Ok(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
    })
}

/// `fipa-<purpose><pid>@<hostname>`, the name of a command's own agent.
pub(crate) fn own_name(purpose: &str) -> String {
    let host = gethostname::gethostname();
    let host = host.to_string_lossy();
    let name = format!("fipa-{purpose}{}@{host}", std::process::id());
    match Text::from(name.as_str()).is_word() {
        true => name,
        // A host may be called what no agent can be.
        false => format!("fipa-{purpose}{}@localhost", std::process::id()),
    }
}

/// A number of seconds on the command line.
pub(crate) fn seconds(text: &str) -> Result<Duration, String> {
    let wrong = || format!("{text:?} is no number of seconds");
    let seconds: f64 = text.parse().map_err(|_| wrong())?;
    Duration::try_from_secs_f64(seconds).map_err(|_| wrong())
}

/// Writes one line at once: whoever reads it may wait for it.
pub(crate) fn print_line(line: impl std::fmt::Display) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()?;
    Ok(())
}

/// Writes one JSON object on a line of its own.
pub(crate) fn print_json(value: &Value) -> Result<(), Failure> {
    print_line(value)
}
