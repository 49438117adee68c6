use std::io;
use std::path::{Path, PathBuf};

/// Why the options cannot be used, in one line without the program's name.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OptionsError {
    /// The command line is wrong.
    #[error("{0}")]
    Usage(String),
    /// The configuration file is malformed.
    #[error("{}:{line}:{column}: {problem}", shown(file))]
    File {
        /// The file, as it was named.
        file: PathBuf,
        /// The line, counted from 1.
        line: usize,
        /// The column in characters, counted from 1.
        column: usize,
        /// What is wrong there.
        problem: String,
    },
    /// An environment variable has a bad value.
    #[error("{name}: {problem}")]
    Variable {
        /// The variable.
        name: &'static str,
        /// What is wrong with its value.
        problem: String,
    },
    /// The configuration file cannot be read.
    #[error("{}: {source}", shown(file))]
    Unreadable {
        /// The file, as it was named.
        file: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl OptionsError {
    /// 2: something is malformed; 3: the environment failed.
    pub fn exit_code(&self) -> u8 {
        match self {
            OptionsError::Unreadable { .. } => 3,
            _ => 2,
        }
    }
}

/// A file's name may hold anything, a message is one line.
fn shown(file: &Path) -> String {
    file.display().to_string().replace(char::is_control, "?")
}
