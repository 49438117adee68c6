//! The programs against a second implementation of HIAC and of the text format, in Python, which
//! knows the octets only from their description.

use std::process::Command;

use crate::support::daemon::{Daemon, Place, tool};
use crate::support::process::{Process, run};
use crate::support::skipped;

/// A run takes some seconds, for which silence must be waited.
const WHOLE_RUN: std::time::Duration = std::time::Duration::from_secs(60);

/// Runs a script to its end, which must be a good one.
fn peer(script: &str, args: &[&str]) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/hiac/");
    let mut command = Command::new("python3");
    command.arg("-B").arg(format!("{folder}{script}"));
    command.args(args);
    let ended = Process::start(command).wait_within(WHOLE_RUN);
    assert_eq!(ended.code, Some(0), "{}", ended.errors.join("\n"));
}

fn has_python() -> bool {
    let there = Command::new("python3").arg("--version").output();
    let there = there.is_ok_and(|output| output.status.success());
    if !there {
        skipped("python3");
    }
    there
}

/// HOST:PORT of the listening URL with this index.
fn place(daemon: &Daemon, index: usize) -> &str {
    host_and_port(daemon.ready["hiac"][index].as_str().unwrap())
}

fn host_and_port(url: &str) -> &str {
    let place = url.strip_prefix("tcp://").unwrap();
    place.split_once('?').unwrap().0
}

#[test]
fn the_tool_reads_and_writes_the_octets_that_another_codec_does() {
    if has_python() {
        for seed in ["1", "2"] {
            peer("tools.py", &[env!("CARGO_BIN_EXE_fipa"), seed]);
            peer("text.py", &[env!("CARGO_BIN_EXE_fipa"), seed]);
        }
    }
}

#[test]
fn another_employer_finds_all_in_our_device_that_it_expects() {
    if !has_python() {
        return;
    }
    let listen = "tcp://127.0.0.1:0?listen";
    let words = ["hiac", "device", listen, "--name", "drive", "--json"];
    let mut device = Process::start(tool(&words));
    let listening = device.json();
    peer(
        "employer.py",
        &[host_and_port(listening["url"].as_str().unwrap())],
    );
}

#[test]
fn other_devices_are_agents_of_the_fleet_and_colleagues_of_each_other() {
    if !has_python() {
        return;
    }
    let home = Place::new();
    let file = home.path("fipad.toml");
    let config = "hiac = \"tcp://127.0.0.1:0?listen\"\n\
                  hiac-address = \"20:C4:D2:00/00:00:00:FF\"\n\
                  [hiac-aliases]\n\"20:C4:D2:20\" = \"echo@robot1\"\n";
    std::fs::write(&file, config).unwrap();
    let daemon = home.start_with("robot1", &["--config", file.to_str().unwrap()]);
    let _echo = daemon.attach("echo", "echo@robot1");
    let control = daemon.control.to_str().unwrap();
    let fipa = env!("CARGO_BIN_EXE_fipa");
    peer("device.py", &[place(&daemon, 0), fipa, control]);
    let none = run(daemon.fipa(&["hiac", "devices"]));
    assert_eq!(none.code, Some(1), "{none:?}");
}

#[test]
fn the_daemon_obeys_another_employer_and_is_its_gateway_to_the_device_below() {
    if !has_python() {
        return;
    }
    let home = Place::new();
    let options = [
        "--hiac",
        "tcp://127.0.0.1:0?listen&role=employee",
        "--hiac",
        "tcp://127.0.0.1:0?listen",
        "--hiac-address",
        "20:C4:D2:00/00:00:00:FF",
    ];
    let daemon = home.start_with("robot1", &options);
    peer("above.py", &[place(&daemon, 0), place(&daemon, 1)]);
}
