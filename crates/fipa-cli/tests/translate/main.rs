//! `fipa decode` and `fipa encode`, on octets in memory.

mod decode;
mod encode;
mod recordings;

use bytes::Bytes;
use clap::Parser;
use fipa_acl::FipaTime;
use fipa_cli::{Cli, Command, Failure, commands};

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
    let options = [&["--as", "bit-efficient"], options].concat();
    let Command::Encode(args) = parse("encode", &options) else {
        panic!("not encode");
    };
    let now: FipaTime = NOW.parse().unwrap();
    let mut output = Vec::new();
    let result = commands::encode::encode(input.as_bytes(), &args, now, &mut output);
    (output, result)
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
