//! `fipa decode` and `fipa encode`, on octets in memory.

mod charsets;
mod code_tables;
mod decode;
mod encode;
mod forms;
mod properties;
mod recordings;

use bytes::Bytes;
use clap::Parser;
use fipa_acl::FipaTime;
use fipa_cli::{Cli, Command, Failure, commands};
use serde_json::Value;

/// The inform from a@h to b@h with the content `hi`.
pub(crate) const MESSAGE: &[u8] =
    b"\xfa\x10\x08\x02\x02\x10a@h\0\x01\x03\x02\x10b@h\0\x01\x01\x04\x16\x02hi\x01";

/// Its JSON form.
pub(crate) const MESSAGE_JSON: &str = concat!(
    r#"{"performative":"inform","sender":{"name":"a@h"},"#,
    r#""receiver":[{"name":"b@h"}],"content":"hi"}"#,
);

/// What the commands take for the present.
pub(crate) const NOW: &str = "2026-01-02T03:04:05.678Z";

/// What `fipa decode` with these options prints for this input, and how it ends.
pub(crate) fn decode(options: &[&str], input: &[u8]) -> (String, Result<(), Failure>) {
    let Command::Decode(args) = parse("decode", options) else {
        panic!("not decode");
    };
    let mut output = Vec::new();
    let input = Bytes::copy_from_slice(input);
    let result = commands::decode::decode(&input, &args, &mut output);
    (String::from_utf8(output).unwrap(), result)
}

/// What `fipa encode --as bit-efficient` with these options writes for this input, and how it
/// ends.
pub(crate) fn encode(options: &[&str], input: &str) -> (Vec<u8>, Result<(), Failure>) {
    encode_as("bit-efficient", options, input)
}

/// What `fipa encode` with this representation and these options writes for this input, and how
/// it ends.
pub(crate) fn encode_as(
    rep: &str,
    options: &[&str],
    input: &str,
) -> (Vec<u8>, Result<(), Failure>) {
    let options = [&["--as", rep], options].concat();
    let Command::Encode(args) = parse("encode", &options) else {
        panic!("not encode");
    };
    let now: FipaTime = NOW.parse().unwrap();
    let mut output = Vec::new();
    let result = commands::encode::encode(input.as_bytes(), &args, now, &mut output);
    (output, result)
}

/// The octets of a value, which can be written.
pub(crate) fn encoded(rep: &str, options: &[&str], json: &Value) -> Vec<u8> {
    let (octets, result) = encode_as(rep, options, &json.to_string());
    assert_eq!(result, Ok(()), "{json}");
    octets
}

/// The values in octets that can be read.
pub(crate) fn decoded(options: &[&str], octets: &[u8]) -> Vec<Value> {
    let (lines, result) = decode(options, octets);
    let shown = String::from_utf8_lossy(&octets[..octets.len().min(2000)]);
    assert_eq!(result, Ok(()), "{shown}");
    lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// The letter without what the encoder says about the payload that it makes.
pub(crate) fn without_payload_slots(letter: &Value) -> Value {
    let mut letter = letter.clone();
    let envelope = letter["envelope"].as_object_mut().unwrap();
    for slot in ["acl-representation", "payload-length", "payload-encoding"] {
        envelope.shift_remove(slot);
    }
    letter
}

/// The exit code and the line of a failure.
pub(crate) fn failure(result: Result<(), Failure>) -> (u8, String) {
    let failure = result.expect_err("it ended with 0");
    (failure.code(), failure.to_string())
}

/// A command line of `fipa`.
pub(crate) fn parse(command: &str, options: &[&str]) -> Command {
    let line = ["fipa", command].into_iter().chain(options.iter().copied());
    Cli::try_parse_from(line).unwrap().command
}
