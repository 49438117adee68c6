//! Two daemons and a robot with the C++ `fipa_services`, on one network.

use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::PATIENCE;
use crate::support::cpp::{CppRobot, SIGNATURE};
use crate::support::daemon::{Daemon, Place, tool};
use crate::support::namespace::Namespace;
use crate::support::process::Process;

/// A letter that the C++ transport wrote from `agent-a` to `agent-b`.
const RECORDED: &[u8] = include_bytes!("../vectors/mts/sent_00_to_agent-b.bin");

struct Network {
    one: Daemon,
    two: Daemon,
    robot: CppRobot,
    _hosts: Vec<Namespace>,
    _place: Place,
}

/// Daemons at 192.168.100.101 and .102, a C++ robot at .103.
fn network() -> Option<Network> {
    let hosts = Namespace::bridged(3)?;
    let robot = CppRobot::start(&hosts[2], "192.168.100.103")?;
    let place = Place::at_the_usual_port();
    let one = place.start_in(&hosts[0], "robot1", &["--listen", "0.0.0.0:0"]);
    let two = place.start_in(&hosts[1], "robot2", &["--listen", "0.0.0.0:0"]);
    Some(Network {
        one,
        two,
        robot,
        _hosts: hosts,
        _place: place,
    })
}

#[test]
fn a_cpp_robot_is_found_sent_to_and_received_from_by_both_daemons() {
    let Some(mut network) = network() else {
        return;
    };
    let port = network.robot.port;
    let location = format!("tcp://192.168.100.103:{port}");
    let locator = format!("{location} {SIGNATURE};");
    network.robot.publish("agent-a", &locator);
    for (daemon, content) in [(&network.one, "from one"), (&network.two, "from two")] {
        daemon.wait_for("agent-a");
        let agent = agent(daemon, "agent-a");
        assert_eq!(agent["source"], "mdns");
        assert_eq!(agent["locations"][0]["address"], location.as_str());
        assert_eq!(agent["timestamp"], "2026-11-22T06:53:02.938Z");
        send(daemon, "agent-a", content, &location);
        let letter = decoded(&network.robot.letter());
        assert_eq!(letter["message"]["content"], content);
        assert_eq!(
            letter["envelope"]["intended-receiver"][0]["name"],
            "agent-a"
        );
    }

    for daemon in [&network.one, &network.two] {
        let mut listening = daemon.attach_with(&["listen", "--as", "agent-b", "--json"]);
        let strings = network.robot.found("agent-b");
        let place = strings[1].strip_prefix("LOCATOR=").unwrap();
        let place = place.split(' ').next().unwrap();
        assert_eq!(place, daemon.endpoint());
        network.robot.send(place, RECORDED);
        let letter = listening.json();
        assert_eq!(letter["message"]["content"], "one remote");
        assert_eq!(letter["message"]["sender"]["name"], "agent-a");
        drop(listening);
        network.robot.gone("agent-b");
    }
}

#[test]
fn the_last_of_four_places_is_read_from_a_second_string_and_reached() {
    let Some(mut network) = network() else {
        return;
    };
    let port = network.robot.port;
    let location = format!("tcp://192.168.100.103:{port}");
    // Nobody listens at the first three.
    let host = "tcp://192.168.100.103";
    let locator = format!(
        "{host}:9997 {SIGNATURE};{host}:9998 {SIGNATURE};{host}:10001 {SIGNATURE};\
         {location} {SIGNATURE};"
    );
    assert_eq!(locator.len(), 290);
    network.robot.publish("agent-a", &locator);
    for daemon in [&network.one, &network.two] {
        daemon.wait_for("agent-a");
        let until = Instant::now() + PATIENCE;
        while agent(daemon, "agent-a")["locations"][3]["address"] != location.as_str() {
            assert!(Instant::now() < until, "{}", agent(daemon, "agent-a"));
            std::thread::sleep(Duration::from_millis(50));
        }
        send(daemon, "agent-a", "here", &location);
        let letter = decoded(&network.robot.letter());
        assert_eq!(letter["message"]["content"], "here");
    }
}

#[test]
fn a_cpp_agent_goes_with_its_goodbye_and_a_dead_robot_when_a_letter_does_not_reach_it() {
    let Some(mut network) = network() else {
        return;
    };
    let location = format!("tcp://192.168.100.103:{}", network.robot.port);
    for label in ["agent-a", "agent-c"] {
        network
            .robot
            .publish(label, &format!("{location} {SIGNATURE};"));
    }
    let (one, two) = (&network.one, &network.two);
    let mut watch = Process::start(two.fipa(&["agents", "--watch", "--json"]));
    for _ in 0..2 {
        assert_eq!(watch.json()["event"], "added");
    }
    one.wait_for("agent-a");
    network.robot.withdraw("agent-c");
    let event = watch.json();
    assert_eq!(event["event"], "removed");
    assert_eq!(event["agent"]["name"], "agent-c", "nobody else flickers");
    network.robot.kill();
    let words = ["send", "--to", "agent-a", "--performative", "inform"];
    let ended = two.run(&[&words[..], &["--timeout", "5"]].concat());
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let event = watch.json();
    assert_eq!(event["event"], "removed");
    assert_eq!(event["agent"]["name"], "agent-a");
}

#[test]
fn an_agent_that_both_the_link_and_mdns_bring_is_one_entry() {
    let Some(mut network) = network() else {
        return;
    };
    let _arm = network.one.attach("listen", "arm.left");
    network.robot.found("arm?left");
    network.two.wait_for("arm.left");
    // Both ways have brought it by now: the robot has heard the same announcement.
    let ended = network.two.run(&["agents", ".*arm.*", "--json"]);
    assert_eq!(ended.only_json()["name"], "arm.left");
}

#[test]
fn who_is_not_announced_to_cpp_robots_is_told_once() {
    let place = Place::new();
    let mut one = place.start_with("robot1", &["--mdns-agents", "1"]);
    let two = place.start("robot2");
    let long = "a".repeat(64);
    let names = ["first", long.as_str(), "second", "third"];
    let _agents = names.map(|name| one.attach("listen", name));
    let told = [one.event(), one.event()];
    for event in &told {
        assert_eq!(event["event"], "not-announced");
    }
    assert_eq!(told[0]["name"], long.as_str());
    let reason = told[0]["reason"].as_str().unwrap();
    assert!(reason.starts_with("the name has 64 octets"), "{reason}");
    assert_eq!(told[1]["name"], "second");
    // Daemons know all of them.
    names.iter().for_each(|name| two.wait_for(name));
}

fn agent(daemon: &Daemon, name: &str) -> Value {
    daemon.run(&["agents", name, "--json"]).only_json()
}

fn send(daemon: &Daemon, to: &str, content: &str, via: &str) {
    let words = ["send", "--to", to, "--performative", "inform", "--json"];
    let ended = daemon.run(&[&words[..], &["--content", content]].concat());
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let outcome = ended.only_json();
    assert_eq!(outcome["outcome"], "sent", "{outcome}");
    assert_eq!(outcome["via"], via, "{outcome}");
}

fn decoded(letter: &[u8]) -> Value {
    let mut process = Process::start(tool(&["decode", "-"]));
    process.feed(letter);
    process.wait().only_json()
}
