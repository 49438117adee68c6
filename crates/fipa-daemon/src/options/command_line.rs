use std::ffi::OsString;
use std::path::PathBuf;

use clap::Parser;
use clap::error::{ContextKind, ContextValue, ErrorKind};

use super::{Layer, OptionsError};

/// The command line of `fipad`.
#[derive(Debug, Parser)]
#[command(
    name = "fipad",
    bin_name = "fipad",
    version,
    about = "The daemon of a FIPA agent platform: carries letters, finds other daemons",
    after_help = "Options win over the file of --config, which wins over environment variables \
                  (FIPAD_LISTEN and so on,\nlists separated by commas or white space), which win \
                  over the defaults. `fipad config` prints a\nfile to start from."
)]
// The subcommands take no options of the daemon; an option before them would be lost silently.
#[command(args_conflicts_with_subcommands = true, disable_help_subcommand = true)]
pub(super) struct CommandLine {
    /// The configuration file, TOML with the names of these options as keys
    #[arg(long, value_name = "FILE")]
    pub(super) config: Option<PathBuf>,
    /// All the others, which the file may hold as well.
    #[command(flatten)]
    pub(super) options: Layer,
    /// What to do instead of running the daemon.
    #[command(subcommand)]
    pub(super) command: Option<Subcommand>,
}

/// What there is besides running the daemon.
#[derive(Debug, clap::Subcommand)]
pub(super) enum Subcommand {
    /// Show what the platform does: a tour on loopback that ends by itself
    Demo,
    /// Print the default configuration, with every key explained
    Config,
}

/// What came of a command line.
pub(super) enum Parsed {
    /// Something to do.
    Line(Box<CommandLine>),
    /// Something to print: help or version.
    Text(String),
}

/// What clap's explanations begin with. An empty line alone may as well be part of a bad value.
const HINTS: [&str; 3] = ["\n\n  tip: ", "\n\nUsage: ", "\n\nFor more information"];

impl CommandLine {
    pub(super) fn read(args: impl Iterator<Item = OsString>) -> Result<Parsed, OptionsError> {
        match CommandLine::try_parse_from(args) {
            Ok(line) => Ok(Parsed::Line(Box::new(line))),
            Err(error) => match error.kind() {
                ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
                    Ok(Parsed::Text(error.to_string()))
                }
                _ => Err(OptionsError::Usage(one_line(&error))),
            },
        }
    }
}

/// What clap says before it explains the usage, and the suggestion that comes in between.
fn one_line(error: &clap::Error) -> String {
    let message = error.to_string();
    let said = HINTS.iter().fold(message.as_str(), |said, hint| {
        said.split(hint).next().unwrap_or(said)
    });
    let words: Vec<&str> = said.split_whitespace().collect();
    let line = words.join(" ").replace(char::is_control, "?");
    let line = line.strip_prefix("error: ").unwrap_or(&line);
    match suggestion(error) {
        Some(name) => format!("{line} (did you mean '{name}'?)"),
        None => line.to_owned(),
    }
}

fn suggestion(error: &clap::Error) -> Option<&str> {
    let kinds = [ContextKind::SuggestedArg, ContextKind::SuggestedSubcommand];
    match kinds.into_iter().find_map(|kind| error.get(kind))? {
        ContextValue::String(name) => Some(name),
        ContextValue::Strings(names) => names.first().map(String::as_str),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::config_file::{DEFAULT_CONFIG, KEYS};

    fn options() -> Vec<String> {
        let command = CommandLine::command();
        let names = command.get_arguments().filter_map(|arg| arg.get_long());
        // Which file to read is not for the file to say.
        let names = names.filter(|name| *name != "config");
        names.map(str::to_owned).collect()
    }

    #[test]
    fn the_parser_is_consistent() {
        CommandLine::command().debug_assert();
    }

    #[test]
    fn every_option_is_a_key_of_the_file() {
        assert_eq!(options(), KEYS);
    }

    #[test]
    fn every_option_is_explained_in_the_default_file() {
        let lines: Vec<&str> = DEFAULT_CONFIG.lines().collect();
        for option in options() {
            let key = format!("#{option} = ");
            let at = lines.iter().position(|line| line.starts_with(&key));
            let at = at.unwrap_or_else(|| panic!("{option} is missing"));
            assert!(lines[at - 1].starts_with("# "), "{option} is not explained");
        }
    }
}
