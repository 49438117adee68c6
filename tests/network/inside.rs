//! Inside of robots: an operator at one daemon, a text agent on a serial line behind another, and a
//! HIAC sensor behind a third. Each is killed in the middle, and comes back.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use fipa::blocking::{Agent, Platform};
use fipa::{Message, Outcome, Performative};
use rustix::process::Signal;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place, tool};
use crate::support::process::Process;

/// A microcontroller on a serial line, which is killed by dropping it. Like an adapter that is
/// pulled out and put in again it has another terminal each time, and one name for all of them.
struct Board {
    line: File,
    link: PathBuf,
    read: String,
}

impl Board {
    fn plug_in(link: &Path) -> Board {
        let line = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&line).unwrap();
        unlockpt(&line).unwrap();
        rustix::io::ioctl_fionbio(&line, true).unwrap();
        // There is nothing between the two ends that sends characters back.
        let mut plain = tcgetattr(&line).unwrap();
        plain.make_raw();
        tcsetattr(&line, OptionalActions::Now, &plain).unwrap();
        let name = ptsname(&line, Vec::new()).unwrap();
        symlink(name.to_str().unwrap(), link).unwrap();
        Board {
            line: line.into(),
            link: link.to_owned(),
            read: String::new(),
        }
    }

    fn say(&mut self, text: &str) {
        self.line.write_all(text.as_bytes()).unwrap();
    }

    /// The next message that comes.
    fn hear(&mut self) -> String {
        let until = Instant::now() + PATIENCE;
        loop {
            if let Some(end) = self.read.find('}') {
                let rest = self.read.split_off(end + 1);
                return std::mem::replace(&mut self.read, rest);
            }
            assert!(Instant::now() < until, "no message after {:?}", self.read);
            let mut octets = [0; 256];
            match self.line.read(&mut octets) {
                Ok(count) => self.read += str::from_utf8(&octets[..count]).unwrap(),
                Err(error) => {
                    assert_eq!(error.kind(), ErrorKind::WouldBlock, "{error}");
                    std::thread::sleep(Duration::from_millis(10));
                }
            }
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        std::fs::remove_file(&self.link).unwrap();
    }
}

/// The asking agent, and what it hears.
struct Operator {
    platform: Platform,
    agent: Agent,
}

impl Operator {
    fn at(daemon: &Daemon) -> Operator {
        let platform = Platform::attach_to(&daemon.control).unwrap();
        let agent = platform.agent("operator@robot1").unwrap();
        Operator { platform, agent }
    }

    fn try_to_say(&self, performative: Performative, content: &str, to: &str, id: &str) -> Outcome {
        let message = Message::new(performative).to(to);
        let message = message.content(content.as_bytes().to_vec());
        let mut outcomes = self.agent.send(message.conversation_id(id));
        outcomes.remove(0).outcome
    }

    fn say(&self, performative: Performative, content: &str, to: &str, id: &str) {
        let outcome = self.try_to_say(performative, content, to, id);
        assert!(matches!(outcome, Outcome::Delivered), "{id}: {outcome:?}");
    }

    /// What comes next: the performative, the conversation and the content.
    fn hears(&self) -> (Performative, String, String) {
        let came = self.agent.receive_timeout(PATIENCE);
        let message = came.expect("a message").unwrap();
        let content = message.content_str().unwrap_or_default().to_owned();
        let id = message.conversation_id.as_ref();
        let id = id.and_then(|id| id.as_str()).unwrap_or_default().to_owned();
        (message.performative, id, content)
    }

    fn hears_this(&self, performative: Performative, id: &str, content: &str) {
        let wanted = (performative, id.to_owned(), content.to_owned());
        assert_eq!(self.hears(), wanted);
    }

    /// The next messages, whose order is not fixed, are failures of these conversations.
    fn hears_failures_of(&self, conversations: &[&str]) {
        let mut failed: Vec<String> = conversations
            .iter()
            .map(|_| match self.hears() {
                (Performative::Failure, id, _) => id,
                other => panic!("{other:?}"),
            })
            .collect();
        failed.sort();
        assert_eq!(failed, conversations);
    }

    fn sees_go(&self, daemon: &Daemon, name: &str) {
        let until = Instant::now() + PATIENCE;
        while !self.platform.search(name).unwrap().is_empty() {
            assert!(Instant::now() < until, "{name} stays in the directory");
            std::thread::sleep(Duration::from_millis(20));
        }
        let listed = daemon.run(&["agents"]);
        assert_eq!(listed.code, Some(0), "{listed:?}");
        assert!(
            !listed.output.iter().any(|line| line.contains(name)),
            "{listed:?}"
        );
    }
}

#[test]
fn a_text_agent_on_a_serial_line_is_killed_in_the_middle_and_comes_back() {
    let place = Place::new();
    let tty = place.path("tty");
    let home = place.start("robot1");
    let url = format!("serial://{}?baud=115200", tty.display());
    let _away = place.start_with("robot2", &["--text", &url]);
    let operator = Operator::at(&home);
    for round in 0..2 {
        let mut board = Board::plug_in(&tty);
        board.say("{O:drive;S:up}");
        home.wait_for("drive@robot2");
        let say = |performative, content, id| {
            operator.say(performative, content, "drive@robot2", id);
        };
        say(Performative::Subscribe, "", "all");
        operator.hears_this(Performative::Agree, "all", "");
        say(Performative::Request, "forward 10", "go");
        operator.hears_this(Performative::Agree, "go", "");
        assert_eq!(board.hear(), "{O:operator@robot1;D:drive;A:forward 10}");
        operator.hears_this(Performative::Inform, "go", "sent");
        board.say("{O:drive;S:moving}");
        operator.hears_this(Performative::Inform, "all", "moving");
        say(Performative::QueryRef, "where", "where");
        let question = board.hear();
        assert!(
            question.starts_with("{O:operator@robot1;D:drive;X="),
            "{question}"
        );
        assert!(question.ends_with(";Q:where}"), "{question}");
        drop(board);
        operator.hears_failures_of(&["all", "where"]);
        operator.sees_go(&home, "drive@robot2");
        let outcome = operator.try_to_say(Performative::Request, "stop", "drive@robot2", "late");
        assert!(
            !matches!(outcome, Outcome::Delivered),
            "{round}: {outcome:?}"
        );
    }
}

fn sensor(daemon: &Daemon) -> Process {
    let url = daemon.ready["hiac"][0].as_str().unwrap();
    let url = url.strip_suffix("?listen").unwrap();
    let mut sensor = Process::start(tool(&["hiac", "device", url, "--name", "sensor", "--json"]));
    assert_eq!(sensor.json()["event"], "connected");
    sensor
}

#[test]
fn a_hiac_sensor_is_killed_in_the_middle_and_comes_back() {
    let place = Place::new();
    let home = place.start("robot1");
    let options = [
        "--hiac",
        "tcp://127.0.0.1:0?listen",
        "--hiac-address",
        "20:C4:D2:00/00:00:00:FF",
    ];
    let away = place.start_with("robot3", &options);
    let operator = Operator::at(&home);
    let say = |performative, content, id| {
        operator.say(performative, content, "sensor@robot3", id);
    };
    for end in [Signal::KILL, Signal::STOP] {
        let mut sensor = sensor(&away);
        home.wait_for("sensor@robot3");
        say(Performative::QueryRef, "distance", "works");
        operator.hears_this(Performative::Inform, "works", "distance");
        assert_eq!(sensor.json()["event"], "question");
        say(Performative::Subscribe, "", "all");
        operator.hears_this(Performative::Agree, "all", "");
        // It does not answer any more, and then its silence is noticed, or the end of its stream.
        sensor.signal(Signal::STOP);
        say(Performative::QueryRef, "distance", "open");
        say(Performative::Request, "calibrate", "told");
        sensor.signal(end);
        let mut failed = Vec::new();
        while failed.len() < 3 {
            match operator.hears() {
                (Performative::Failure, id, _) => failed.push(id),
                // The command is written, or waits behind the question.
                (Performative::Agree, id, _) => assert_eq!(id, "told"),
                other => panic!("{other:?}"),
            }
        }
        failed.sort();
        assert_eq!(failed, ["all", "open", "told"]);
        operator.sees_go(&home, "sensor@robot3");
        let outcome = operator.try_to_say(Performative::QueryRef, "x", "sensor@robot3", "late");
        assert!(!matches!(outcome, Outcome::Delivered), "{outcome:?}");
        if end == Signal::STOP {
            // It wakes up, finds its stream closed, and dials again.
            sensor.signal(Signal::CONT);
            home.wait_for("sensor@robot3");
            say(Performative::QueryRef, "distance", "again");
            operator.hears_this(Performative::Inform, "again", "distance");
        }
    }
}

#[test]
fn a_configured_text_agent_is_there_before_it_speaks_and_when_its_line_is_gone() {
    let place = Place::new();
    let (tty, file) = (place.path("tty"), place.path("fipad.toml"));
    let url = format!("serial://{}?baud=115200", tty.display());
    let config = format!("text = '{url}'\n[text-agents]\nlamp = '{url}'\n");
    std::fs::write(&file, config).unwrap();
    let home = place.start("robot1");
    let _away = place.start_with("robot2", &["--config", file.to_str().unwrap()]);
    let operator = Operator::at(&home);
    home.wait_for("lamp@robot2");
    let say = |performative, content, id| {
        operator.say(performative, content, "lamp@robot2", id);
    };
    for round in ["1", "2"] {
        say(Performative::Request, "on", "nowhere");
        operator.hears_this(Performative::Failure, "nowhere", "the agent is gone");
        let mut board = Board::plug_in(&tty);
        // It says nothing; its line is there at some time.
        let until = Instant::now() + PATIENCE;
        loop {
            assert!(Instant::now() < until, "its line is not noticed");
            say(Performative::Request, "on", round);
            match operator.hears() {
                (Performative::Agree, ..) => break,
                (Performative::Failure, ..) => std::thread::sleep(Duration::from_millis(50)),
                other => panic!("{other:?}"),
            }
        }
        operator.hears_this(Performative::Inform, round, "sent");
        assert_eq!(board.hear(), "{O:operator@robot1;D:lamp;A:on}");
        say(Performative::Subscribe, "", "all");
        operator.hears_this(Performative::Agree, "all", "");
        drop(board);
        operator.hears_this(Performative::Failure, "all", "the agent is gone");
    }
    home.wait_for("lamp@robot2");
}
