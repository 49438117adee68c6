//! `fipa ping`: how long it takes to be answered.

use serde_json::Value;

use crate::support::daemon::Place;
use crate::support::process::{Process, keys};

#[test]
fn the_times_of_all_answers_are_summed_up() {
    let place = Place::new();
    let (one, _two, _echo) = place.pair();
    let words = "ping echo@robot2 --count 100 --window 8 --size 3000 --json";
    let words: Vec<&str> = words.split(' ').collect();
    let ended = one.run(&words);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let result = ended.only_json();
    assert_eq!(keys(&result), ["sent", "received", "rtt_us", "per_second"]);
    assert_eq!(result["sent"], 100);
    assert_eq!(result["received"], 100);
    let times = &result["rtt_us"];
    assert_eq!(keys(times), ["min", "p50", "mean", "stddev", "p99", "max"]);
    let time = |key: &str| times[key].as_f64().unwrap();
    let ordered = ["min", "p50", "p99", "max"].map(time);
    assert!(ordered.is_sorted(), "{times}");
    assert!(time("min") > 0.0 && result["per_second"].as_f64().unwrap() > 0.0);
}

#[test]
fn an_agent_that_does_not_appear_ends_it_with_1() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let ended = daemon.run(&["ping", "nobody@robot1", "--timeout", "1", "--json"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let result = ended.only_json();
    assert_eq!(result["received"], 0);
    assert_eq!(result["rtt_us"], Value::Null);
    assert!(ended.only_error().contains("nobody@robot1"), "{ended:?}");
}

#[test]
fn an_agent_that_does_not_answer_ends_it_with_1() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _listener = daemon.attach("listen", "silent@robot1");
    let words = "ping silent@robot1 --count 2 --window 2 --timeout 0.3 --json";
    let words: Vec<&str> = words.split(' ').collect();
    let ended = daemon.run(&words);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let result = ended.only_json();
    assert_eq!(result["sent"], 2);
    assert_eq!(result["received"], 0);
    assert_eq!(result["rtt_us"], Value::Null);
}

#[test]
fn an_agent_that_appears_in_time_is_waited_for() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let mut watch = Process::start(daemon.fipa(&["agents", "--watch", "--json"]));
    let ping = Process::start(daemon.fipa(&["ping", "late@robot1", "--timeout", "10"]));
    // Its own agent is there: it waits.
    assert_eq!(watch.json()["event"], "added");
    let _echo = daemon.attach("echo", "late@robot1");
    assert_eq!(ping.wait().code, Some(0));
}
