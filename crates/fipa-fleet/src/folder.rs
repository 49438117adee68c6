//! Where an operator keeps the fleet key, and a robot its membership.

use std::ffi::OsString;
use std::fs::{self, OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::{Certificate, FleetError, FleetKey, Membership, Revocations, pem};

const FLEET_KEY: &str = "fleet.key";
const ROBOT: &str = "robot.fleet";
const REVOKED: &str = "revoked.pem";
const ISSUED: &str = "issued";

/// A folder that holds what belongs to a fleet:
///
/// ```text
///   fleet.key      the fleet key and its certificate      the operator has it, and nobody else
///   issued/        the certificates of the robots         with it
///   revoked.pem    those that are revoked                 everybody
///   robot.fleet    the membership of this machine         each robot its own
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folder(PathBuf);

/// What a file brought.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Installed {
    /// This machine is the robot of this name now.
    Robot(String),
    /// Something more is known to be revoked, or, if not so, all of it was known.
    Revocations {
        /// Whether something is new.
        news: bool,
    },
}

/// `$XDG_CONFIG_HOME/fipa/fleet`, else `$HOME/.config/fipa/fleet`; `None` without either. `env` tells
/// the value of an environment variable.
pub fn default_folder(env: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let given = |name| {
        env(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let config = given("XDG_CONFIG_HOME").or_else(|| Some(given("HOME")?.join(".config")))?;
    Some(config.join("fipa").join("fleet"))
}

impl Folder {
    /// The folder at this place; it need not be there yet.
    pub fn new(path: impl Into<PathBuf>) -> Folder {
        Folder(path.into())
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Makes a new fleet. `now` is since 1970-01-01T00:00:00Z, here and below.
    pub fn init(&self, now: Duration) -> Result<FleetKey, FleetError> {
        let path = self.0.join(FLEET_KEY);
        if path.exists() {
            return Err(FleetError::Exists(path));
        }
        let key = FleetKey::generate(now)?;
        self.write(&path, &key.to_pem())?;
        Ok(key)
    }

    /// The fleet key.
    pub fn fleet_key(&self) -> Result<FleetKey, FleetError> {
        let path = self.0.join(FLEET_KEY);
        match fs::read_to_string(&path) {
            Ok(text) => FleetKey::from_pem(&text).map_err(|error| in_file(&path, error)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err(FleetError::NoFleetKey(self.0.clone()))
            }
            Err(source) => Err(FleetError::File { path, source }),
        }
    }

    /// Makes key and certificate for a robot, and keeps the certificate.
    pub fn issue(&self, name: &str, days: u32, now: Duration) -> Result<Membership, FleetError> {
        let key = self.fleet_key()?;
        let (issued, revoked) = (self.issued()?, self.revoked()?);
        let membership = key.issue(name, days, now, &issued, revoked.as_ref())?;
        let certificate = membership.certificate();
        let mut short = certificate.fingerprint().to_string();
        short.truncate(16);
        let path = self.0.join(ISSUED).join(format!("{name}-{short}.pem"));
        self.write(&path, &certificate.to_pem())?;
        Ok(membership)
    }

    /// The certificates that were made here, by name.
    pub fn issued(&self) -> Result<Vec<Certificate>, FleetError> {
        let folder = self.0.join(ISSUED);
        let entries = match fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(source) => {
                return Err(FleetError::File {
                    path: folder,
                    source,
                });
            }
        };
        let mut certificates = Vec::new();
        for entry in entries {
            let path = match entry {
                Ok(entry) => entry.path(),
                Err(source) => {
                    return Err(FleetError::File {
                        path: folder,
                        source,
                    });
                }
            };
            if path.extension().is_some_and(|ending| ending == "pem") {
                let text = read(&path)?;
                let read = Certificate::from_pem(&text);
                certificates.push(read.map_err(|error| in_file(&path, error))?);
            }
        }
        certificates.sort_by_key(|one| (one.name().to_owned(), one.valid_until()));
        Ok(certificates)
    }

    /// Revokes all certificates of a robot.
    pub fn revoke(&self, name: &str, now: Duration) -> Result<Revocations, FleetError> {
        let key = self.fleet_key()?;
        let before = self.revoked()?;
        let mut certificates = self.issued()?;
        certificates.retain(|certificate| certificate.name() == name);
        if certificates.is_empty() {
            return Err(FleetError::UnknownRobot(name.to_owned()));
        }
        let list = key.revoke(&certificates, before.as_ref(), now)?;
        self.write(&self.0.join(REVOKED), &list.to_pem())?;
        Ok(list)
    }

    /// What is revoked, as it stands here.
    pub fn revoked(&self) -> Result<Option<Revocations>, FleetError> {
        let path = self.0.join(REVOKED);
        match fs::read_to_string(&path) {
            Ok(text) => {
                let read = Revocations::from_pem(&text);
                read.map(Some).map_err(|error| in_file(&path, error))
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(FleetError::File { path, source }),
        }
    }

    /// Takes in what a file holds: the membership of a robot, which this machine is from now on, or
    /// a list of what is revoked.
    pub fn install(&self, text: &str) -> Result<Installed, FleetError> {
        let sections = pem::read(text)?;
        if sections.keys.is_empty() && sections.lists.is_empty() {
            return Err(FleetError::Malformed(
                "it is neither the file of a robot nor a list of what is revoked".to_owned(),
            ));
        }
        if sections.keys.is_empty() {
            let list = Revocations::from_pem(text)?;
            let membership = self.membership()?;
            let news = membership.learn(list.der())?;
            if news {
                self.write(&self.0.join(REVOKED), &list.to_pem())?;
            }
            return Ok(Installed::Revocations { news });
        }
        let membership = Membership::from_pem(text)?;
        self.keep(&membership)?;
        Ok(Installed::Robot(membership.name().to_owned()))
    }

    /// Makes this machine the robot of this membership.
    pub fn keep(&self, membership: &Membership) -> Result<(), FleetError> {
        self.write(&self.0.join(ROBOT), &membership.to_pem())
    }

    /// Keeps what a membership has learned to be revoked.
    pub fn keep_revoked(&self, revoked: &Revocations) -> Result<(), FleetError> {
        self.write(&self.0.join(REVOKED), &revoked.to_pem())
    }

    /// The membership of this machine, with all that is known here to be revoked.
    pub fn membership(&self) -> Result<Membership, FleetError> {
        let path = self.0.join(ROBOT);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Err(FleetError::NotInFleet(self.0.clone()));
            }
            Err(source) => return Err(FleetError::File { path, source }),
        };
        let membership = Membership::from_pem(&text).map_err(|error| in_file(&path, error))?;
        self.read_revoked(&membership)?;
        Ok(membership)
    }

    /// Has a membership learn what is known here to be revoked. Whether something was new.
    pub fn read_revoked(&self, membership: &Membership) -> Result<bool, FleetError> {
        let Some(list) = self.revoked()? else {
            return Ok(false);
        };
        match membership.learn(list.der()) {
            // What came over links, or with the membership, is newer than the file.
            Err(FleetError::OlderList) => Ok(false),
            learned => learned.map_err(|error| in_file(&self.0.join(REVOKED), error)),
        }
    }

    /// Whether this machine is in a fleet.
    pub fn is_joined(&self) -> bool {
        self.0.join(ROBOT).exists()
    }

    /// Writes a file that only this user may read, whole or not at all.
    fn write(&self, path: &Path, text: &str) -> Result<(), FleetError> {
        let folder = path.parent().unwrap_or(&self.0);
        let made = fs::create_dir_all(folder)
            .and_then(|()| fs::set_permissions(&self.0, Permissions::from_mode(0o700)));
        made.and_then(|()| write_secret(path, text))
            .map_err(|source| FleetError::File {
                path: path.to_owned(),
                source,
            })
    }
}

/// Writes a file that only this user may read, whole or not at all.
pub fn write_secret(path: &Path, text: &str) -> io::Result<()> {
    let mut hidden = path.as_os_str().to_owned();
    hidden.push(format!(".{}.new", std::process::id()));
    let hidden = PathBuf::from(hidden);
    // One that a killed program left here may have other rights.
    let _ = fs::remove_file(&hidden);
    let mut options = OpenOptions::new();
    let mut file = options
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&hidden)?;
    let written = file
        .write_all(text.as_bytes())
        .and_then(|()| file.sync_all());
    written
        .and_then(|()| fs::rename(&hidden, path))
        .inspect_err(|_| {
            // It is of no use to anybody; that it stays is no greater fault than the one told.
            let _ = fs::remove_file(&hidden);
        })
}

fn read(path: &Path) -> Result<String, FleetError> {
    fs::read_to_string(path).map_err(|source| FleetError::File {
        path: path.to_owned(),
        source,
    })
}

fn in_file(path: &Path, error: FleetError) -> FleetError {
    match error {
        FleetError::Malformed(problem) => {
            FleetError::Malformed(format!("{}: {problem}", path.display()))
        }
        other => other,
    }
}
