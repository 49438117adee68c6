//! Daemons that no multicast reaches: one address joins them all.

use std::time::{Duration, Instant};

use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};
use crate::support::namespace::Namespace;
use crate::support::process::Process;

#[test]
fn one_peer_is_enough_to_join_five_daemons_and_may_go_afterwards() {
    let place = Place::new();
    let first = place.start_with("robot0", &["--no-mdns"]);
    let others = ["robot1", "robot2", "robot3", "robot4"].map(|name| {
        let options = ["--no-mdns", "--peer", first.endpoint()];
        place.start_with(name, &options)
    });
    let echo = |daemon: &Daemon| daemon.attach("echo", &format!("echo@{}", daemon.name()));
    let _echo = echo(&first);
    let _echoes: Vec<Process> = others.iter().map(echo).collect();
    let daemons: Vec<&Daemon> = std::iter::once(&first).chain(&others).collect();
    for daemon in &daemons {
        for other in &daemons {
            daemon.wait_for(&format!("echo@{}", other.name()));
        }
    }
    first.kill();
    let known = fipa::blocking::Platform::attach_to(&others[0].control).unwrap();
    let killed = Instant::now();
    while known.search("echo@robot0").unwrap().len() == 1 {
        assert!(killed.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(20));
    }
    for daemon in &others {
        for other in &others {
            let ended = daemon.run(&["ping", &format!("echo@{}", other.name())]);
            assert_eq!(ended.code, Some(0), "{ended:?}");
        }
    }
}

#[test]
fn where_the_network_eats_multicast_one_peer_joins_five_daemons() {
    let Some(hosts) = Namespace::bridged(5) else {
        return;
    };
    if !hosts[5].block("forward", "udp dport 5353") {
        return;
    }
    let place = Place::at_the_usual_port();
    let mut daemons: Vec<Daemon> = Vec::new();
    for (host, number) in hosts.iter().zip(1..=5) {
        let peer = daemons.first().map(|first| first.endpoint().to_owned());
        let peer = peer.iter().flat_map(|peer| ["--peer", peer.as_str()]);
        let options: Vec<&str> = ["--listen", "0.0.0.0:0"].into_iter().chain(peer).collect();
        daemons.push(place.start_in(host, &format!("robot{number}"), &options));
    }
    let echo = |daemon: &Daemon| daemon.attach("echo", &format!("echo@{}", daemon.name()));
    let _echoes: Vec<Process> = daemons.iter().map(echo).collect();
    for daemon in &daemons {
        for other in &daemons {
            let name = format!("echo@{}", other.name());
            daemon.wait_for(&name);
            let ended = daemon.run(&["ping", &name, "--json"]);
            assert_eq!(ended.code, Some(0), "{ended:?}");
            let agent = daemon.run(&["agents", &name, "--json"]).only_json();
            let source = if daemon.name() == other.name() {
                "local"
            } else {
                "peer"
            };
            assert_eq!(agent["source"], source, "{agent}");
        }
    }
}

#[test]
fn a_late_joiner_knows_a_thousand_agents_within_2_s_and_ten_thousand_within_10_s() {
    for (count, within) in [(1_000, 2), (10_000, 10)] {
        let place = Place::new();
        let one = place.start("robot1");
        let platform = fipa::blocking::Platform::attach_to(&one.control).unwrap();
        let agents = (0..count).map(|n| platform.agent(format!("agent{n}@robot1")).unwrap());
        let agents: Vec<fipa::blocking::Agent> = agents.collect();
        let begun = Instant::now();
        let two = place.start("robot2");
        let late = fipa::blocking::Platform::attach_to(&two.control).unwrap();
        let last = format!("agent{}@robot1", count - 1);
        let found = late.wait_for(&last, Duration::from_secs(within));
        println!("{count} agents: {:?} after the start", begun.elapsed());
        assert!(found.is_some(), "{count} agents");
        assert_eq!(late.search("agent.*").unwrap().len(), agents.len());
    }
}

#[test]
fn a_peer_that_is_given_and_not_there_does_not_switch_mdns_off() {
    let place = Place::new();
    let nobody = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", nobody.local_addr().unwrap());
    drop(nobody);
    let one = place.start_with("robot1", &["--peer", &address]);
    let two = place.start("robot2");
    let _echo = two.attach("echo", "echo@robot2");
    one.wait_for("echo@robot2");
}

#[test]
fn daemons_of_different_scopes_stay_apart_though_they_are_given_each_other() {
    let place = Place::new();
    let red = place.start_with("red", &["--scope", "red"]);
    let options = ["--scope", "blue", "--peer", red.endpoint()];
    let blue = place.start_with("blue", &options);
    let second = place.start_with("blue2", &["--scope", "blue"]);
    let _echo = red.attach("echo", "echo@red");
    let _echo2 = second.attach("echo", "echo@blue2");
    blue.wait_for("echo@blue2");
    for daemon in [&blue, &second] {
        let ended = daemon.run(&["agents", "echo@red"]);
        assert_eq!(ended.code, Some(1), "{ended:?}");
    }
    let ended = blue.run(&["send", "--to", "echo@red", "--performative", "inform"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
}

#[test]
fn an_agent_name_that_two_daemons_hold_is_told_of_by_both_and_by_whoever_watches() {
    let place = Place::new();
    let (mut one, mut two, _echo) = place.pair();
    let mut watch = Process::start(one.fipa(&["agents", "arm", "--watch", "--json"]));
    let _arms = [one.attach("listen", "arm"), two.attach("listen", "arm")];
    for daemon in [&mut one, &mut two] {
        let event = daemon.event();
        assert_eq!(event["event"], "conflict", "{event}");
        assert_eq!(event["agent"]["name"], "arm");
    }
    let events: Vec<String> = (0..3)
        .map(|_| watch.json()["event"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(events, ["added", "added", "conflict"]);
    // Nobody was renamed.
    for daemon in [&one, &two] {
        let ended = daemon.run(&["agents", "--json", "arm.*"]);
        let names: Vec<_> = ended.json().iter().map(|a| a["name"].clone()).collect();
        assert_eq!(names, ["arm"]);
    }
}
