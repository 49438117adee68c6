//! Daemons, and the commands that talk to them.

use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::Signal;
use serde_json::Value;

use super::PATIENCE;
use super::namespace::Namespace;
use super::process::{Ended, Process, run};

/// Where daemons live: a folder for their control sockets, and an mDNS port of their own.
pub(crate) struct Place {
    folder: tempfile::TempDir,
    mdns_port: u16,
}

/// A daemon that has said that it is ready.
pub(crate) struct Daemon {
    process: Process,
    pub(crate) control: PathBuf,
    pub(crate) ready: Value,
}

impl Place {
    pub(crate) fn new() -> Place {
        Place {
            folder: tempfile::tempdir().unwrap(),
            mdns_port: fipa_dsd::free_mdns_port().unwrap(),
        }
    }

    /// A place whose daemons speak mDNS where everybody does: for networks of the test alone.
    pub(crate) fn at_the_usual_port() -> Place {
        Place {
            mdns_port: fipa_dsd::MDNS_PORT,
            ..Place::new()
        }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The command of the daemon `NAME`, with a control socket of its own. Others of the place
    /// find it by mDNS on loopback.
    pub(crate) fn fipad(&self, name: &str) -> Command {
        let mut command = fipad();
        command.args(["--json", "--name", name]);
        command
            .args(["--mdns-port", &self.mdns_port.to_string()])
            .arg("--control")
            .arg(self.path(&format!("{name}.sock")));
        command
    }

    /// Starts the daemon `NAME`.
    pub(crate) fn start(&self, name: &str) -> Daemon {
        Daemon::start(self.fipad(name))
    }

    /// Starts the daemon `NAME` with further options.
    pub(crate) fn start_with(&self, name: &str, options: &[&str]) -> Daemon {
        let mut command = self.fipad(name);
        command.args(options);
        Daemon::start(command)
    }

    /// Starts the daemon `NAME` in a namespace, with further options.
    pub(crate) fn start_in(&self, namespace: &Namespace, name: &str, options: &[&str]) -> Daemon {
        let mut command = self.fipad(name);
        command.args(options);
        Daemon::start(namespace.enter(&command))
    }

    /// Two daemons that know each other by mDNS, and the agent `echo@robot2` at the second one.
    pub(crate) fn pair(&self) -> (Daemon, Daemon, Process) {
        let (one, two) = (self.start("robot1"), self.start("robot2"));
        let echo = two.attach("echo", "echo@robot2");
        one.wait_for("echo@robot2");
        (one, two, echo)
    }
}

impl Daemon {
    pub(crate) fn start(command: Command) -> Daemon {
        let mut process = Process::start(command);
        let ready = process.json();
        assert_eq!(ready["event"], "ready");
        Daemon {
            process,
            control: PathBuf::from(ready["control"].as_str().unwrap()),
            ready,
        }
    }

    /// The name of its message transport service.
    pub(crate) fn name(&self) -> &str {
        self.ready["name"].as_str().unwrap()
    }

    /// Where it listens first.
    pub(crate) fn endpoint(&self) -> &str {
        self.ready["endpoints"][0].as_str().unwrap()
    }

    /// A command of the tool that talks to it.
    pub(crate) fn fipa(&self, words: &[&str]) -> Command {
        fipa(&self.control, words)
    }

    /// Runs a command of the tool to its end.
    pub(crate) fn run(&self, words: &[&str]) -> Ended {
        run(self.fipa(words))
    }

    /// What `fipa doctor` finds, run where the daemon runs: the checks that did not go well, and
    /// the exit code.
    pub(crate) fn doctor(&self, namespace: Option<&Namespace>, words: &[&str]) -> Vec<Value> {
        let words = [&["doctor", "--json"], words].concat();
        let command = self.fipa(&words);
        let ended = run(namespace.map_or(command, |namespace| namespace.enter(&self.fipa(&words))));
        let checks = ended.json();
        let failed = checks.iter().any(|check| check["state"] == "failed");
        assert_eq!(ended.code, Some(i32::from(failed)), "{ended:?}");
        for check in &checks {
            let keys = super::process::keys(check);
            assert_eq!(keys, ["check", "state", "said", "advice"]);
            assert_eq!(check["advice"].is_null(), check["state"] == "ok", "{check}");
        }
        let bad = checks.into_iter().filter(|check| check["state"] != "ok");
        bad.collect()
    }

    /// Starts `fipa listen`, `fipa echo` or `fipa attach` and waits until the agent is attached.
    pub(crate) fn attach(&self, command: &str, name: &str) -> Process {
        self.attach_with(&[command, "--as", name])
    }

    /// The same with further options.
    pub(crate) fn attach_with(&self, words: &[&str]) -> Process {
        let mut process = Process::start(self.fipa(words));
        let name = words[words.iter().position(|word| *word == "--as").unwrap() + 1];
        assert_eq!(process.error_line(), format!("attached {name}"));
        process
    }

    /// Waits until it knows an agent of this name.
    pub(crate) fn wait_for(&self, name: &str) {
        let platform = fipa::blocking::Platform::attach_to(&self.control).unwrap();
        let found = platform.wait_for(name, PATIENCE);
        assert!(found.is_some(), "{} does not know {name}", self.name());
    }

    /// The next event that it tells on standard output.
    pub(crate) fn event(&mut self) -> Value {
        self.process.json()
    }

    /// The number of its process.
    pub(crate) fn id(&self) -> u32 {
        self.process.id()
    }

    pub(crate) fn signal(&self, signal: Signal) {
        self.process.signal(signal);
    }

    /// Ends it as a crash does.
    pub(crate) fn kill(self) {
        self.process.kill();
    }

    /// The process, to wait for its end.
    pub(crate) fn into_process(self) -> Process {
        self.process
    }
}

/// The daemon, undisturbed by the environment of whoever runs the tests.
pub(crate) fn fipad() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fipad"));
    for (key, _) in std::env::vars_os() {
        if key.to_string_lossy().starts_with("FIPAD_") {
            command.env_remove(key);
        }
    }
    command.env("FIPA_LOG", "error");
    // The fleet of whoever runs the tests is no matter of theirs.
    command.env("XDG_CONFIG_HOME", "/nonexistent");
    command
}

/// A command of the tool that talks to the daemon at this control socket.
pub(crate) fn fipa(control: &Path, words: &[&str]) -> Command {
    let mut command = tool(words);
    command.arg("--control").arg(control);
    command
}

/// A command of the tool that talks to no daemon.
pub(crate) fn tool(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fipa"));
    command.args(words).env("XDG_CONFIG_HOME", "/nonexistent");
    command
}
