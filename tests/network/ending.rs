//! How daemons begin and end: signals, exit codes and control sockets.

use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::time::Duration;

use rustix::process::Signal;

use crate::support::daemon::{Place, fipad};
use crate::support::process::{Process, run};

/// How long a daemon may take for its goodbyes.
const GOODBYE: Duration = Duration::from_secs(3);

/// How soon others know of a goodbye. A daemon that vanishes without one is waited for longer.
const AT_ONCE: Duration = Duration::from_millis(1500);

#[test]
fn a_daemon_that_is_told_to_end_takes_its_leave_and_ends_with_0() {
    for signal in [Signal::TERM, Signal::INT] {
        let place = Place::new();
        let (one, two, _echo) = place.pair();
        let mut watch = Process::start(one.fipa(&["agents", "echo@.*", "--watch", "--json"]));
        assert_eq!(watch.json()["event"], "added");
        let control = two.control.clone();
        let metadata = std::fs::metadata(&control).unwrap();
        assert!(metadata.file_type().is_socket());
        assert_eq!(metadata.permissions().mode() & 0o777, 0o600);

        two.signal(signal);
        let line = watch.line_within(AT_ONCE);
        assert!(line.contains(r#""removed""#), "{line}");
        let ended = two.into_process().wait_within(GOODBYE);
        assert_eq!(ended.code, Some(0), "{ended:?}");
        assert!(!control.exists());
    }
}

#[test]
fn a_second_daemon_does_not_take_the_control_socket_of_a_living_one() {
    let place = Place::new();
    let one = place.start("robot1");
    let ended = run(place.fipad("robot1"));
    assert_eq!(ended.code, Some(3), "{ended:?}");
    let control = one.control.to_str().unwrap();
    assert!(ended.only_error().contains(control), "{ended:?}");
    assert_eq!(ended.output, [""; 0]);
    // The first one has kept it.
    let _echo = one.attach("echo", "echo@robot1");
    assert_eq!(one.run(&["ping", "echo@robot1"]).code, Some(0));
}

#[test]
fn of_daemons_that_start_at_once_one_takes_the_control_socket() {
    let place = Place::new();
    for _ in 0..20 {
        let start = || {
            let mut command = place.fipad("robot1");
            command.arg("--no-mdns");
            Process::start(command)
        };
        let mut both = [start(), start()];
        // The file of the round before is a dead one.
        let ready = both
            .each_mut()
            .map(|process| process.line_or_end().is_some());
        assert!(ready[0] != ready[1], "ready: {ready:?}");
        let [one, other] = both;
        let late = if ready[0] { other } else { one };
        assert_eq!(late.wait().code, Some(3));
    }
}

#[test]
fn the_control_socket_of_a_dead_daemon_is_replaced() {
    let place = Place::new();
    let one = place.start("robot1");
    let control = one.control.clone();
    one.kill();
    assert!(control.exists());
    let again = place.start("robot1");
    let _echo = again.attach("echo", "echo@robot1");
    assert_eq!(again.run(&["ping", "echo@robot1"]).code, Some(0));
}

#[test]
fn a_file_that_is_no_socket_is_not_replaced() {
    let place = Place::new();
    std::fs::write(place.path("robot1.sock"), "precious").unwrap();
    let ended = run(place.fipad("robot1"));
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.only_error().contains("robot1.sock"), "{ended:?}");
    let kept = std::fs::read_to_string(place.path("robot1.sock")).unwrap();
    assert_eq!(kept, "precious");
}

#[test]
fn an_endpoint_that_is_taken_ends_a_daemon_with_3() {
    let place = Place::new();
    let one = place.start("robot1");
    let mut command = place.fipad("robot2");
    command.args(["--listen", one.endpoint()]);
    let ended = run(command);
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.only_error().contains(one.endpoint()), "{ended:?}");
    assert!(!place.path("robot2.sock").exists());
}

#[test]
fn wrong_usage_of_the_daemon_ends_with_2_and_one_line() {
    for words in [
        &["--listen", "nowhere"][..],
        &["--peer", "tcp://10.0.0.1:0"],
        &["--no-such-option"],
        &["--name", "two words"],
    ] {
        let mut command = fipad();
        command.args(words);
        let ended = run(command);
        assert_eq!(ended.code, Some(2), "{words:?}: {ended:?}");
        ended.only_error();
    }
}
