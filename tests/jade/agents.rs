//! Agents of both sides talk to each other, find each other, and are told what went wrong.

use serde_json::json;

use fipa::{AgentId, Message, Performative};

use crate::fake::Jade;
use crate::support::daemon::{Daemon, Place};

pub(crate) const HTTP: [&str; 3] = ["--no-mdns", "--http", "127.0.0.1:0"];

pub(crate) fn http_of(daemon: &Daemon) -> String {
    daemon.ready["http"].as_str().unwrap().to_owned()
}

#[test]
fn an_agent_of_jade_asks_ours_and_is_answered_where_it_says() {
    let (place, jade) = (Place::new(), Jade::silent("platA"));
    let daemon = place.start_with("robot1", &HTTP);
    let _echo = daemon.attach("echo", "echo@robot1");
    let url = http_of(&daemon);
    for content in ["hello", "grüße \"quoted\" \\.", "(a\n(b))"] {
        let request = Message::new(Performative::Request)
            .from_agent(jade.agent("ping"))
            .to(AgentId::new("ECHO@Robot1").address(url.as_str()))
            .reply_with("r-1")
            .conversation_id("c-1")
            .content(content);
        jade.send(&request, &url);
        let answer = jade.letter().message;
        assert_eq!(answer.performative, Performative::Inform);
        assert_eq!(answer.content_str(), Some(content));
        assert_eq!(answer.in_reply_to, Some("r-1".into()));
        assert_eq!(answer.sender.unwrap().addresses, [url.as_str()]);
    }
}

#[test]
fn our_agents_ask_one_of_jade_by_its_address() {
    let (place, jade) = (Place::new(), Jade::start("platA"));
    let daemon = place.start_with("robot1", &HTTP);
    let to = json!({"name": "echo@platA", "addresses": [jade.url()]});
    let mut arm = daemon.attach("attach", "arm@robot1");
    for number in 0..20 {
        let content = format!("order {number}");
        arm.tell(json!({"performative": "request", "receiver": [to.clone()], "content": content}));
        let (mut sent, mut answered) = (false, false);
        while !(sent && answered) {
            let line = arm.json();
            sent |= line["outcome"] == "sent";
            answered |= line["message"]["content"] == content.as_str();
        }
    }
}

#[test]
fn a_closed_connection_costs_no_letter_and_no_answer_is_told() {
    let (place, jade) = (Place::new(), Jade::silent("platA"));
    let daemon = place.start_with("robot1", &HTTP);
    let mut arm = daemon.attach("attach", "arm@robot1");
    let mut send = |content: &str| {
        let to = json!({"name": "echo@platA", "addresses": [jade.url()]});
        arm.tell(json!({"performative": "inform", "receiver": [to], "content": content}));
        arm.json()
    };
    assert_eq!(send("first")["outcome"], "sent");
    assert_eq!(jade.letter().message.content_str(), Some("first"));
    jade.close_without_answer(1);
    assert_eq!(send("second")["outcome"], "sent");
    assert_eq!(jade.letter().message.content_str(), Some("second"));
    jade.close_without_answer(2);
    let outcome = send("third");
    assert_eq!(outcome["outcome"], "timeout");
    let reason = outcome["reason"].as_str().unwrap();
    assert!(reason.contains("without an answer"), "{reason}");
    jade.nothing_comes();
}
