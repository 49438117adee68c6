//! `fipa text`: the text format of small robots to and from JSON.

use std::io::{Read, Write};
use std::path::PathBuf;

use fipa_json::{text_from_json, text_to_json, unreadable_text_to_json};
use robot_text::Reader;

use crate::json_values::JsonValues;
use crate::{Failure, streams};

/// The options of `fipa text`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Which way.
    #[command(subcommand)]
    pub way: Way,
}

/// The commands of `fipa text`.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Way {
    /// Show the messages of a stream as JSON, one a line, as they come
    Decode {
        /// What to decode; - is standard input
        #[arg(default_value = "-")]
        file: PathBuf,
    },
    /// Write messages given as JSON
    Encode {
        /// JSON values to encode, one a line or just one after the other; - is standard input
        #[arg(default_value = "-")]
        file: PathBuf,
    },
}

/// Translates what the options name to standard output.
///
/// # Errors
/// Exit code 3 for a file that cannot be read, else see [`decode`] and [`encode`].
pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.way {
        Way::Decode { file } => {
            let input = streams::open_input(file)?;
            streams::write_output(|output| decode(input, output))
        }
        Way::Encode { file } => {
            let input = streams::read_input(file)?;
            streams::write_output(|output| encode(&input, output))
        }
    }
}

/// Writes one JSON line for each message of the input, as soon as it is whole.
///
/// # Errors
/// Exit code 1 if something could not be read, which stands as an error in its place; exit code 3
/// when the input breaks off.
pub fn decode(input: impl Read, output: &mut dyn Write) -> Result<(), Failure> {
    let mut reader = Reader::new();
    let mut unreadable = 0_u64;
    streams::read_as_it_comes(input, |octets| {
        match octets {
            [] => reader.end(),
            octets => reader.push(octets),
        }
        for read in &mut reader {
            let json = match read {
                Ok(message) => text_to_json(&message),
                Err(error) => {
                    unreadable += 1;
                    unreadable_text_to_json(&error)
                }
            };
            writeln!(output, "{json}")?;
        }
        Ok(output.flush()?)
    })?;
    match unreadable {
        0 => Ok(()),
        1 => Err(Failure::no("a message could not be read")),
        count => Err(Failure::no(format_args!(
            "{count} messages could not be read"
        ))),
    }
}

/// Writes each message of the input, one behind the other.
///
/// # Errors
/// Exit code 2 with `line:column` for the first value that is not JSON, not of the form or not
/// writable. What was encoded before it is written.
pub fn encode(input: &[u8], output: &mut dyn Write) -> Result<(), Failure> {
    for value in JsonValues::new(input) {
        let (position, value) = value?;
        let malformed =
            |error: &dyn std::fmt::Display| Failure::malformed(format_args!("{position}: {error}"));
        let message = text_from_json(&value).map_err(|error| malformed(&error))?;
        let text = message.to_text().map_err(|error| malformed(&error))?;
        output.write_all(text.as_bytes())?;
    }
    Ok(())
}
