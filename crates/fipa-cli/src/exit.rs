use std::fmt;
use std::process::ExitCode;

use fipa_codec::DecodeError;

/// Why a command did not end with 0: an exit code and one line for standard error.
///
/// ```
/// let failure = fipa_cli::Failure::malformed("octet 17: not\na message");
/// assert_eq!(failure.code(), 2);
/// assert_eq!(failure.to_string(), "octet 17: not a message");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct Failure {
    code: u8,
    line: String,
}

impl Failure {
    /// Exit code 1: the answer is "no" (undeliverable, refused, not found, timed out).
    pub fn no(line: impl fmt::Display) -> Failure {
        Failure::new(1, line)
    }

    /// Exit code 2: the input is malformed or the usage is wrong.
    pub fn malformed(line: impl fmt::Display) -> Failure {
        Failure::new(2, line)
    }

    /// Exit code 3: the environment failed (no such file, nothing to connect to).
    pub fn environment(line: impl fmt::Display) -> Failure {
        Failure::new(3, line)
    }

    /// The exit code: 1, 2 or 3.
    pub fn code(&self) -> u8 {
        self.code
    }

    /// The exit code as the operating system gets it.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.code)
    }

    fn new(code: u8, line: impl fmt::Display) -> Failure {
        Failure {
            code,
            line: line.to_string().replace(['\n', '\r'], " "),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.line)
    }
}

impl From<DecodeError> for Failure {
    fn from(error: DecodeError) -> Failure {
        Failure::malformed(error)
    }
}

impl From<std::io::Error> for Failure {
    /// The output could not be written.
    fn from(error: std::io::Error) -> Failure {
        Failure::environment(format_args!("cannot write: {error}"))
    }
}
