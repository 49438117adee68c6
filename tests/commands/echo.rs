//! `fipa echo`: an agent that answers.

use serde_json::json;

use crate::support::daemon::Place;

#[test]
fn requests_and_queries_are_answered_with_what_belongs_to_them() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _echo = daemon.attach("echo", "echo@robot1");
    let mut agent = daemon.attach("attach", "arm@robot1");
    for performative in ["request", "query-ref"] {
        agent.tell(json!({
            "performative": performative,
            "receiver": [{"name": "echo@robot1"}],
            "content": {"base64": "AAEC/w=="},
            "conversation-id": "c1",
            "protocol": "fipa-request",
            "ontology": "o1",
            "language": "l1",
            "encoding": "e1",
            "reply-with": "r1",
        }));
        let mut lines = [agent.json(), agent.json()];
        lines.sort_by_key(|line| line.get("message").is_some());
        assert_eq!(
            lines[1]["message"],
            json!({
                "performative": "inform",
                "sender": {"name": "echo@robot1"},
                "receiver": [{"name": "arm@robot1"}],
                "content": {"base64": "AAEC/w=="},
                "language": "l1",
                "encoding": "e1",
                "ontology": "o1",
                "protocol": "fipa-request",
                "conversation-id": "c1",
                "in-reply-to": "r1",
            })
        );
    }
}

#[test]
fn the_answer_goes_to_whom_the_sender_names() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _echo = daemon.attach("echo", "echo@robot1");
    let mut other = daemon.attach_with(&["listen", "--as", "other@robot1", "--json"]);
    let mut agent = daemon.attach("attach", "arm@robot1");
    agent.tell(json!({
        "performative": "request",
        "receiver": [{"name": "echo@robot1"}],
        "reply-to": [{"name": "other@robot1"}],
        "content": "dock",
    }));
    assert_eq!(agent.json()["outcome"], "delivered");
    assert_eq!(other.json()["message"]["content"], "dock");
}

#[test]
fn nothing_else_is_answered() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _echo = daemon.attach("echo", "echo@robot1");
    let mut agent = daemon.attach("attach", "arm@robot1");
    let mut outcomes = 0;
    let mut answers = Vec::new();
    // Whatever the first ones are answered comes before the answer to the last one.
    for performative in ["inform", "agree", "refuse", "cfp", "request"] {
        agent.tell(json!({
            "performative": performative,
            "receiver": [{"name": "echo@robot1"}],
            "content": performative,
        }));
    }
    while outcomes < 5 || answers.is_empty() {
        let line = agent.json();
        match line.get("message") {
            Some(message) => answers.push(message["content"].clone()),
            None => outcomes += 1,
        }
    }
    assert_eq!(answers, ["request"]);
}
