//! `fipa protocol`: interaction protocols as files.

mod check;
mod draw;
mod recorded;
mod replay;

use std::path::Path;

use fipa_protocol::{Limits, Loaded, Severity, load};

use crate::{Failure, streams};

/// The options of `fipa protocol`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What can be done with a protocol.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Command {
    /// Say what is wrong with protocol files
    Check(check::Args),
    /// Draw a protocol
    Draw(draw::Args),
    /// Say of each message of a conversation whether the protocol has it
    Replay(replay::Args),
}

/// Does it on the streams of the process.
///
/// # Errors
/// Exit code 1 if the answer is no, 2 for a file that holds no protocol, 3 for one that cannot be
/// read.
pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.command {
        Command::Check(args) => check::run(args),
        Command::Draw(args) => draw::run(args),
        Command::Replay(args) => replay::run(args),
    }
}

/// What a file holds; else why it is not XML.
fn read(path: &Path) -> Result<Result<Loaded, fipa_protocol::LoadError>, Failure> {
    let octets = streams::read_input(path)?;
    Ok(load(&path.to_string_lossy(), &octets, &Limits::default()))
}

/// The protocol of a file without errors.
fn protocol(path: &Path) -> Result<fipa_protocol::Protocol, Failure> {
    let shown = path.display();
    let loaded =
        read(path)?.map_err(|error| Failure::malformed(format_args!("{shown}:{error}")))?;
    let error = loaded
        .diagnostics
        .iter()
        .find(|one| one.severity == Severity::Error);
    match (loaded.protocol, error) {
        (Some(protocol), _) => Ok(protocol),
        (None, Some(error)) => Err(Failure::malformed(format_args!("{shown}:{error}"))),
        (None, None) => Err(Failure::malformed(format_args!("{shown}: no protocol"))),
    }
}
