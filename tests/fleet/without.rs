//! Daemons without a fleet.

use crate::place::Fleet;
use crate::support::daemon::Place;
use crate::support::namespace::Namespace;
use crate::support::process::{Process, run};

#[test]
fn who_requires_a_fleet_does_not_listen_beyond_loopback_without_one() {
    let place = Place::new();
    for endpoint in ["tcp://0.0.0.0:0", "quic://0.0.0.0:0"] {
        let mut command = place.fipad("robot1");
        command.args(["--no-mdns", "--require-fleet", "--listen", endpoint]);
        let ended = run(command);
        assert_eq!(ended.code, Some(3), "{ended:?}");
        let said = format!("{endpoint} is open to everybody");
        assert!(ended.only_error().contains(&said), "{ended:?}");
    }

    let on_loopback = place.start_with("robot2", &["--no-mdns", "--require-fleet"]);
    assert_eq!(on_loopback.ready["event"], "ready");

    let fleet = Fleet::new();
    fleet.join("robot3");
    let mut command = fleet.fipad("robot3", &[]);
    command.args([
        "--require-fleet",
        "--fleet-mode",
        "open",
        "--listen",
        "0.0.0.0:0",
    ]);
    assert_eq!(run(command).code, Some(3));
}

#[test]
fn a_daemon_that_is_open_to_everybody_says_so_at_each_start() {
    let Some(host) = Namespace::new() else {
        return;
    };
    let place = Place::new();
    for _ in 0..2 {
        let mut command = place.fipad("robot1");
        command.env("FIPA_LOG", "warn");
        command.args(["--no-mdns", "--listen", "0.0.0.0:0"]);
        let mut daemon = Process::start(host.enter(&command));
        let said = daemon.error_line();
        assert!(
            said.contains("anybody who reaches tcp://0.0.0.0:0"),
            "{said}"
        );
        daemon.json();
    }
    let mut command = place.fipad("robot1");
    command.env("FIPA_LOG", "warn");
    command.arg("--no-mdns");
    let mut quiet = Process::start(host.enter(&command));
    quiet.json();
    quiet.signal(rustix::process::Signal::TERM);
    assert_eq!(quiet.wait().errors, [""; 0]);
}

#[test]
fn a_fleet_that_is_not_there_or_does_not_fit_is_told() {
    let fleet = Fleet::new();
    let missing = run(fleet.fipad("robot1", &[]));
    assert_eq!(missing.code, Some(3));
    assert!(
        missing.only_error().contains("fipa key join"),
        "{missing:?}"
    );

    fleet.join("robot1");
    let mut other = fleet.fipad("robot2", &[]);
    other.arg("--fleet").arg(fleet.folder("robot1"));
    let mut named = fleet.place.fipad("robot2");
    named
        .arg("--no-mdns")
        .arg("--fleet")
        .arg(fleet.folder("robot1"));
    let ended = run(named);
    assert_eq!(ended.code, Some(2));
    assert!(
        ended
            .only_error()
            .contains("is for robot1, and the platform is to be robot2"),
        "{ended:?}"
    );

    let mut pinned = fleet.fipad("robot1", &[]);
    pinned.args(["--fleet-mode", "pinned"]);
    assert_eq!(run(pinned).code, Some(2));
}
