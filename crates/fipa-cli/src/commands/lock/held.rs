//! The command that runs while a resource is held: it must not outlive who holds it, because with
//! `fipa lock` the control connection ends, and the resource goes to the next one at once.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::process::Command;

use crate::Failure;

const NAME: &str = "run-while-held";

/// What `fipa lock` runs in place of the command.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The process of `fipa lock`
    #[arg(value_name = "PID")]
    holder: u32,
    /// What is run
    #[arg(last = true, required = true, value_name = "COMMAND")]
    command: Vec<OsString>,
}

/// The words that run a command in this way; the command's own follow.
pub(super) fn words() -> [String; 3] {
    let holder = std::process::id().to_string();
    [NAME.to_owned(), holder, "--".to_owned()]
}

/// Becomes the command, which the system kills when `fipa lock` ends before it.
pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    #[cfg(target_os = "linux")]
    {
        let kill = Some(rustix::process::Signal::KILL);
        rustix::process::set_parent_process_death_signal(kill).map_err(Failure::environment)?;
    }
    // Who ended before that was asked for sends nothing any more.
    if std::os::unix::process::parent_id() != args.holder {
        return Err(Failure::no("the lock ended before the command began"));
    }
    let Some((program, words)) = args.command.split_first() else {
        return Err(Failure::malformed("a command is needed"));
    };
    let error = Command::new(program).args(words).exec();
    let program = program.to_string_lossy();
    Err(Failure::environment(format_args!(
        "cannot run {program}: {error}"
    )))
}
