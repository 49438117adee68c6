//! Daemons as processes: the bench calls itself again as `fipad`.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

use fipa_fleet::Folder;

/// Set in processes that are daemons.
const MARK: &str = "FIPA_BENCH_DAEMON";

/// A daemon of the bench; it ends with this value.
#[derive(Debug)]
pub struct Daemon {
    process: Child,
    control: PathBuf,
    endpoint: String,
}

/// Whether this process is to be a daemon: then its `main` calls [`fipa_daemon::main`].
pub fn is_daemon() -> bool {
    std::env::var_os(MARK).is_some()
}

impl Daemon {
    /// Starts a daemon without mDNS, which dials these peers and lets everybody in.
    pub fn start(folder: &Path, name: &str, peers: &[&str]) -> Daemon {
        Daemon::start_with(folder, name, peers, &["--fleet-mode", "open"])
    }

    /// Starts a daemon as a robot of the fleet whose key is in this folder; it is made if there is
    /// none yet.
    pub fn start_in_fleet(folder: &Path, name: &str, peers: &[&str]) -> Daemon {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .expect("a clock");
        let operator = Folder::new(folder.join("operator"));
        if operator.fleet_key().is_err() {
            operator.init(now).expect("a fleet");
        }
        let robot = operator.issue(name, 1, now).expect("a robot");
        let place = folder.join(format!("{name}.d"));
        Folder::new(&place).keep(&robot).expect("a folder");
        let place = place.display().to_string();
        Daemon::start_with(folder, name, peers, &["--fleet", &place])
    }

    fn start_with(folder: &Path, name: &str, peers: &[&str], options: &[&str]) -> Daemon {
        let control = folder.join(format!("{name}.sock"));
        let mut command = Command::new(std::env::current_exe().expect("this program"));
        command
            .args(["--json", "--no-mdns", "--name", name, "--control"])
            .arg(&control)
            .args(options)
            .env(MARK, "1")
            .env("FIPA_LOG", "error")
            .stdout(Stdio::piped());
        for peer in peers {
            command.args(["--peer", peer]);
        }
        let mut process = command.spawn().expect("a daemon");
        let mut line = String::new();
        let output = process.stdout.take().expect("piped");
        BufReader::new(output).read_line(&mut line).expect("ready");
        let ready: serde_json::Value = serde_json::from_str(&line).expect("the ready line");
        Daemon {
            process,
            control,
            endpoint: ready["endpoints"][0]
                .as_str()
                .expect("an endpoint")
                .to_owned(),
        }
    }

    /// Its process.
    pub fn process(&self) -> u32 {
        self.process.id()
    }

    /// Where programs attach.
    pub fn control(&self) -> &Path {
        &self.control
    }

    /// Where peers reach it.
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
