use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

use crate::commands::{
    agents, ams, attach, bench, decode, df, doctor, echo, encode, hiac, key, listen, lock, ping,
    platform, protocol, send, sniff, text,
};
use crate::{Failure, streams};

/// The command line of `fipa`.
#[derive(Debug, Parser)]
#[command(
    name = "fipa",
    version,
    about = "Agents talking FIPA: look, send, translate"
)]
// Without a command there is one line on standard error, as for every other wrong usage.
#[command(subcommand_required = true, arg_required_else_help = false)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands of `fipa`.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show who is known
    Agents(agents::Args),
    /// Look into the white pages of a platform
    Ams(ams::Args),
    /// Be one agent for a program in any language: JSON lines in and out
    Attach(attach::Args),
    /// Measure what the link to another robot gives, by each transport
    Bench(bench::Args),
    /// Show encoded messages and letters as JSON, one a line
    Decode(decode::Args),
    /// Look into the yellow pages of a platform, and write into them
    Df(df::Args),
    /// Say why robots do not see each other
    Doctor(doctor::Args),
    /// Be an agent that answers every request and query with its own content
    Echo(echo::Args),
    /// Encode messages and letters given as JSON
    Encode(encode::Args),
    /// Read and write what passes on a HIAC link
    Hiac(hiac::Args),
    /// Make the key of a fleet, and let robots join it
    Key(key::Args),
    /// Be an agent that prints what it is sent
    Listen(listen::Args),
    /// Run a command while a resource is held
    Lock(Box<lock::Args>),
    /// Ask an agent, and measure how long the answer takes
    Ping(ping::Args),
    /// List the agents of platforms of other makes
    Platform(platform::Args),
    /// Check, draw and replay interaction protocols
    Protocol(protocol::Args),
    /// Run the command of `fipa lock`
    #[command(hide = true)]
    RunWhileHeld(lock::held::Args),
    /// Send a message, and say what became of it
    Send(Box<send::Args>),
    /// Watch what passes the daemon, or read a letter log
    Sniff(sniff::Args),
    /// Read and write the text format of small robots
    Text(text::Args),
}

impl Command {
    /// The word on the command line.
    pub fn name(&self) -> &'static str {
        match self {
            Command::Agents(_) => "agents",
            Command::Ams(_) => "ams",
            Command::Attach(_) => "attach",
            Command::Bench(_) => "bench",
            Command::Decode(_) => "decode",
            Command::Df(_) => "df",
            Command::Doctor(_) => "doctor",
            Command::Echo(_) => "echo",
            Command::Encode(_) => "encode",
            Command::Hiac(_) => "hiac",
            Command::Key(_) => "key",
            Command::Listen(_) => "listen",
            Command::Lock(_) | Command::RunWhileHeld(_) => "lock",
            Command::Ping(_) => "ping",
            Command::Platform(_) => "platform",
            Command::Protocol(_) => "protocol",
            Command::Send(_) => "send",
            Command::Sniff(_) => "sniff",
            Command::Text(_) => "text",
        }
    }

    fn run(&self) -> Result<ExitCode, Failure> {
        let done = match self {
            Command::Agents(args) => agents::run(args),
            Command::Ams(args) => ams::run(args),
            Command::Attach(args) => attach::run(args),
            Command::Bench(args) => bench::run(args),
            Command::Decode(args) => decode::run(args),
            Command::Df(args) => df::run(args),
            Command::Doctor(args) => doctor::run(args),
            Command::Echo(args) => echo::run(args),
            Command::Encode(args) => encode::run(args),
            Command::Hiac(args) => hiac::run(args),
            Command::Key(args) => key::run(args),
            Command::Listen(args) => listen::run(args),
            Command::Lock(args) => return lock::run(args),
            Command::Ping(args) => ping::run(args),
            Command::Platform(args) => platform::run(args),
            Command::Protocol(args) => protocol::run(args),
            Command::RunWhileHeld(args) => lock::held::run(args),
            Command::Send(args) => send::run(args),
            Command::Sniff(args) => sniff::run(args),
            Command::Text(args) => text::run(args),
        };
        done.map(|()| ExitCode::SUCCESS)
    }
}

/// The program: runs the command line of this process.
pub fn main() -> ExitCode {
    run(std::env::args_os())
}

/// Runs a command line, the program's name included, on the streams of this process.
///
/// What fails is one line on standard error and an exit code: see [`Failure`].
pub fn run(command_line: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> ExitCode {
    let (name, result) = match Cli::try_parse_from(command_line) {
        Ok(cli) => (format!("fipa {}", cli.command.name()), cli.command.run()),
        Err(error) => ("fipa".into(), usage(&error).map(|()| ExitCode::SUCCESS)),
    };
    match result {
        Ok(code) => code,
        Err(failure) => {
            // If nobody listens on standard error, the exit code is all there is to say.
            let _ = writeln!(io::stderr(), "{name}: {failure}");
            failure.exit_code()
        }
    }
}

/// Help and version are answers; everything else is a failure of one line.
fn usage(error: &clap::Error) -> Result<(), Failure> {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            streams::write_output(|output| Ok(write!(output, "{error}")?))
        }
        ErrorKind::MissingSubcommand | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let missing = "a subcommand is missing; the same with --help lists them";
            Err(Failure::malformed(missing))
        }
        _ => Err(Failure::malformed(one_line(&error.to_string()))),
    }
}

/// What clap says before it explains the usage, on one line.
fn one_line(message: &str) -> String {
    let said = message.split("\n\n").next().unwrap_or_default();
    let words: Vec<&str> = said.split_whitespace().collect();
    let line = words.join(" ");
    line.strip_prefix("error: ").unwrap_or(&line).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_usage_is_one_line() {
        for (line, said) in [
            (&["fipa"][..], "a subcommand is missing"),
            (&["fipa", "key"], "a subcommand is missing"),
            (
                &["fipa", "encode"],
                "the following required arguments were not provided: --as <REP>",
            ),
            (
                &["fipa", "decode", "--as", "json"],
                "invalid value 'json' for '--as <REP>' [possible values: bit-efficient, xml, string]",
            ),
            (
                &["fipa", "encode", "--as", "xml", "--envelope", "string"],
                "invalid value 'string' for '--envelope <REP>' [possible values: bit-efficient, xml]",
            ),
        ] {
            let error = Cli::try_parse_from(line).unwrap_err();
            let failure = usage(&error).unwrap_err();
            assert!(failure.to_string().starts_with(said), "{failure}");
            assert_eq!(failure.to_string().lines().count(), 1);
            assert_eq!(failure.code(), 2);
        }
    }

    #[test]
    fn the_parser_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }
}
