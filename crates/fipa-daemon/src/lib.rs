//! The daemon `fipad`: one per robot.
//!
//! ```text
//!   main ── options (command line, file, environment) ── run: a Platform, until a signal
//!                                                    └── demo: a tour with two daemons
//! ```
//!
//! **Knows** options, exit codes, signals and what a daemon says on its standard streams.
//! **Never knows** how letters travel: that is the platform's.

mod config_file;
mod demo;
mod fencing;
mod fleet;
mod hiac;
mod letter_log;
mod locks;
mod membership;
pub mod options;
mod packets;
mod run;
mod text;

use std::future::Future;
use std::io::Write;
use std::process::ExitCode;
use std::sync::Arc;

use fipa::{Error, LetterTransport};
use rustix::process::{Resource, Rlimit};
use tracing_subscriber::EnvFilter;

use crate::options::{Invocation, Options};
use crate::run::RunError;

/// The program: reads the command line of this process and does what it says.
pub fn main() -> ExitCode {
    main_with(&[])
}

/// The same program with transports plugged in: it takes their addresses for `--listen` and
/// `--advertise`, and sends to them.
pub fn main_with(transports: &[Arc<dyn LetterTransport>]) -> ExitCode {
    let env = |name: &str| Some(std::env::var_os(name)?.to_string_lossy().into_owned());
    match options::parse(std::env::args_os(), env) {
        Ok(Invocation::Run(options)) => daemon(&options, transports),
        Ok(Invocation::Demo) => demo(),
        Ok(Invocation::Config) => print(options::DEFAULT_CONFIG),
        Ok(Invocation::Help(text)) => print(&text),
        Err(error) => fail(error.exit_code(), &error),
    }
}

fn daemon(options: &Options, transports: &[Arc<dyn LetterTransport>]) -> ExitCode {
    log("warn,fipa=info");
    raise_open_files();
    match block_on(run::run(options, transports)) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(RunError::Platform(
            error @ (Error::Name(_) | Error::Address(_) | Error::NotCertified { .. }),
        ))) => fail(2, &error),
        Ok(Err(error)) => fail(3, &error),
        Err(error) => fail(3, &error),
    }
}

fn demo() -> ExitCode {
    match block_on(demo::run()) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(wrong)) => {
            println!("   That did not work: {wrong}");
            ExitCode::FAILURE
        }
        Err(error) => fail(3, &error),
    }
}

/// Links, timers and the directory share one thread: waking another costs more than they do.
fn block_on<T>(future: impl Future<Output = T>) -> std::io::Result<T> {
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    Ok(runtime.enable_all().build()?.block_on(future))
}

/// Lets the daemon have as many connections as the system allows; by default programs may open 1024
/// files, so that those that cannot deal with more go on.
fn raise_open_files() {
    let limit = rustix::process::getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: limit.maximum,
        ..limit
    };
    if let Err(error) = rustix::process::setrlimit(Resource::Nofile, raised) {
        tracing::warn!("cannot raise the limit of open files: {error}");
    }
}

/// The log goes to standard error; `FIPA_LOG` chooses what is in it.
fn log(default: &str) {
    let filter = EnvFilter::try_from_env("FIPA_LOG").unwrap_or_else(|_| EnvFilter::new(default));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .with_target(false)
        .init();
}

fn print(text: &str) -> ExitCode {
    match std::io::stdout().write_all(text.as_bytes()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => fail(3, &error),
    }
}

fn fail(code: u8, error: &dyn std::fmt::Display) -> ExitCode {
    eprintln!("fipad: {error}");
    ExitCode::from(code)
}
