//! `fipa lock`: a command that runs while a resource is held, and who holds what.
//!
//! ```text
//!   request ──▶ granted ──▶ COMMAND runs ──▶ ended ──▶ given back
//!                              ├── lost: SIGTERM, half a heartbeat later SIGKILL
//!                              ├── signals to us go to it
//!                              └── we are killed: it is killed by the system (`held`)
//! ```

pub(crate) mod held;
mod list;

use std::ffi::OsString;
use std::io::{self, IsTerminal, Write};
use std::os::unix::process::ExitStatusExt;
use std::process::{ExitCode, ExitStatus};
use std::time::Duration;

use fipa::locks::{self, Algorithm, FailureReason, Guard, LockError};
use fipa::{Agent, Pattern, Registration, Text};
use rustix::process::{Pid, Signal, kill_process};
use tokio::process::{Child, Command};
use tokio::signal::unix::{self, SignalKind};
use tokio::sync::mpsc;

use crate::Failure;
use crate::attached::{self, Control};

/// The options of `fipa lock`.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    list: Option<Subcommand>,
    /// The resource that is wanted
    #[arg(value_name = "RESOURCE", required = true)]
    resource: Option<String>,
    /// The agent's name, used as it is
    #[arg(long = "as", value_name = "NAME", required = true)]
    name: Option<String>,
    #[command(flatten)]
    take: Take,
}

#[derive(Debug, clap::Subcommand)]
enum Subcommand {
    /// Show what agents own, who holds it, and who waits
    List(list::Args),
}

/// How it is taken, and what is done then.
#[derive(Debug, clap::Args)]
struct Take {
    /// How the agents agree
    #[arg(long, value_enum, default_value = "ricart-agrawala")]
    algorithm: AlgorithmName,
    /// The agents that may want or own it, in place of those of the type fipa-lock; C++ robots have
    /// to be named so
    #[arg(long, value_name = "REGEX", value_parser = Pattern::new)]
    with: Option<Pattern>,
    /// Wait for so many seconds at most [default: until it is granted or refused]
    #[arg(long, value_name = "S", value_parser = attached::seconds)]
    timeout: Option<Duration>,
    /// Ask every so many seconds whether the others live; a grant lasts three of these
    #[arg(long, value_name = "S", value_parser = heartbeat, default_value = "5")]
    heartbeat: Duration,
    #[command(flatten)]
    control: Control,
    /// What is run while it is held, with the number of the grant in FIPA_LOCK_FENCING. When the
    /// lock is lost, it gets SIGTERM, and half a heartbeat later SIGKILL
    #[arg(last = true, required = true, value_name = "COMMAND")]
    command: Vec<OsString>,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum AlgorithmName {
    /// All others agree
    RicartAgrawala,
    /// A token goes round
    SuzukiKasami,
}

impl From<AlgorithmName> for Algorithm {
    fn from(name: AlgorithmName) -> Algorithm {
        match name {
            AlgorithmName::RicartAgrawala => Algorithm::RicartAgrawalaExtended,
            AlgorithmName::SuzukiKasami => Algorithm::SuzukiKasamiExtended,
        }
    }
}

fn heartbeat(text: &str) -> Result<Duration, String> {
    let heartbeat = attached::seconds(text)?;
    match (0.01..=3600.0).contains(&heartbeat.as_secs_f64()) {
        true => Ok(heartbeat),
        false => Err("a heartbeat takes between 0.01 s and an hour".to_owned()),
    }
}

/// Runs the command while the resource is held; or lists what is owned.
pub fn run(args: &Args) -> Result<ExitCode, Failure> {
    if let Some(Subcommand::List(list)) = &args.list {
        return list::run(list).map(|()| ExitCode::SUCCESS);
    }
    let (Some(resource), Some(name)) = (&args.resource, &args.name) else {
        return Err(Failure::malformed("a resource and --as are needed"));
    };
    let taking = Taking {
        resource,
        name,
        take: &args.take,
    };
    attached::run(taking.run())
}

/// A resource that is taken.
struct Taking<'a> {
    resource: &'a str,
    name: &'a str,
    take: &'a Take,
}

impl Taking<'_> {
    async fn run(&self) -> Result<ExitCode, Failure> {
        let mut signals = Signals::new()?;
        let platform = self.take.control.attach().await?;
        let registration = Registration {
            description: Text::from(format!("wants {}", self.resource)),
            ..locks::registration(self.name)
        };
        let agent = platform.register(registration).await;
        let agent = agent.map_err(attached::failure_of)?;
        let code = tokio::select! {
            code = self.take(&agent, &mut signals) => code,
            never = discard_mail(&agent) => never,
        };
        drop(agent);
        platform.shutdown().await;
        code
    }

    async fn take(&self, agent: &Agent, signals: &mut Signals) -> Result<ExitCode, Failure> {
        let mut request = agent
            .lock(self.resource)
            .algorithm(self.take.algorithm.into())
            .heartbeat(self.take.heartbeat);
        if let Some(names) = &self.take.with {
            request = request.with(names.clone());
        }
        if let Some(timeout) = self.take.timeout {
            request = request.timeout(timeout);
        }
        let granted = tokio::select! {
            granted = request.into_future() => granted.map_err(|error| self.not_granted(error))?,
            _ = signals.next() => {
                let why = "interrupted before it was granted";
                return Err(Failure::no(format_args!("{}: {why}", self.resource)));
            }
        };
        if granted.fencing().is_none() {
            self.say("its owner gives no number; if we are taken for dead, two may use it");
        }
        let code = self.hold(&granted, signals).await;
        granted.release().await;
        code
    }

    fn not_granted(&self, error: LockError) -> Failure {
        let line = format!("{}: {error}", self.resource);
        match error {
            LockError::Request(_) | LockError::Heartbeat(_) => Failure::malformed(line),
            LockError::Failed(FailureReason::Disconnected) | LockError::Platform(_) => {
                Failure::environment(line)
            }
            _ => Failure::no(line),
        }
    }

    async fn hold(&self, guard: &Guard, signals: &mut Signals) -> Result<ExitCode, Failure> {
        let mut child = self.start(guard.fencing())?;
        let ended = loop {
            tokio::select! {
                // A command that ended after the loss did not have it to its end.
                biased;
                reason = guard.lost() => {
                    self.say(&format!("it is lost: {reason}"));
                    self.stop(&mut child).await?;
                    return Ok(ExitCode::FAILURE);
                }
                ended = child.wait() => break ended.map_err(Failure::environment)?,
                arrived = signals.next() => if !arrived.known {
                    send(&child, arrived.signal);
                },
            }
        };
        if !guard.is_held() {
            self.say(&format!("it is lost: {}", guard.lost().await));
            return Ok(ExitCode::FAILURE);
        }
        Ok(code(ended))
    }

    fn start(&self, fencing: Option<u64>) -> Result<Child, Failure> {
        let program = std::env::current_exe().map_err(Failure::environment)?;
        let mut command = Command::new(program);
        command.args(held::words()).args(&self.take.command);
        match fencing {
            Some(number) => command.env("FIPA_LOCK_FENCING", number.to_string()),
            None => command.env_remove("FIPA_LOCK_FENCING"),
        };
        command.spawn().map_err(Failure::environment)
    }

    /// The command must not go on: within a heartbeat of the loss another agent may have the
    /// resource.
    async fn stop(&self, child: &mut Child) -> Result<(), Failure> {
        send(child, Signal::TERM);
        // The owner may count by a shorter one.
        let heartbeat = self.take.heartbeat.min(locks::HEARTBEAT);
        if tokio::time::timeout(heartbeat / 2, child.wait())
            .await
            .is_err()
        {
            child.kill().await.map_err(Failure::environment)?;
        }
        Ok(())
    }

    /// One line on standard error, at once.
    fn say(&self, what: &str) {
        // Nobody needs to listen there.
        let _ = writeln!(io::stderr(), "fipa lock: {}: {what}", self.resource);
    }
}

/// What others send beside the messages of the lock; ends with the daemon only.
async fn discard_mail(agent: &Agent) -> ! {
    loop {
        if let Err(fipa::ReceiveError::Ended) = agent.receive().await {
            // The lock says that it is lost, or not granted.
            std::future::pending::<()>().await;
        }
    }
}

fn send(child: &Child, signal: Signal) {
    let pid = child.id().and_then(|id| i32::try_from(id).ok());
    if let Some(pid) = pid.and_then(Pid::from_raw) {
        // It may have ended by itself.
        let _ = kill_process(pid, signal);
    }
}

/// The command's own exit code, or 128 and the signal that it died of.
fn code(ended: ExitStatus) -> ExitCode {
    let signal = ended.signal().unwrap_or_default();
    let code = ended.code().unwrap_or(128 + signal);
    ExitCode::from(u8::try_from(code).unwrap_or(1))
}

/// The signals that are for the command.
struct Signals(mpsc::UnboundedReceiver<Arrived>);

#[derive(Clone, Copy)]
struct Arrived {
    signal: Signal,
    /// Whether the command has it as well: the terminal sends its signals to both.
    known: bool,
}

impl Signals {
    fn new() -> Result<Signals, Failure> {
        let (sender, receiver) = mpsc::unbounded_channel();
        let terminal = io::stdin().is_terminal();
        for (kind, signal, known) in [
            (SignalKind::interrupt(), Signal::INT, terminal),
            (SignalKind::quit(), Signal::QUIT, terminal),
            (SignalKind::hangup(), Signal::HUP, terminal),
            (SignalKind::terminate(), Signal::TERM, false),
        ] {
            let mut arriving = unix::signal(kind).map_err(Failure::environment)?;
            let sender = sender.clone();
            tokio::spawn(async move {
                while arriving.recv().await.is_some() {
                    // The command may be over.
                    let _ = sender.send(Arrived { signal, known });
                }
            });
        }
        Ok(Signals(receiver))
    }

    /// The next one. Cancel-safe.
    async fn next(&mut self) -> Arrived {
        match self.0.recv().await {
            Some(arrived) => arrived,
            None => std::future::pending().await,
        }
    }
}
