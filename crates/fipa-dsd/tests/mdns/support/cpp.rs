//! What stands for C++ robots: python-zeroconf, and the avahi that they use themselves.
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use super::namespace::Namespace;

/// The signature of the recorded locations.
const SIGNATURE: &str = "fipa::services::transports::MessageTransport";

/// Whether a program can be run; says so if not, and fails where nothing may be skipped.
pub(crate) fn can_run(what: &str, program: &str, arguments: &[&str]) -> bool {
    let tried = Command::new(program).args(arguments).output();
    let able = tried.is_ok_and(|output| output.status.success());
    if !able {
        assert!(
            std::env::var_os("FIPA_TEST_ALL").is_none_or(|v| v != "1"),
            "needs {what}"
        );
        println!("skipped: needs {what}");
    }
    able
}

/// Whether python-zeroconf is there.
pub(crate) fn can_play_cpp_robot() -> bool {
    can_run("python-zeroconf", "python3", &["-c", "import zeroconf"])
}

/// A robot whose directory is announced by python-zeroconf.
pub(crate) struct CppRobot {
    process: Child,
    commands: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl CppRobot {
    /// Starts a robot that speaks on the interface with this address.
    pub(crate) fn start(namespace: &Namespace, address: &str) -> CppRobot {
        let script = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/tests/mdns/support/cpp_robot.py"
        );
        let mut process = namespace
            .command("python3")
            .args([script, address])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        CppRobot {
            commands: process.stdin.take().unwrap(),
            answers: BufReader::new(process.stdout.take().unwrap()),
            process,
        }
    }

    /// Announces an agent with these TXT strings.
    pub(crate) fn publish(&mut self, label: &str, strings: &[&str]) {
        self.command(&format!("publish {label} {}", strings.join("|")));
    }

    /// Says goodbye to an agent.
    pub(crate) fn withdraw(&mut self, label: &str) {
        self.command(&format!("withdraw {label}"));
    }

    fn command(&mut self, command: &str) {
        writeln!(self.commands, "{command}").unwrap();
        let mut answer = String::new();
        self.answers.read_line(&mut answer).unwrap();
        assert_eq!(answer, "done\n");
    }
}

impl Drop for CppRobot {
    /// Ends it as a crash does: no goodbye.
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The recorded form of a client of the C++ transport, with the locator cut as it is there.
pub(crate) fn recorded_form(addresses: &[&str]) -> Vec<String> {
    let locations = addresses.iter();
    let locator: String = locations
        .map(|address| format!("{address} {SIGNATURE};"))
        .collect();
    let mut strings = vec![format!("TYPE={SIGNATURE}")];
    let chunks = locator.as_bytes().chunks(192);
    strings.extend(chunks.map(|chunk| format!("LOCATOR={}", str::from_utf8(chunk).unwrap())));
    strings.push("DESCRIPTION=Message client of mts-0".to_owned());
    strings.push("TIMESTAMP=20261122-06:53:02:938849".to_owned());
    strings
}

/// An avahi in a namespace, with a message bus of its own.
pub(crate) struct Avahi {
    folder: tempfile::TempDir,
    processes: Vec<Child>,
}

impl Avahi {
    /// Starts avahi on one interface of a namespace.
    pub(crate) fn start(namespace: &Namespace, interface: &str) -> Avahi {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let policy = "<allow send_destination='*' eavesdrop='true'/><allow eavesdrop='true'/>\
             <allow own='*'/><allow user='*'/>";
        let bus = format!(
            "<!DOCTYPE busconfig PUBLIC '-//freedesktop//DTD D-Bus Bus Configuration 1.0//EN' \
             'http://www.freedesktop.org/standards/dbus/1.0/busconfig.dtd'><busconfig>\
             <listen>unix:path={}</listen><auth>EXTERNAL</auth>\
             <policy context='default'>{policy}</policy></busconfig>",
            path("bus")
        );
        fs::write(path("bus.conf"), bus).unwrap();
        let server = format!("[server]\nallow-interfaces={interface}\nuse-ipv6=no\n");
        fs::write(path("avahi.conf"), server).unwrap();

        let mut avahi = Avahi {
            processes: Vec::new(),
            folder,
        };
        let path = |name: &str| avahi.folder.path().join(name).display().to_string();
        let bus = format!(
            "exec dbus-daemon --nofork --nopidfile --config-file={}",
            path("bus.conf")
        );
        // Where avahi keeps its process id there must be no other's.
        let daemon = format!(
            "mount -t tmpfs none /run && mkdir /run/avahi-daemon && \
             exec avahi-daemon --no-drop-root --no-chroot --no-rlimits -f {}",
            path("avahi.conf")
        );
        avahi.processes.push(avahi.spawn(namespace, &bus));
        while !avahi.folder.path().join("bus").exists() {
            std::thread::sleep(Duration::from_millis(10));
        }
        let daemon = avahi.spawn(namespace, &daemon);
        avahi.processes.push(daemon);
        avahi
    }

    /// The lines of `avahi-browse` for all services of a type, names and TXT strings included.
    pub(crate) fn browse(&self, namespace: &Namespace, service_type: &str) -> Vec<String> {
        let mut command = self.command(namespace, "avahi-browse");
        let output = command.args(["-rpt", service_type]).output().unwrap();
        let lines = String::from_utf8(output.stdout).unwrap();
        lines.lines().map(str::to_owned).collect()
    }

    fn spawn(&self, namespace: &Namespace, script: &str) -> Child {
        let mut command = self.command(namespace, "unshare");
        command
            .args(["-m", "--", "sh", "-c", script])
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    }

    fn command(&self, namespace: &Namespace, program: &str) -> Command {
        let bus = self.folder.path().join("bus");
        let mut command = namespace.command(program);
        command.env(
            "DBUS_SYSTEM_BUS_ADDRESS",
            format!("unix:path={}", bus.display()),
        );
        command
    }
}

impl Drop for Avahi {
    fn drop(&mut self) {
        for process in self.processes.iter_mut().rev() {
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}
