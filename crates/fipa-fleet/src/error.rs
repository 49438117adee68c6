use std::io;
use std::path::PathBuf;

use crate::{NameError, Refusal};

/// Why something about the keys of a fleet could not be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FleetError {
    /// The name cannot be that of a robot.
    #[error(transparent)]
    Name(#[from] NameError),
    /// A file cannot be read or written.
    #[error("{}: {source}", .path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// There is a fleet key already, which is not overwritten.
    #[error("{} is there already, and is not overwritten", .0.display())]
    Exists(PathBuf),
    /// The folder holds no fleet key.
    #[error("there is no fleet key in {}: make one by `fipa key init`", .0.display())]
    NoFleetKey(PathBuf),
    /// The machine is in no fleet.
    #[error(
        "there is no robot.fleet in {}: join a fleet by `fipa key join FILE`", .0.display()
    )]
    NotInFleet(PathBuf),
    /// No certificate bears the name.
    #[error("no certificate was made for {0}")]
    UnknownRobot(String),
    /// What was read is not what it should be.
    #[error("{0}")]
    Malformed(String),
    /// The own certificate is not good.
    #[error("the certificate here is of no use: {0}")]
    Own(Refusal),
    /// A list that lacks some of what is known to be revoked.
    #[error("the list of revoked certificates is older than the one that is known")]
    OlderList,
    /// The machine made no key, or no certificate of it.
    #[error("no key could be made: {0}")]
    Making(String),
}
