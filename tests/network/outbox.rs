//! Letters for robots that are away, over the death of a daemon and on full and damaged disks.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use fipa::blocking::{Agent, Platform};
use fipa::{Message, Outcome, Performative, ReceiverOutcome};
use serde_json::Value;

use crate::support::daemon::{Daemon, Place};
use crate::support::process::{Process, run};
use crate::support::skipped;

/// Sends a letter whose outcome must be that it is stored.
fn store(daemon: &Daemon, content: &str) {
    let told = send(daemon, content);
    assert_eq!(told["outcome"], "timeout", "{told}");
    assert!(
        told["reason"].as_str().unwrap().starts_with("stored"),
        "{told}"
    );
}

fn send(daemon: &Daemon, content: &str) -> Value {
    send_with(daemon, content, 1)
}

/// Sends a letter with which the program ends so.
fn send_with(daemon: &Daemon, content: &str, code: i32) -> Value {
    let words = ["send", "--to", "b@robot2", "--from", "a@robot1"];
    let rest = ["--performative", "inform", "--timeout", "4", "--json"];
    let content = ["--content", content];
    let ended = daemon.run(&[&words[..], &rest, &content].concat());
    assert_eq!(ended.code, Some(code), "{ended:?}");
    ended.only_json()
}

/// Takes the letters that come for the agent.
fn listen(daemon: &Daemon, letters: usize) -> Vec<String> {
    let mut listening = listener(daemon, letters);
    (0..letters).map(|_| content(&mut listening)).collect()
}

fn listener(daemon: &Daemon, letters: usize) -> Process {
    let count = letters.to_string();
    daemon.attach_with(&["listen", "--as", "b@robot2", "--count", &count, "--json"])
}

/// What is in the next letter.
fn content(listening: &mut Process) -> String {
    let letter = listening.json();
    letter["message"]["content"].as_str().unwrap().to_owned()
}

/// Two daemons of which the first one stores; the agent `b@robot2` was at the second one, which
/// has been killed.
fn robot_away(place: &Place, state: &Path) -> Daemon {
    let one = place.start_with("robot1", &["--state", &state.display().to_string()]);
    lose_robot(place, &one);
    one
}

fn lose_robot(place: &Place, one: &Daemon) {
    let two = place.start("robot2");
    let _listening = two.attach("listen", "b@robot2");
    one.wait_for("b@robot2");
    two.kill();
    let platform = Platform::attach_to(&one.control).unwrap();
    while !platform.search("b@robot2").unwrap().is_empty() {
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn letters_outlive_the_daemon_that_stores_them() {
    let place = Place::new();
    let state = place.path("state");
    let one = robot_away(&place, &state);
    ["one", "two"]
        .iter()
        .for_each(|content| store(&one, content));
    one.kill();
    let one = place.start_with("robot1", &["--state", &state.display().to_string()]);
    store(&one, "three");
    let two = place.start("robot2");
    let mut listening = listener(&two, 4);
    for expected in ["one", "two", "three"] {
        assert_eq!(content(&mut listening), expected);
    }
    // Its receipt comes behind theirs.
    let told = send_with(&one, "four", 0);
    assert_eq!(told["outcome"], "delivered", "{told}");
    assert_eq!(content(&mut listening), "four");
    // What was delivered is not there any more.
    let ended = one.into_process();
    ended.signal(rustix::process::Signal::TERM);
    assert_eq!(ended.wait().code, Some(0));
    let letters = fipa_outbox::open(&state).unwrap().take_letters();
    assert_eq!(letters, []);
}

#[test]
fn a_damaged_outbox_is_not_taken_for_an_empty_one() {
    let place = Place::new();
    let state = place.path("state");
    let one = robot_away(&place, &state);
    store(&one, "one");
    one.kill();
    let file = state.join(fipa_outbox::FILE_NAME);
    let mut octets = fs::read(&file).unwrap();
    octets[..32].fill(0);
    fs::write(&file, &octets).unwrap();
    let mut command = place.fipad("robot1");
    command.arg("--state").arg(&state);
    let ended = run(command);
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.only_error().contains("cannot be read"), "{ended:?}");
    assert_eq!(fs::read(&file).unwrap(), octets);
}

#[test]
fn a_state_directory_belongs_to_one_daemon() {
    let place = Place::new();
    let state = place.path("state").display().to_string();
    let _one = place.start_with("robot1", &["--state", &state]);
    let mut command = place.fipad("robot2");
    command.args(["--state", &state]);
    let ended = run(command);
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(
        ended.only_error().contains("in use by another daemon"),
        "{ended:?}"
    );
}

/// The command in a mount namespace of its own, with a small disk at the directory.
fn on_small_disk(command: &Command, directory: &Path, octets: u64) -> Command {
    let script = r#"mount -t tmpfs -o size="$0" tmpfs "$1" && shift && exec "$@""#;
    let mut inside = Command::new("unshare");
    inside.args(["--user", "--map-root-user", "--mount", "sh", "-c", script]);
    inside.arg(octets.to_string()).arg(directory);
    inside.arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => inside.env(name, value),
            None => inside.env_remove(name),
        };
    }
    inside
}

/// Sends a letter of a MiB that begins with a number.
fn send_large(agent: &Agent, n: usize) -> ReceiverOutcome {
    let message = Message::new(Performative::Inform)
        .to("b@robot2")
        .content(format!("{n}{}", "x".repeat(1 << 20)));
    agent.send_within(message, Duration::from_secs(4)).remove(0)
}

#[test]
fn a_letter_that_does_not_fit_on_the_disk_is_an_ordinary_timeout() {
    let place = Place::new();
    let state = place.path("state");
    fs::create_dir(&state).unwrap();
    if run(on_small_disk(&Command::new("true"), &state, 1 << 20)).code != Some(0) {
        return skipped("user and mount namespaces");
    }
    let mut command = place.fipad("robot1");
    command.arg("--state").arg(&state);
    let one = Daemon::start(on_small_disk(&command, &state, 6 << 20));
    lose_robot(&place, &one);
    let program = Platform::attach_to(&one.control).unwrap();
    let agent = program.agent("a@robot1").unwrap();
    let mut kept = Vec::new();
    for n in 0..8 {
        let told = send_large(&agent, n);
        assert_eq!(told.outcome, Outcome::Timeout, "{told:?}");
        if told.reason.starts_with("stored") {
            kept.push(n.to_string());
        } else {
            assert!(told.reason.contains("could not be stored"), "{told:?}");
        }
    }
    assert!((1..8).contains(&kept.len()), "{kept:?}");
    let two = place.start("robot2");
    let got = listen(&two, kept.len());
    let got: Vec<&str> = got.iter().map(|content| &content[..1]).collect();
    assert_eq!(got, kept);
}

#[test]
fn letters_are_stored_again_once_a_full_disk_has_room() {
    let place = Place::new();
    let state = place.path("state");
    fs::create_dir(&state).unwrap();
    if run(on_small_disk(&Command::new("true"), &state, 1 << 20)).code != Some(0) {
        return skipped("user and mount namespaces");
    }
    let mut command = place.fipad("robot1");
    command.arg("--state").arg(&state);
    let one = Daemon::start(on_small_disk(&command, &state, 16 << 20));
    lose_robot(&place, &one);
    let inside = format!("/proc/{}/root{}/filler", one.id(), state.display());
    let mut filler = fs::File::create(&inside).unwrap();
    while filler.write_all(&[0; 4096]).is_ok() {}
    let program = Platform::attach_to(&one.control).unwrap();
    let agent = program.agent("a@robot1").unwrap();
    let full = send_large(&agent, 0);
    assert_eq!(full.outcome, Outcome::Timeout, "{full:?}");
    assert!(full.reason.contains("could not be stored"), "{full:?}");
    drop(filler);
    fs::remove_file(&inside).unwrap();
    let told = send_large(&agent, 1);
    assert!(told.reason.starts_with("stored"), "{told:?}");
    let two = place.start("robot2");
    assert!(listen(&two, 1)[0].starts_with('1'));
}
