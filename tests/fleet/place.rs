//! A fleet of the tests: a folder each for the operator and the robots.

use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use fipa_fleet::{Folder, Membership};
use serde_json::Value;

use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};

pub(crate) struct Fleet {
    pub(crate) place: Place,
}

impl Fleet {
    /// A new fleet, without robots.
    pub(crate) fn new() -> Fleet {
        let fleet = Fleet {
            place: Place::new(),
        };
        fleet.operator().init(now()).unwrap();
        fleet
    }

    pub(crate) fn operator(&self) -> Folder {
        Folder::new(self.folder("operator"))
    }

    /// The folder of whoever bears this name.
    pub(crate) fn folder(&self, name: &str) -> PathBuf {
        self.place.path(&format!("{name}.d"))
    }

    /// Makes a robot of the fleet.
    pub(crate) fn join(&self, name: &str) -> Membership {
        let membership = self.operator().issue(name, 30, now()).unwrap();
        let folder = Folder::new(self.folder(name));
        folder.install(&membership.to_pem()).unwrap();
        membership
    }

    /// The command of a robot's daemon, which dials these peers and nobody else.
    pub(crate) fn fipad(&self, name: &str, peers: &[&Daemon]) -> Command {
        let mut command = self.place.fipad(name);
        command
            .arg("--no-mdns")
            .arg("--fleet")
            .arg(self.folder(name));
        for peer in peers {
            command.args(["--peer", peer.endpoint()]);
        }
        command
    }

    /// Lets a robot join, and starts its daemon.
    pub(crate) fn start(&self, name: &str, peers: &[&Daemon]) -> Daemon {
        self.join(name);
        Daemon::start(self.fipad(name, peers))
    }

    /// The same with a configuration.
    pub(crate) fn start_with(&self, name: &str, peers: &[&Daemon], config: &str) -> Daemon {
        self.join(name);
        let file = self.place.path(&format!("{name}.toml"));
        std::fs::write(&file, config).unwrap();
        let mut command = self.fipad(name, peers);
        command.arg("--config").arg(file);
        Daemon::start(command)
    }
}

pub(crate) fn now() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap()
}

/// Where a daemon listens, for sockets.
pub(crate) fn socket_address(daemon: &Daemon) -> &str {
    daemon.endpoint().strip_prefix("tcp://").unwrap()
}

/// Waits for an event `refused` with these words in its reason; who was refused.
pub(crate) fn refused(daemon: &mut Daemon, words: &str) -> String {
    let until = Instant::now() + PATIENCE;
    loop {
        let event = daemon.event();
        let reason = event["reason"].as_str().unwrap_or_default();
        if event["event"] == "refused" && reason.contains(words) {
            return event["who"].as_str().unwrap().to_owned();
        }
        assert!(Instant::now() < until, "{event}");
    }
}

/// The names of all agents that a daemon knows.
pub(crate) fn agents(daemon: &Daemon) -> Vec<String> {
    let told = daemon.run(&["agents", "--json"]);
    let name = |agent: &Value| agent["name"].as_str().unwrap().to_owned();
    told.json().iter().map(name).collect()
}
