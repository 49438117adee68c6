//! `fipa attach`: an agent for programs in any language.

use std::time::Duration;

use serde_json::json;

use crate::support::daemon::Place;
use crate::support::process::{Process, keys};

#[test]
fn messages_go_in_and_messages_and_outcomes_come_out() {
    let place = Place::new();
    let (one, _two, _echo) = place.pair();
    let mut agent = one.attach("attach", "arm@robot1");
    agent.tell(json!({
        "performative": "request",
        "receiver": [{"name": "echo@robot2"}],
        "content": "dock",
        "reply-with": "r1",
        "tag": "first",
    }));
    // What became of it and the answer come in any order.
    let mut lines = [agent.json(), agent.json()];
    lines.sort_by_key(|line| line.get("message").is_some());
    let [outcome, reply] = &lines;
    assert_eq!(keys(outcome), ["to", "outcome", "via", "reason", "tag"]);
    assert_eq!(outcome["to"], "echo@robot2");
    assert_eq!(outcome["outcome"], "delivered");
    assert_eq!(outcome["tag"], "first");
    assert_eq!(keys(reply), ["message"]);
    assert_eq!(reply["message"]["performative"], "inform");
    assert_eq!(reply["message"]["in-reply-to"], "r1");
    assert_eq!(reply["message"]["content"], "dock");

    agent.tell(json!({
        "performative": "inform",
        "receiver": [{"name": "nobody@robot2"}],
        "tag": {"number": 2},
    }));
    let outcome = agent.json();
    assert_eq!(outcome["outcome"], "unknown");
    assert_eq!(outcome["tag"], json!({"number": 2}));

    let receiver = json!([{"name": "echo@robot2"}]);
    agent.tell(json!({"performative": "inform", "receiver": receiver}));
    let outcome = agent.json();
    assert_eq!(keys(&outcome), ["to", "outcome", "via", "reason"]);

    agent.close_input();
    assert_eq!(agent.wait().code, Some(0));
}

#[test]
fn a_malformed_line_is_reported_and_passed_over_and_ends_it_with_2() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let mut agent = daemon.attach("attach", "arm@robot1");
    let lines = [&b"nonsense\n"[..], b"{\"performative\":1}\n", b"\"\xFF\"\n"];
    for (number, line) in (1..).zip(lines) {
        agent.write(line);
        let report = agent.json();
        assert_eq!(report["event"], "malformed");
        assert_eq!(report["line"], number);
        assert!(report["reason"].is_string());
    }
    let receiver = json!([{"name": "nobody"}]);
    agent.tell(json!({"performative": "inform", "receiver": receiver}));
    assert_eq!(agent.json()["outcome"], "unknown");
    agent.close_input();
    let ended = agent.wait();
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.only_error().contains("line 1"), "{ended:?}");
}

#[test]
fn the_last_outcome_is_told_before_it_ends() {
    let place = Place::new();
    let (one, _two, _echo) = place.pair();
    let mut agent = one.attach("attach", "arm@robot1");
    let receiver = json!([{"name": "echo@robot2"}]);
    agent.tell(json!({"performative": "inform", "receiver": receiver, "tag": 1}));
    agent.close_input();
    let ended = agent.wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let outcome = ended.only_json();
    assert_eq!(outcome["outcome"], "delivered");
    assert_eq!(outcome["tag"], 1);
}

#[test]
fn the_daemons_coming_and_going_are_events() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let mut agent = daemon.attach("attach", "arm@robot1");
    daemon.kill();
    assert_eq!(agent.json()["event"], "lost");
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    assert_eq!(agent.json()["event"], "attached");
    daemon.wait_for("arm@robot1");
}

#[test]
fn a_daemon_that_stays_away_for_30_s_ends_whoever_waits_for_it_with_3() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let mut waiting = vec![Process::start(
        daemon.fipa(&["agents", "--watch", "--json"]),
    )];
    for command in ["listen", "echo", "attach"] {
        waiting.push(daemon.attach(command, &format!("{command}@robot1")));
        assert_eq!(waiting[0].json()["event"], "added");
    }
    daemon.kill();
    for process in waiting {
        let ended = process.wait_within(Duration::from_secs(45));
        assert_eq!(ended.code, Some(3), "{ended:?}");
        ended.only_error();
    }
}
