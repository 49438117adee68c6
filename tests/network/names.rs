//! Daemons that were given no name.

use std::path::Path;
use std::process::Command;

use crate::support::daemon::{Daemon, fipad};
use crate::support::process::Process;

#[test]
fn two_daemons_of_a_host_take_different_default_names_and_know_each_other() {
    // The locks of the names are kept here, away from those of the machine's own daemons.
    let folder = tempfile::tempdir().unwrap();
    let port = fipa_dsd::free_mdns_port().unwrap().to_string();
    let start = |control| Daemon::start(unnamed(folder.path(), &port, control));
    // Both at once, so that neither can hear of the other before it has its name.
    let (first, second) = std::thread::scope(|scope| {
        let first = scope.spawn(|| start("1.sock"));
        let second = scope.spawn(|| start("2.sock"));
        (first.join().unwrap(), second.join().unwrap())
    });
    let (plain, other) = match first.name().starts_with("mts@") {
        true => (first, second),
        false => (second, first),
    };
    let host = plain.name().strip_prefix("mts@").unwrap();
    let hex = other.name().strip_prefix("mts-").unwrap();
    let hex = hex.strip_suffix(&format!("@{host}")).unwrap();
    assert!(hex.len() == 4 && hex.chars().all(|c| c.is_ascii_hexdigit()));

    let _echoes: [Process; 2] = [
        plain.attach("echo", "echo@plain"),
        other.attach("echo", "echo@other"),
    ];
    for (daemon, agent) in [(&plain, "echo@other"), (&other, "echo@plain")] {
        let ended = daemon.run(&["ping", agent]);
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
}

#[test]
fn two_daemons_of_the_same_name_both_say_so() {
    let folder = tempfile::tempdir().unwrap();
    let port = fipa_dsd::free_mdns_port().unwrap().to_string();
    let [mut one, mut two] = ["1.sock", "2.sock"].map(|control| {
        let mut command = unnamed(folder.path(), &port, control);
        command.args(["--name", "robot1"]);
        Daemon::start(command)
    });
    for daemon in [&mut one, &mut two] {
        assert_eq!(daemon.name(), "robot1");
        let event = daemon.event();
        assert_eq!(event["event"], "conflict");
        assert_eq!(event["name"], "robot1");
    }
}

/// A daemon without a name, with the locks of names and its control socket in this folder.
fn unnamed(folder: &Path, port: &str, control: &str) -> Command {
    let mut command = fipad();
    command
        .env("TMPDIR", folder)
        .args(["--json", "--mdns-port", port, "--control"])
        .arg(folder.join(control));
    command
}
