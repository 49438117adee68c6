//! A daemon with UDT plugged in, and C++ programs that know nothing but libudt.

mod support;

// Those of the main workspace, of which parts are used.
#[allow(dead_code)]
#[path = "../../../tests/support/cpp.rs"]
mod cpp;
#[allow(dead_code)]
#[path = "../../../tests/support/namespace.rs"]
mod namespace;
#[allow(dead_code)]
#[path = "../../../tests/support/process.rs"]
mod process;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use bytes::Bytes;
use fipa::blocking::{Agent, Platform};
use fipa::{AgentId, Message, Outcome, Performative, ReceiverOutcome};
use fipa_codec::{Limits, decode_letter, decode_payload};
use rustix::process::Signal;

use cpp::{CppRobot, SIGNATURE};
use namespace::Namespace;
use process::Process;
use support::{PATIENCE, compiled, recordings, skipped};

/// The example, a daemon like any other.
struct Daemon {
    process: Process,
    platform: Platform,
    port: u16,
    _folder: tempfile::TempDir,
}

impl Daemon {
    fn start(name: &str) -> Daemon {
        Daemon::start_with(name, &["--no-mdns"], |command| command)
    }

    fn start_with(name: &str, options: &[&str], enter: impl Fn(Command) -> Command) -> Daemon {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new(example());
        command.args(["--json", "--name", name]).args(options);
        command.args(["--listen", "127.0.0.1:0", "--listen", "udt://127.0.0.1:0"]);
        command.arg("--control").arg(folder.path().join("control"));
        command.env("FIPA_LOG", "error");
        command.env("XDG_CONFIG_HOME", "/nonexistent");
        let mut process = Process::start(enter(command));
        let ready = process.json();
        let endpoints: Vec<&str> = ready["endpoints"]
            .as_array()
            .unwrap()
            .iter()
            .map(|endpoint| endpoint.as_str().unwrap())
            .collect();
        let port = endpoints[1].strip_prefix("udt://127.0.0.1:").unwrap();
        assert!(endpoints[0].starts_with("tcp://127.0.0.1:"), "{ready}");
        Daemon {
            port: port.parse().unwrap(),
            process,
            platform: Platform::attach_to(folder.path().join("control")).unwrap(),
            _folder: folder,
        }
    }

    fn agent(&self, name: &str) -> Agent {
        self.platform.agent(name).unwrap()
    }
}

/// Cargo builds examples beside the tests.
fn example() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let profile = test.parent().unwrap().parent().unwrap();
    profile.join("examples/fipad-udt")
}

/// A C++ program that has said at which port it is.
fn peer(name: &str, args: &[&str], enter: impl Fn(Command) -> Command) -> (Process, AgentId) {
    let mut command = Command::new(compiled(name));
    command.args(args);
    let mut process = Process::start(enter(command));
    let port = process.line();
    let id = AgentId::new("drive@robot2").address(format!("udt://127.0.0.1:{port}"));
    (process, id)
}

fn send(agent: &Agent, to: impl Into<AgentId>, content: impl Into<Bytes>) -> ReceiverOutcome {
    let letter = Message::new(Performative::Inform).to(to).content(content);
    agent.send_within(letter, PATIENCE).remove(0)
}

fn received(agent: &Agent) -> Message {
    agent.receive_timeout(PATIENCE).expect("a letter").unwrap()
}

/// The message in a letter that a C++ program was sent.
fn written(file: &Path) -> Message {
    let octets = Bytes::from(std::fs::read(file).unwrap());
    let letter = decode_letter(&octets, &Limits::default()).unwrap();
    decode_payload(&letter.envelope, &letter.payload, &Limits::default()).unwrap()
}

#[test]
fn recorded_letters_of_a_cpp_sender_reach_the_agents_of_the_daemon() {
    let daemon = Daemon::start("robot1");
    let agents = ["agent-a", "agent-b"].map(|name| daemon.agent(name));
    let files = recordings();
    let of = |name: &str| {
        let files = files
            .iter()
            .filter(|file| file.to_string_lossy().ends_with(name));
        files.cloned().collect::<Vec<_>>()
    };
    let (to_a, to_b) = (of("to_agent-a.bin"), of("to_agent-b.bin"));
    let mut command = Command::new(compiled("recorded-sender"));
    command.args(["send", &daemon.port.to_string()]);
    let _sender = Process::start({
        command.args(&to_a).args(&to_b);
        command
    });
    for (agent, files) in agents.iter().zip([to_a, to_b]) {
        assert!(files.len() > 2);
        for file in files {
            assert_eq!(received(agent), written(&file), "{}", file.display());
        }
    }
}

#[test]
fn letters_of_every_size_reach_a_cpp_receiver() {
    let daemon = Daemon::start("robot1");
    let agent = daemon.agent("arm@robot1");
    let sizes = [0, 1_400, 100_000, 5_000_000];
    let prefix = Path::new(env!("CARGO_TARGET_TMPDIR")).join("letter");
    let count = sizes.len().to_string();
    let args = ["receive", &count, &prefix.display().to_string()];
    let (mut receiver, id) = peer("letter-receiver", &args, |command| command);
    for (index, size) in sizes.into_iter().enumerate() {
        let content: Vec<u8> = (0..size).map(|i| (i * 7 % 251) as u8).collect();
        let told = send(&agent, id.clone(), content.clone());
        assert_eq!(told.outcome, Outcome::Sent, "{told:?}");
        assert_eq!(told.via.as_deref(), Some(id.addresses[0].as_str()));
        receiver.line();
        let message = written(Path::new(&format!("{}{index}", prefix.display())));
        assert_eq!(message.sender.unwrap().name, "arm@robot1");
        assert!(
            message.content.unwrap_or_default() == content,
            "{size} octets differ"
        );
    }
}

#[test]
fn live_letters_pass_a_cpp_program_between_two_daemons_whole_and_in_order() {
    let (one, two) = (Daemon::start("robot1"), Daemon::start("robot2"));
    let (arm, drive) = (one.agent("arm@robot1"), two.agent("drive@robot2"));
    let args = ["relay", "50", &two.port.to_string()];
    let (_relay, id) = peer("letter-relay", &args, |command| command);
    for number in 0..50 {
        let content = format!("{number} {}", "x".repeat(number * 1000));
        assert_eq!(
            send(&arm, id.clone(), content.clone()).outcome,
            Outcome::Sent
        );
        let message = received(&drive);
        assert_eq!(message.content_str(), Some(content.as_str()));
        assert_eq!(message.sender.unwrap().name, "arm@robot1");
    }
}

#[test]
fn a_letter_to_nobody_or_to_a_program_that_has_died_is_not_told_to_be_sent() {
    let daemon = Daemon::start("robot1");
    let agent = daemon.agent("arm@robot1");
    let nobody = AgentId::new("x@robot2").address("udt://127.0.0.1:9");
    let told = send(&agent, nobody, "hello");
    assert_eq!(told.outcome, Outcome::Timeout, "{told:?}");
    assert!(
        told.reason.contains("udt://127.0.0.1:9: cannot connect"),
        "{told:?}"
    );

    let prefix = Path::new(env!("CARGO_TARGET_TMPDIR")).join("before-death");
    let args = ["receive", "2", &prefix.display().to_string()];
    let (receiver, id) = peer("mortal-receiver", &args, |command| command);
    assert_eq!(send(&agent, id.clone(), "hello").outcome, Outcome::Sent);
    receiver.kill();
    let told = send(&agent, id, "are you there?");
    assert_eq!(told.outcome, Outcome::Timeout, "{told:?}");
}

#[test]
fn what_is_no_letter_and_what_has_no_receiver_is_told_of_and_the_daemon_goes_on() {
    let daemon = Daemon::start("robot1");
    let agent = daemon.agent("agent-b");
    let files = recordings();
    let to_jade = files
        .iter()
        .find(|file| file.ends_with("sent_01_to_jade.bin"));
    let to_agent = files
        .iter()
        .find(|file| file.ends_with("sent_00_to_agent-b.bin"));
    let mut command = Command::new(compiled("strange-sender"));
    command.args(["send", &daemon.port.to_string()]);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml"));
    command.arg(to_jade.unwrap()).arg(to_agent.unwrap());
    let _sender = Process::start(command);
    assert_eq!(received(&agent).content_str(), Some("one remote"));
    daemon.process.signal(Signal::TERM);
    assert_eq!(daemon.process.wait().code, Some(0));
}

#[test]
fn an_agent_of_a_cpp_robot_that_is_announced_at_udt_is_reached_and_told_where_ours_are() {
    let Some(host) = Namespace::new() else {
        return;
    };
    let enter = |command: Command| host.enter(&command);
    let Some(mut robot) = CppRobot::start(&host, "127.0.0.1") else {
        return;
    };
    let daemon = Daemon::start_with("robot1", &[], enter);
    let arm = daemon.agent("arm@robot1");
    let prefix = Path::new(env!("CARGO_TARGET_TMPDIR")).join("announced");
    let args = ["receive", "1", &prefix.display().to_string()];
    let (mut receiver, id) = peer("announced-receiver", &args, enter);
    robot.publish("cpp-agent", &format!("{} {SIGNATURE};", id.addresses[0]));
    let found = daemon.platform.wait_for("cpp-agent", PATIENCE);
    assert!(found.is_some(), "cpp-agent is not found");
    let told = send(&arm, "cpp-agent", "hello");
    assert_eq!(told.outcome, Outcome::Sent, "{told:?}");
    assert_eq!(told.via.as_deref(), Some(id.addresses[0].as_str()));
    receiver.line();
    let message = written(Path::new(&format!("{}0", prefix.display())));
    assert_eq!(message.content_str(), Some("hello"));

    let strings = robot.found("arm@robot1");
    let own = format!("udt://127.0.0.1:{} {SIGNATURE};", daemon.port);
    assert!(
        strings.iter().any(|string| string.contains(&own)),
        "{strings:?}"
    );
}

#[test]
fn addresses_of_transports_that_are_not_plugged_in_are_wrong_usage() {
    for option in ["--listen", "--advertise", "--peer"] {
        let mut command = Command::new(example());
        command.args(["--no-mdns", option, "dtn://127.0.0.1:4100"]);
        let ended = Process::start(command).wait_within(Duration::from_secs(5));
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert!(ended.only_error().contains("dtn://"), "{ended:?}");
    }
}
