//! `fipad demo`, the tour that everybody takes first.

mod support;

use std::process::Command;
use std::time::Duration;

use support::daemon::{Daemon, fipa, fipad};
use support::process::{Ended, Process};

/// How long the tour may take.
const TOUR: Duration = Duration::from_secs(20);

#[test]
fn the_demo_takes_its_seven_steps_and_ends_with_0() {
    let mut command = fipad();
    command.arg("demo");
    seven_steps(&Process::start(command).wait_within(TOUR));
}

#[test]
fn the_demo_and_a_daemon_of_the_user_do_not_disturb_each_other() {
    let home = tempfile::tempdir().unwrap();
    let port = fipa_dsd::free_mdns_port().unwrap().to_string();
    let of_the_user = |command: &mut Command| {
        command
            .env("XDG_RUNTIME_DIR", home.path())
            .env("FIPAD_NAME", "robot1")
            .env("FIPAD_MDNS_PORT", &port)
            .env("FIPAD_JSON", "true");
    };
    let mut command = fipad();
    of_the_user(&mut command);
    let daemon = Daemon::start(command);
    let mut watch = Process::start(fipa(&daemon.control, &["agents", "--watch", "--json"]));
    let control = home.path().join("fipad.sock");
    assert_eq!(daemon.control, control);

    let mut command = fipad();
    of_the_user(&mut command);
    command
        .env("FIPAD_LISTEN", daemon.endpoint())
        .env("FIPAD_PEER", daemon.endpoint())
        .env("FIPAD_CONTROL", &control)
        .env("FIPAD_SCOPE", "plant")
        .env("FIPAD_MAX_LETTER", "1")
        .env("FIPAD_CONFIG", home.path().join("missing.toml"))
        .arg("demo");
    seven_steps(&Process::start(command).wait_within(TOUR));

    let _last = daemon.attach("listen", "last@robot1");
    let first = watch.json();
    assert_eq!(first["event"], "added");
    assert_eq!(first["agent"]["name"], "last@robot1");
}

fn seven_steps(demo: &Ended) {
    assert_eq!(demo.code, Some(0), "{demo:#?}");
    let steps: Vec<&str> = demo
        .output
        .iter()
        .filter(|line| line.starts_with(|c: char| c.is_ascii_digit()))
        .map(|line| line.split('.').next().unwrap())
        .collect();
    assert_eq!(steps, ["1", "2", "3", "4", "5", "6", "7"], "{demo:#?}");
}
