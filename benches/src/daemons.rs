//! Daemons as processes: the bench calls itself again as `fipad`.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

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
    /// Starts a daemon without mDNS, which dials these peers.
    pub fn start(folder: &Path, name: &str, peers: &[&str]) -> Daemon {
        let control = folder.join(format!("{name}.sock"));
        let mut command = Command::new(std::env::current_exe().expect("this program"));
        command
            .args(["--json", "--no-mdns", "--name", name, "--control"])
            .arg(&control)
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
