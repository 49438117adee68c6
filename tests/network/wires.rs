//! Two hosts at the ends of a wire.

use serde_json::Value;

use crate::support::daemon::{Daemon, Place};
use crate::support::namespace::Namespace;
use crate::support::process::Process;

#[test]
fn daemons_at_the_ends_of_a_wire_find_each_other_by_mdns_and_answer_2000_of_2000() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    let place = Place::new();
    let one = place.start_in(&host1, "robot1", &["--listen", "10.0.0.1:0"]);
    let two = place.start_in(&host2, "robot2", &["--listen", "10.0.0.2:0"]);
    let _echo = two.attach("echo", "echo@robot2");
    one.wait_for("echo@robot2");
    assert_eq!(source(&one, "echo@robot2"), "mdns");
    ping(&one, "echo@robot2");
}

#[test]
fn daemons_that_listen_over_quic_alone_find_each_other_by_mdns() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    let place = Place::new();
    let start = |host, name, at| place.start_in(host, name, &["--listen", at]);
    let one = start(&host1, "robot1", "quic://10.0.0.1:0");
    let two = start(&host2, "robot2", "quic://10.0.0.2:0");
    let _echo = two.attach("echo", "echo@robot2");
    one.wait_for("echo@robot2");
    let agent = one.run(&["agents", "echo@robot2", "--json"]).only_json();
    assert_eq!(agent["source"], "mdns");
    let at = agent["locations"][0]["address"].as_str().unwrap();
    assert!(at.starts_with("quic://10.0.0.2:"), "{at}");
    ping(&one, "echo@robot2");
}

#[test]
fn a_daemon_that_starts_before_its_wire_is_plugged_in_finds_others_later() {
    let Some((host1, host2)) = Namespace::unplugged_pair() else {
        return;
    };
    let place = Place::new();
    let one = place.start_in(&host1, "robot1", &["--listen", "10.0.0.1:0"]);
    let two = place.start_in(&host2, "robot2", &["--listen", "10.0.0.2:0"]);
    let _echo = two.attach("echo", "echo@robot2");
    host2.plug_in();
    one.wait_for("echo@robot2");
    assert_eq!(source(&one, "echo@robot2"), "mdns");
}

#[test]
fn without_mdns_one_address_on_one_side_is_enough_for_both() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    let place = Place::new();
    let one = place.start_in(&host1, "robot1", &["--no-mdns", "--listen", "10.0.0.1:0"]);
    let options = ["--no-mdns", "--listen", "10.0.0.2:0"];
    let peer = ["--peer", one.endpoint()];
    let two = place.start_in(&host2, "robot2", &[&options[..], &peer].concat());
    let _echo1 = one.attach("echo", "echo@robot1");
    let _echo2 = two.attach("echo", "echo@robot2");
    one.wait_for("echo@robot2");
    assert_eq!(source(&one, "echo@robot2"), "peer");
    ping(&one, "echo@robot2");
    ping(&two, "echo@robot1");
}

#[test]
fn a_robot_that_gets_another_address_tells_it_for_all_its_agents_in_one_step() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    let place = Place::new();
    let one = place.start_in(&host1, "robot1", &["--no-mdns", "--listen", "0.0.0.0:0"]);
    let endpoint = one.endpoint();
    assert!(endpoint.starts_with("tcp://10.0.0.1:"), "{endpoint}");
    let options = ["--no-mdns", "--listen", "10.0.0.2:0", "--peer", endpoint];
    let two = place.start_in(&host2, "robot2", &options);
    let _agents = ["arm@robot1", "drive@robot1"].map(|name| one.attach("listen", name));
    let mut watch = Process::start(two.fipa(&["agents", "--watch", "--json"]));
    for _ in 0..2 {
        assert_eq!(watch.json()["event"], "added");
    }
    let moved = endpoint.replace("10.0.0.1", "10.0.0.7");
    host1.add_address("10.0.0.7");
    for _ in 0..2 {
        let event = watch.json();
        assert_eq!(event["event"], "changed");
        let locations = event["agent"]["locations"].as_array().unwrap();
        let addresses: Vec<&Value> = locations.iter().map(|l| &l["address"]).collect();
        assert_eq!(addresses, [endpoint, &moved], "loopback is not told");
    }
}

fn source(daemon: &Daemon, agent: &str) -> Value {
    daemon.run(&["agents", agent, "--json"]).only_json()["source"].clone()
}

fn ping(daemon: &Daemon, agent: &str) {
    let words = ["ping", agent, "--count", "2000", "--window", "32", "--json"];
    let ended = daemon.run(&words);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let result = ended.only_json();
    assert_eq!(result["sent"], 2000);
    assert_eq!(result["received"], 2000);
}
