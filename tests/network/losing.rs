//! A daemon that is killed, and comes back.

use std::time::{Duration, Instant};

use crate::support::daemon::Place;
use crate::support::process::Process;

/// How long the agents of a daemon that was killed may stay in the directories of others.
const FORGOTTEN: Duration = Duration::from_secs(5);

#[test]
fn agents_of_a_killed_daemon_are_removed_once_and_added_once_when_it_is_back() {
    let place = Place::new();
    let (one, two) = (place.start("robot1"), place.start("robot2"));
    let mut watch = Process::start(one.fipa(&["agents", "--watch", "--json"]));
    let names = ["echo1@robot2", "echo2@robot2"];
    let _echoes = names.map(|name| two.attach("echo", name));
    let mut history = History::default();
    history.read_until(&mut watch, "added", &names);

    two.kill();
    let killed = Instant::now();
    history.read_until(&mut watch, "removed", &names);
    assert!(killed.elapsed() < FORGOTTEN);
    let _two = place.start("robot2");
    history.read_until(&mut watch, "added", &names);

    // Whatever came unasked came before this.
    let _last = one.attach("listen", "last@robot1");
    history.read_until(&mut watch, "added", &["last@robot1"]);
    for name in names {
        assert_eq!(history.of(name), ["added", "removed", "added"]);
        assert!(!history.flaps(name), "{history:?}");
    }
    for name in names {
        let ended = one.run(&["ping", name]);
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
}

#[test]
fn twenty_agents_of_a_killed_daemon_are_gone_everywhere_in_time() {
    let place = Place::new();
    let (one, two) = (place.start("robot1"), place.start("robot2"));
    let three = place.start("robot3");
    let program = fipa::blocking::Platform::attach_to(&two.control).unwrap();
    let names: Vec<String> = (0..20).map(|n| format!("agent{n}@robot2")).collect();
    let agents = names
        .iter()
        .map(|name| program.agent(name.as_str()).unwrap());
    let _agents: Vec<_> = agents.collect();
    let _kept = three.attach("listen", "kept@robot3");
    let watching = [&one, &three].map(|daemon| {
        names.iter().for_each(|name| daemon.wait_for(name));
        daemon.wait_for("kept@robot3");
        fipa::blocking::Platform::attach_to(&daemon.control).unwrap()
    });
    two.kill();
    let killed = Instant::now();
    for platform in &watching {
        while !platform.search(".*@robot2").unwrap().is_empty() {
            assert!(killed.elapsed() < FORGOTTEN);
            std::thread::sleep(Duration::from_millis(20));
        }
        assert_eq!(platform.search(".*").unwrap().len(), 1);
        assert_eq!(platform.search_gone(".*@robot2").unwrap().len(), 20);
    }
}

/// The events that were read: what happened, to whom, and the state that it had then.
#[derive(Debug, Default)]
pub(crate) struct History(Vec<(String, String, String)>);

impl History {
    /// Reads until each of these agents had such an event.
    pub(crate) fn read_until(&mut self, watch: &mut Process, event: &str, names: &[&str]) {
        let mut missing = names.to_vec();
        while !missing.is_empty() {
            let line = watch.json();
            let agent = &line["agent"];
            let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
            let (happened, name) = (text(&line["event"]), text(&agent["name"]));
            if happened == event {
                missing.retain(|missing| *missing != name);
            }
            self.0.push((happened, name, text(&agent["state"])));
        }
    }

    /// When an agent came and went.
    pub(crate) fn of(&self, name: &str) -> Vec<&str> {
        self.0
            .iter()
            .filter(|(event, whose, _)| whose == name && event != "changed")
            .map(|(event, _, _)| event.as_str())
            .collect()
    }

    /// Whether an agent became alive again that was suspect, without having been removed.
    pub(crate) fn flaps(&self, name: &str) -> bool {
        let of_agent = self.0.iter().filter(|(_, whose, _)| whose == name);
        let mut suspect = false;
        for (event, _, state) in of_agent {
            if event == "changed" && suspect && state == "alive" {
                return true;
            }
            suspect = event == "changed" && state == "suspect";
        }
        false
    }
}
