//! `fipa agents`: who is known.

use crate::support::daemon::Place;
use crate::support::process::{Process, keys};

const KEYS: [&str; 8] = [
    "name",
    "type",
    "locations",
    "description",
    "timestamp",
    "age_s",
    "source",
    "state",
];

#[test]
fn every_agent_is_a_line_with_the_keys_of_the_contract() {
    let place = Place::new();
    let (one, two, _echo) = place.pair();
    let _local = one.attach_with(&["listen", "--as", "arm@robot1", "--description", "An arm"]);
    let ended = one.run(&["agents", "--json"]);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let [arm, echo] = &ended.json()[..] else {
        panic!("{ended:?}");
    };
    for (agent, name, daemon, source) in [
        (arm, "arm@robot1", &one, "local"),
        (echo, "echo@robot2", &two, "mdns"),
    ] {
        assert_eq!(keys(agent), KEYS);
        assert_eq!(agent["name"], name);
        assert_eq!(agent["source"], source);
        assert_eq!(agent["state"], "alive");
        let locations = agent["locations"].as_array().unwrap();
        assert_eq!(locations.len(), 1);
        assert_eq!(keys(&locations[0]), ["address", "signature"]);
        assert_eq!(locations[0]["address"], daemon.endpoint());
        assert!(agent["age_s"].as_f64().is_some());
    }
    assert_eq!(arm["description"], "An arm");
}

#[test]
fn the_pattern_must_match_all_of_the_field() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _arm = daemon.attach_with(&["listen", "--as", "arm@robot1", "--description", "An arm"]);
    let _drive = daemon.attach_with(&["listen", "--as", "drive@robot1", "--description", "Tracks"]);
    for (words, found) in [
        (&["agents"][..], &["arm@robot1", "drive@robot1"][..]),
        (&["agents", "arm@.*"], &["arm@robot1"]),
        (&["agents", "rm@robot"], &[]),
        (
            &["agents", "--field", "description", "An.*"],
            &["arm@robot1"],
        ),
        (
            &["agents", "--field", "location", "tcp://.*"],
            &["arm@robot1", "drive@robot1"],
        ),
        (&["agents", "--field", "type", "printer"], &[]),
    ] {
        let ended = daemon.run(&[words, &["--json"]].concat());
        let lines = ended.json();
        let names: Vec<&str> = lines.iter().map(|l| l["name"].as_str().unwrap()).collect();
        assert_eq!(names, found, "{words:?}");
        let code = if found.is_empty() { 1 } else { 0 };
        assert_eq!(ended.code, Some(code), "{words:?}");
        assert_eq!(ended.errors.len(), code as usize);
    }
    let ended = daemon.run(&["agents", "[a"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    ended.only_error();
}

#[test]
fn agents_that_are_gone_are_listed_on_request() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _arm = daemon.attach("listen", "arm@robot1");
    let drive = daemon.attach("listen", "drive@robot1");
    let mut watch = Process::start(daemon.fipa(&["agents", "drive.*", "--watch", "--json"]));
    assert_eq!(watch.json()["event"], "added");
    drive.kill();
    let removed = watch.json();
    assert_eq!(removed["event"], "removed");
    assert_eq!(removed["agent"]["state"], "gone");

    let states = |words: &[&str]| -> Vec<(String, String)> {
        let ended = daemon.run(&[words, &["--json"]].concat());
        assert_eq!(ended.code, Some(0), "{words:?}: {ended:?}");
        let agents = ended.json();
        let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
        let agents = agents.iter().inspect(|agent| assert_eq!(keys(agent), KEYS));
        agents
            .map(|agent| (text(&agent["name"]), text(&agent["state"])))
            .collect()
    };
    let arm = || ("arm@robot1".to_owned(), "alive".to_owned());
    let gone = ("drive@robot1".to_owned(), "gone".to_owned());
    assert_eq!(states(&["agents"]), [arm()]);
    assert_eq!(states(&["agents", "--gone"]), [arm(), gone.clone()]);
    assert_eq!(states(&["agents", "drive.*", "--gone"]), [gone]);
    assert_eq!(daemon.run(&["agents", "drive.*"]).code, Some(1));
    let table = daemon.run(&["agents", "--gone"]).output;
    assert!(table[2].contains("drive@robot1") && table[2].contains("gone"));
    let mut watch = Process::start(daemon.fipa(&["agents", "--watch", "--gone", "--json"]));
    let begins = [watch.json(), watch.json()];
    assert_eq!(begins[0]["event"], "added");
    assert_eq!(begins[1]["event"], "removed");

    let _drive = daemon.attach("listen", "drive@robot1");
    assert_eq!(states(&["agents", "--gone"])[1].1, "alive");
}

#[test]
fn people_see_a_table() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _arm = daemon.attach_with(&["listen", "--as", "arm@robot1", "--description", "An arm"]);
    let ended = daemon.run(&["agents"]);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let [head, line] = &ended.output[..] else {
        panic!("{ended:?}");
    };
    assert!(head.starts_with("NAME"), "{head}");
    for shown in ["arm@robot1", "alive", "local", daemon.endpoint(), "An arm"] {
        assert!(line.contains(shown), "{line}");
    }
    // What stands below a heading belongs to it.
    for (heading, value) in [
        ("STATE", "alive"),
        ("SOURCE", "local"),
        ("LOCATIONS", "tcp:"),
    ] {
        assert_eq!(head.find(heading), line.find(value), "{head}\n{line}");
    }
}

#[test]
fn a_watch_begins_with_what_is_there_and_ends_with_0_when_interrupted() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _arm = daemon.attach("listen", "arm@robot1");
    let mut watch = Process::start(daemon.fipa(&["agents", ".*@robot1", "--watch", "--json"]));
    let drive = |watch: &mut Process| {
        let event = watch.json();
        assert_eq!(keys(&event), ["event", "agent"]);
        assert_eq!(keys(&event["agent"]), KEYS);
        let name = event["agent"]["name"].as_str().unwrap().to_owned();
        (event["event"].as_str().unwrap().to_owned(), name)
    };
    let expected = |event: &str, name: &str| (event.to_owned(), name.to_owned());
    assert_eq!(drive(&mut watch), expected("added", "arm@robot1"));
    let other = daemon.attach("listen", "drive@robot1");
    assert_eq!(drive(&mut watch), expected("added", "drive@robot1"));
    other.kill();
    assert_eq!(drive(&mut watch), expected("removed", "drive@robot1"));
    watch.signal(rustix::process::Signal::INT);
    assert_eq!(watch.wait().code, Some(0));
}
