//! `fipa encode`: messages and letters in JSON, encoded.

use std::io::Write;
use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use fipa_acl::FipaTime;
use fipa_codec::{EncodeError, Output};
use fipa_json::{Body, EnvelopeForm, JsonError, LetterForm};
use fipa_json::{envelope_for, letter_from_json, message_from_json};
use serde_json::Value;

use crate::forms::{Encoder, EnvelopeRep, Rep, TableArgs};
use crate::json_values::JsonValues;
use crate::{Failure, streams};

/// The options of `fipa encode`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// The representation of the messages
    #[arg(long = "as", value_name = "REP")]
    pub rep: Rep,
    /// Write letters whose envelopes are in this representation
    #[arg(long, value_name = "REP")]
    pub envelope: Option<EnvelopeRep>,
    #[command(flatten)]
    table: TableArgs,
    /// JSON values to encode, one a line or just one after the other; - is standard input
    #[arg(default_value = "-")]
    pub file: PathBuf,
}

/// Encodes what the options name to standard output.
///
/// # Errors
/// Exit code 3 for a file that cannot be read, else see [`encode`].
pub fn run(args: &Args) -> Result<(), Failure> {
    let input = streams::read_input(&args.file)?;
    streams::write_output(|output| encode(&input, args, now(), output))
}

/// Writes the octets of each message or letter of the input, one after the other; `now` is the
/// date of envelopes that are made for a bare message.
///
/// # Errors
/// Exit code 2 with `line:column` for the first value that is not JSON, not of the form or not
/// writable in the representation. What was encoded before it is written.
pub fn encode(
    input: &[u8],
    args: &Args,
    now: FipaTime,
    output: &mut dyn Write,
) -> Result<(), Failure> {
    let table = args.table.table().map_err(Failure::malformed)?;
    let mut encoder = Encoder::new(args.rep, table);
    let mut octets = Output::new();
    for value in JsonValues::new(input) {
        let (position, value) = value?;
        encode_value(&value, args.envelope, now, &mut encoder, &mut octets)
            .map_err(|error| Failure::malformed(format!("{position}: {error}")))?;
        for part in octets.take().parts() {
            output.write_all(part)?;
        }
    }
    Ok(())
}

/// Why a JSON value cannot be encoded.
#[derive(Debug, thiserror::Error)]
enum ValueError {
    #[error(transparent)]
    Form(#[from] JsonError),
    #[error(transparent)]
    Encode(#[from] EncodeError),
    #[error("a letter is written with --envelope")]
    Letter,
}

fn encode_value(
    value: &Value,
    envelope: Option<EnvelopeRep>,
    now: FipaTime,
    encoder: &mut Encoder,
    output: &mut Output,
) -> Result<(), ValueError> {
    let is_letter = ["envelope", "layers"]
        .iter()
        .any(|key| value.get(key).is_some());
    let Some(envelope) = envelope else {
        if is_letter {
            return Err(ValueError::Letter);
        }
        let message = message_from_json(value)?;
        return Ok(encoder.message(&message, output)?);
    };
    let letter = if is_letter {
        letter_from_json(value)?
    } else {
        letter_of_message(value, now)?
    };
    Ok(encoder.letter(letter, envelope, output)?)
}

/// The letter that is made for a bare message.
fn letter_of_message(value: &Value, now: FipaTime) -> Result<LetterForm, JsonError> {
    let message = message_from_json(value)?;
    Ok(LetterForm {
        envelope: EnvelopeForm::Flattened(Box::new(envelope_for(&message, now))),
        body: Body::Message(Box::new(message)),
    })
}

fn now() -> FipaTime {
    // A clock before 1970 is as good as none.
    let since_1970 = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    FipaTime::from_unix_millis(i64::try_from(since_1970.as_millis()).unwrap_or(i64::MAX))
}
