//! Three daemons that know each other, of which the first owns the resource `counter`.

use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;

use crate::support::daemon::{Daemon, Place, tool};
use crate::support::process::{Ended, Process, run};

pub(crate) const BOTH: [&str; 2] = ["ricart-agrawala", "suzuki-kasami"];

pub(crate) struct Robots {
    pub(crate) daemons: Vec<Daemon>,
    pub(crate) place: Place,
}

impl Robots {
    pub(crate) fn start() -> Robots {
        let place = Place::new();
        let state = place.path("state");
        let state = state.to_str().unwrap();
        let owning = ["--no-mdns", "--owns", "counter", "--state", state];
        let mut daemons = vec![place.start_with("robot1", &owning)];
        let peer = daemons[0].endpoint().to_owned();
        for name in ["robot2", "robot3"] {
            daemons.push(place.start_with(name, &["--no-mdns", "--peer", &peer]));
        }
        for daemon in &daemons {
            daemon.wait_for("locks@robot1");
        }
        // Who joins last knows the others; the second one has to hear of it.
        let _here = daemons[2].attach("listen", "here@robot3");
        daemons[1].wait_for("here@robot3");
        Robots { daemons, place }
    }

    /// The agent `a@` and the name of a daemon, counted from 0.
    pub(crate) fn member(&self, at: usize) -> Member {
        Member::at(&self.daemons[at])
    }

    /// The resource as its owner sees it, asked at a daemon.
    pub(crate) fn listed(&self, at: usize) -> Value {
        let ended = self.daemons[at].run(&["lock", "list", "--json"]);
        ended.only_json()
    }
}

/// Who runs `fipa lock`.
pub(crate) struct Member {
    pub(crate) name: String,
    control: PathBuf,
}

impl Member {
    pub(crate) fn at(daemon: &Daemon) -> Member {
        Member {
            name: format!("a@{}", daemon.name()),
            control: daemon.control.clone(),
        }
    }

    /// `fipa lock RESOURCE` with a script of the shell.
    pub(crate) fn lock(&self, resource: &str, options: &[&str], script: &str) -> Command {
        let mut command = tool(&["lock", resource, "--as", &self.name]);
        command.arg("--control").arg(&self.control).args(options);
        command.args(["--", "sh", "-c", script]);
        command
    }

    /// The same for the counter, to its end.
    pub(crate) fn run(&self, options: &[&str], script: &str) -> Ended {
        run(self.lock("counter", options, script))
    }

    /// Begins to hold the counter, until its standard input ends.
    pub(crate) fn hold(&self, options: &[&str]) -> Process {
        let script = "echo $FIPA_LOCK_FENCING; read line";
        let mut holder = Process::start(self.lock("counter", options, script));
        holder.line();
        holder
    }
}
