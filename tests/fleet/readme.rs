//! The commands of the README make a fleet of three, on machines that have nothing.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::support::daemon::{Daemon, Place, fipad, tool};
use crate::support::process::{Process, run};

/// The commands of the section.
fn commands() -> Vec<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md");
    let readme = fs::read_to_string(path).unwrap();
    let (_, section) = readme.split_once("## Keep strangers out\n").unwrap();
    let (section, _) = section.split_once("\n## ").unwrap();
    let lines = section.lines().filter_map(|line| line.strip_prefix("    "));
    lines.map(str::to_owned).collect()
}

/// A machine with a home of its own.
struct Machine<'a>(&'a Place, String);

impl Machine<'_> {
    fn new<'a>(place: &'a Place, name: &str) -> Machine<'a> {
        fs::create_dir(place.path(name)).unwrap();
        Machine(place, name.to_owned())
    }

    /// Runs a command of the README here.
    fn at_home(&self, mut command: Command) -> Command {
        let home = self.0.path(&self.1);
        command.env_remove("XDG_CONFIG_HOME");
        command.env("HOME", &home).current_dir(home);
        command
    }

    fn key(&self, line: &str) {
        let words: Vec<&str> = line.split(' ').skip(1).collect();
        let ended = run(self.at_home(tool(&words)));
        assert_eq!(ended.code, Some(0), "{line}: {ended:?}");
        let told = format!("{:?}", ended.output);
        assert!(!told.contains("PRIVATE"), "{told}");
    }

    fn copy(&self, file: &str, to: &Machine<'_>) {
        let (from, to) = (self.0.path(&self.1), to.0.path(&to.1));
        fs::copy(from.join(file), to.join(file)).unwrap();
    }
}

#[test]
fn a_fleet_of_three_is_made_by_the_commands_of_the_readme() {
    let place = Place::new();
    let commands = commands();
    let laptop = Machine::new(&place, "laptop");
    let of_operator =
        |line: &&String| line.contains("init") || line.contains("join") && line.contains("--out");
    for line in commands.iter().filter(of_operator) {
        laptop.key(line);
    }
    let of_robot: Vec<&String> = commands
        .iter()
        .filter(|line| {
            line.contains("robot1.fleet") && !line.contains("--out") || line.starts_with("fipad")
        })
        .collect();
    assert!(of_robot.len() < 5, "{of_robot:?}");

    let mut daemons: Vec<Daemon> = Vec::new();
    let mut echoes: Vec<Process> = Vec::new();
    for name in ["robot1", "robot2", "robot3"] {
        let robot = Machine::new(&place, name);
        laptop.copy(&format!("{name}.fleet"), &robot);
        for line in &of_robot {
            let line = line
                .replace("robot1", name)
                .replace("192.168.1.5:4100", "127.0.0.1:0");
            if line.starts_with("fipa ") {
                robot.key(&line);
                continue;
            }
            let mut command = fipad();
            command
                .args(line.split(' ').skip(1))
                .args(["--json", "--no-mdns"]);
            command
                .arg("--control")
                .arg(place.path(&format!("{name}.sock")));
            for peer in &daemons {
                command.args(["--peer", peer.endpoint()]);
            }
            daemons.push(Daemon::start(robot.at_home(command)));
        }
        let daemon = daemons.last().unwrap();
        assert_eq!(
            daemon.ready["name"], name,
            "the daemon bears the name of its certificate"
        );
        let agent = format!("echo@{name}");
        echoes.push(daemon.attach("echo", &agent));
    }
    for daemon in &daemons {
        for name in ["echo@robot1", "echo@robot2", "echo@robot3"] {
            daemon.wait_for(name);
            let ended = daemon.run(&["ping", name, "--count", "3", "--json"]);
            assert_eq!(ended.code, Some(0), "{ended:?}");
        }
    }
}
