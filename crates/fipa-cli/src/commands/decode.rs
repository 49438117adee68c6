//! `fipa decode`: encoded messages and letters as JSON lines.

use std::io::Write;
use std::path::PathBuf;

use bytes::Bytes;
use fipa_acl::Letter;
use fipa_codec::DecodeError;
use fipa_json::{letter_to_json, message_to_json, raw_letter_to_json};
use serde_json::Value;

use crate::forms::{self, Decoder, Expected, Item, Rep, TableArgs};
use crate::{Failure, streams};

/// The options of `fipa decode`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Insist on this representation of the messages
    #[arg(long = "as", value_name = "REP")]
    pub rep: Option<Rep>,
    /// Insist on letters, not bare messages
    #[arg(long)]
    pub envelope: bool,
    /// Show the envelopes of a letter one by one, and its payload unopened
    #[arg(long)]
    pub raw: bool,
    #[command(flatten)]
    table: TableArgs,
    /// What to decode; - is standard input
    #[arg(default_value = "-")]
    pub file: PathBuf,
}

/// Decodes what the options name to standard output.
///
/// # Errors
/// Exit code 3 for a file that cannot be read, else see [`decode`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let input = streams::read_input(&args.file)?;
    streams::write_output(|output| decode(&input, args, output))
}

/// Writes one JSON line for each message and letter of the input.
///
/// # Errors
/// Exit code 2 with the offset in the input for the first thing that cannot be read or is not
/// what the options insist on, and for an input without any message. The lines before it are
/// written.
pub fn decode(input: &Bytes, args: &Args, output: &mut dyn Write) -> Result<(), Failure> {
    let expected = Expected {
        rep: args.rep,
        letter: args.envelope,
    };
    let table = args.table.table().map_err(Failure::malformed)?;
    let mut decoder = Decoder::new(expected, table);
    let mut at = forms::behind_blanks(input, 0);
    if at == input.len() {
        return Err(Failure::malformed("no message in the input"));
    }
    while at < input.len() {
        let (item, end) = decoder.item(input, at)?;
        let json = match item {
            Item::Message(message) => message_to_json(&message),
            Item::Letter(letter) if args.raw => {
                decoder.learn(&letter);
                raw_letter_to_json(&letter, &decoder.layers(input, at)?)
            }
            Item::Letter(letter) => letter_json(&mut decoder, &letter, end)?,
        };
        writeln!(output, "{json}")?;
        at = forms::behind_blanks(input, end);
    }
    Ok(())
}

/// The form of a letter that ends at `end` of the input.
fn letter_json(decoder: &mut Decoder, letter: &Letter, end: usize) -> Result<Value, DecodeError> {
    let start = end - letter.payload.len();
    let body = decoder.payload(letter, start)?;
    Ok(letter_to_json(&letter.envelope, &body))
}
