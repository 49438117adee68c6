//! `fipa listen`: letters as they come, and when it ends.

use rustix::process::Signal;

use crate::support::daemon::{Daemon, Place};
use crate::support::process::{Process, keys};

fn send(daemon: &Daemon, to: &str, content: &str) {
    let words = ["send", "--to", to, "--performative", "inform", "--content"];
    let ended = daemon.run(&[&words[..], &[content]].concat());
    assert_eq!(ended.code, Some(0), "{ended:?}");
}

#[test]
fn enough_messages_end_it_with_0_and_each_is_a_line() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let mut listener = daemon.attach_with(&["listen", "--as", "drive@robot1", "--count", "2"]);
    send(&daemon, "drive@robot1", "one");
    assert!(listener.line().ends_with(": inform one"));
    send(&daemon, "drive@robot1", "two");
    let ended = listener.wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(ended.output.len(), 1);
    assert!(ended.output[0].ends_with(": inform two"));
}

#[test]
fn too_few_messages_in_the_time_end_it_with_1() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let words = ["listen", "--as", "drive@robot1", "--timeout", "1"];
    let few = daemon.attach_with(&[&words[..], &["--count", "2"]].concat());
    send(&daemon, "drive@robot1", "one");
    let ended = few.wait();
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert_eq!(ended.output.len(), 1);
    ended.only_error();
    // Without a count there is nothing that could be missing.
    assert_eq!(daemon.attach_with(&words).wait().code, Some(0));
}

#[test]
fn a_letter_shows_its_stamps_in_the_order_in_which_it_travelled() {
    let place = Place::new();
    let (one, two, _echo) = place.pair();
    let mut listener = two.attach_with(&["listen", "--as", "drive@robot2", "--json"]);
    one.wait_for("drive@robot2");
    send(&one, "drive@robot2", "go");
    let letter = listener.json();
    assert_eq!(keys(&letter), ["envelope", "message"]);
    assert_eq!(letter["message"]["content"], "go");
    let envelope = &letter["envelope"];
    assert_eq!(envelope["to"][0]["name"], "drive@robot2");
    assert_eq!(envelope["intended-receiver"][0]["name"], "drive@robot2");
    assert_eq!(
        envelope["acl-representation"],
        "fipa.acl.rep.bitefficient.std"
    );
    assert_eq!(envelope["from"], letter["message"]["sender"]);
    let stamps = envelope["received"].as_array().unwrap();
    let by: Vec<&str> = stamps.iter().map(|s| s["by"].as_str().unwrap()).collect();
    assert_eq!(by, ["robot1", "robot2"]);
    assert_eq!(stamps[1]["from"], "robot1");
}

#[test]
fn a_name_that_somebody_holds_ends_it_with_1() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _holder = daemon.attach("echo", "drive@robot1");
    for command in ["listen", "echo", "attach"] {
        let ended = daemon.run(&[command, "--as", "drive@robot1"]);
        assert_eq!(ended.code, Some(1), "{command}: {ended:?}");
        assert!(ended.only_error().contains("drive@robot1"), "{ended:?}");
    }
}

#[test]
fn a_name_that_cannot_be_is_wrong_usage() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    for command in ["listen", "echo", "attach"] {
        let ended = daemon.run(&[command, "--as", "two words"]);
        assert_eq!(ended.code, Some(2), "{command}: {ended:?}");
        ended.only_error();
    }
}

#[test]
fn signals_end_it_with_0_and_its_agent_is_gone() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let mut watch = Process::start(daemon.fipa(&["agents", "--watch", "--json"]));
    for command in ["listen", "echo", "attach"] {
        for signal in [Signal::TERM, Signal::INT] {
            let process = daemon.attach(command, "drive@robot1");
            assert_eq!(watch.json()["event"], "added");
            process.signal(signal);
            let ended = process.wait();
            assert_eq!(ended.code, Some(0), "{command}: {ended:?}");
            assert_eq!(watch.json()["event"], "removed");
        }
    }
}

#[test]
fn it_goes_on_when_the_daemon_was_killed_and_is_back() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let mut listener = daemon.attach("listen", "drive@robot1");
    send(&daemon, "drive@robot1", "before");
    assert!(listener.line().ends_with(": inform before"));
    daemon.kill();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    daemon.wait_for("drive@robot1");
    send(&daemon, "drive@robot1", "after");
    assert!(listener.line().ends_with(": inform after"));
}
