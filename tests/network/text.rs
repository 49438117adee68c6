//! Text agents behind one daemon, and the fleet behind another.

use std::net::UdpSocket;

use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};
use crate::support::process::Process;

/// A small robot's agent on a socket of its own.
struct TextAgent {
    socket: UdpSocket,
    platform: String,
}

impl TextAgent {
    fn new(daemon: &Daemon) -> TextAgent {
        let bound = daemon.ready["text"][0].as_str().unwrap();
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        TextAgent {
            socket,
            platform: bound.strip_prefix("udp://").unwrap().to_owned(),
        }
    }

    fn say(&self, text: &str) {
        self.socket
            .send_to(text.as_bytes(), &self.platform)
            .unwrap();
    }

    fn hear(&self) -> String {
        let mut octets = [0; 2048];
        let count = self.socket.recv(&mut octets).unwrap();
        String::from_utf8_lossy(&octets[..count]).into_owned()
    }
}

#[test]
fn a_text_agent_is_found_asked_and_told_by_the_fleet() {
    let place = Place::new();
    let one = place.start_with("robot1", &["--text", "udp://127.0.0.1:0"]);
    let two = place.start("robot2");
    let drive = TextAgent::new(&one);
    drive.say("{O:drive;S:up}");
    two.wait_for("drive@robot1");

    let mut query = Process::start(two.fipa(&[
        "send",
        "--to",
        "drive@robot1",
        "--from",
        "m@robot2",
        "--performative",
        "query-ref",
        "--content",
        "where",
        "--conversation-id",
        "c-1",
        "--wait",
        "10",
        "--json",
    ]));
    assert_eq!(drive.hear(), "{O:m@robot2;D:drive;X=1;Q:where}");
    drive.say("{O:drive;D:m@robot2;X=1;R:3 4}");
    assert_eq!(query.json()["outcome"], "delivered");
    let answer = query.json();
    let answer = &answer["message"];
    assert_eq!(answer["performative"], "inform");
    assert_eq!(answer["content"], "3 4");
    assert_eq!(answer["sender"]["name"], "drive@robot1");
    assert_eq!(answer["conversation-id"], "c-1");
    assert_eq!(query.wait().code, Some(0));

    let mut request = Process::start(two.fipa(&[
        "send",
        "--to",
        "drive@robot1",
        "--from",
        "m@robot2",
        "--performative",
        "request",
        "--content",
        "stop",
        "--wait",
        "10",
        "--json",
    ]));
    assert_eq!(drive.hear(), "{O:m@robot2;D:drive;A:stop}");
    assert_eq!(request.json()["outcome"], "delivered");
    assert_eq!(request.json()["message"]["performative"], "agree");
    let done = request.json();
    let done = &done["message"];
    assert_eq!(done["performative"], "inform");
    assert_eq!(done["content"], "sent");
    assert_eq!(request.wait().code, Some(0));
}

#[test]
fn a_text_agent_asks_the_fleet() {
    let place = Place::new();
    let one = place.start_with("robot1", &["--text", "udp://127.0.0.1:0"]);
    let two = place.start("robot2");
    let _echo = two.attach("echo", "echo@robot2");
    one.wait_for("echo@robot2");
    let drive = TextAgent::new(&one);
    drive.say("{O:drive;D:echo@robot2;X=9;Q:are you there}");
    assert_eq!(drive.hear(), "{O:echo@robot2;D:drive;X=9;R:are you there}");
    drive.say("{O:drive;D:nobody@robot2;X=1;Q:x}");
    assert_eq!(
        drive.hear(),
        "{O:PLATFORM;D:drive;X=1;R:ERROR unknown name}"
    );
}
