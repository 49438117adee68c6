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
fn each_verdict_is_explained_on_request() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let listen = ["listen", "--as", "drive@robot1", "--explain"];
    let say = |act: &str| {
        let words = ["send", "--to", "drive@robot1", "--from", "arm@robot1"];
        let talk = ["--protocol", "fipa-request", "--conversation-id", "c-1"];
        let ended = daemon.run(&[&words[..], &talk, &["--performative", act]].concat());
        assert_eq!(ended.code, Some(0), "{ended:?}");
    };
    let violation = "arm@robot1 may not send propose in the state requested of fipa-request; \
                     expected: refuse, agree, inform or failure from participant (drive@robot1) \
                     to initiator (arm@robot1)";

    let people = daemon.attach_with(&[&listen[..], &["--count", "3"]].concat());
    say("request");
    say("propose");
    send(&daemon, "drive@robot1", "by the way");
    let ended = people.wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(ended.output.len(), 6, "{ended:?}");
    assert_eq!(ended.output[0], "arm@robot1: request ");
    assert_eq!(ended.output[1], "  accepted: requested");
    assert_eq!(
        ended.output[3],
        format!("  violation [performative]: {violation}")
    );
    assert!(ended.output[5].starts_with("  not monitored"), "{ended:?}");

    let mut programs = daemon.attach_with(&[&listen[..], &["--json"]].concat());
    say("request");
    assert_eq!(keys(&programs.json()), ["envelope", "message"]);
    assert_eq!(
        programs.error_line(),
        r#"{"n":1,"verdict":"accepted","state":"requested","rule":null,"expected":[]}"#
    );
    say("propose");
    programs.json();
    let verdict: serde_json::Value = serde_json::from_str(&programs.error_line()).unwrap();
    assert_eq!(verdict["verdict"], "violation");
    assert_eq!(verdict["rule"], "performative");
    assert_eq!(verdict["expected"].as_array().unwrap().len(), 4);
    assert_eq!(verdict["expected"][0]["performative"], "refuse");
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
