//! Letters for robots that are away, over the deaths of daemons and on full and damaged disks.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use fipa::blocking::Platform;
use fipa::{Message, Outcome, Performative};
use serde_json::Value;

use crate::support::daemon::{Daemon, Place};
use crate::support::process::run;
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
    let words = ["send", "--to", "b@robot2", "--from", "a@robot1"];
    let rest = ["--performative", "inform", "--timeout", "4", "--json"];
    let content = ["--content", content];
    let ended = daemon.run(&[&words[..], &rest, &content].concat());
    assert_eq!(ended.code, Some(1), "{ended:?}");
    ended.only_json()
}

/// Takes the letters that come for the agent.
fn listen(daemon: &Daemon, letters: usize) -> Vec<String> {
    let count = letters.to_string();
    let words = ["listen", "--as", "b@robot2", "--count", &count, "--json"];
    let mut listening = daemon.attach_with(&words);
    let content = |letter: Value| letter["message"]["content"].as_str().unwrap().to_owned();
    (0..letters).map(|_| content(listening.json())).collect()
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
    assert_eq!(listen(&two, 3), ["one", "two", "three"]);
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
        let content = format!("{n}{}", "x".repeat(1 << 20));
        let message = Message::new(Performative::Inform)
            .to("b@robot2")
            .content(content);
        let told = agent.send_within(message, Duration::from_secs(4)).remove(0);
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

/// How long the daemons are killed for; more with `FIPA_LOAD_SECONDS`.
fn load_time() -> Duration {
    let seconds = std::env::var("FIPA_LOAD_SECONDS");
    Duration::from_secs(seconds.map_or(8, |seconds| seconds.parse().unwrap()))
}

/// What an agent of a daemon gets, until its sender hangs up.
fn receive_all(
    platform: Platform,
    name: &'static str,
    stop: &'static AtomicBool,
) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let agent = platform.agent(name).unwrap();
        while !stop.load(Ordering::Relaxed) {
            match agent.receive_timeout(Duration::from_millis(200)) {
                Some(Ok(message)) => {
                    let content = message.content_str().unwrap().to_owned();
                    sender.send(content).unwrap();
                }
                Some(Err(error)) => panic!("{error}"),
                None => {}
            }
        }
    });
    receiver
}

#[test]
fn no_letter_is_lost_or_delivered_twice_while_daemons_are_killed() {
    static STOP: AtomicBool = AtomicBool::new(false);
    let place = Place::new();
    let start = |name: &str| {
        let state = place.path(&format!("{name}.state")).display().to_string();
        place.start_with(name, &["--state", &state])
    };
    let mut daemons = [Some(start("robot1")), Some(start("robot2"))];
    let control = |n: usize| daemons[n].as_ref().unwrap().control.clone();
    let controls = [control(0), control(1)];
    let receiving = Platform::attach_to(&controls[1]).unwrap();
    let received = receive_all(receiving, "b@robot2", &STOP);
    daemons[0].as_ref().unwrap().wait_for("b@robot2");

    let until = Instant::now() + load_time();
    let control = controls[0].clone();
    let senders = (0..4).map(|sender| {
        let control = control.clone();
        std::thread::spawn(move || {
            let platform = Platform::attach_to(&control).unwrap();
            let agent = platform.agent(format!("a{sender}@robot1")).unwrap();
            let mut told = BTreeMap::new();
            let mut random = fastrand::Rng::with_seed(sender);
            while Instant::now() < until {
                let content = format!("{sender}.{}", told.len());
                let message = Message::new(Performative::Inform)
                    .to("b@robot2")
                    .content(content.clone());
                let timeout = Duration::from_millis(random.u64(400..2000));
                told.insert(content, agent.send_within(message, timeout).remove(0));
            }
            told
        })
    });
    let senders: Vec<_> = senders.collect();
    let mut random = fastrand::Rng::with_seed(7);
    let mut kills = 0;
    while Instant::now() < until {
        std::thread::sleep(Duration::from_millis(random.u64(100..1500)));
        // The receiver's first, and more often: it is away then, and is waited for.
        let n = usize::from(kills == 0 || random.u8(0..3) > 0);
        daemons[n].take().unwrap().kill();
        kills += 1;
        std::thread::sleep(Duration::from_millis(random.u64(500..3500)));
        daemons[n] = Some(start(["robot1", "robot2"][n]));
    }
    let mut told = BTreeMap::new();
    senders
        .into_iter()
        .for_each(|s| told.extend(s.join().unwrap()));

    let mut got: BTreeMap<String, usize> = BTreeMap::new();
    let owed = |got: &BTreeMap<String, usize>| {
        let stored = |o: &fipa::ReceiverOutcome| {
            o.outcome == Outcome::Delivered || o.reason.starts_with("stored")
        };
        let mut owed = told.iter().filter(|(_, told)| stored(told));
        owed.any(|(content, _)| !got.contains_key(content))
    };
    let patience = Instant::now() + Duration::from_secs(40);
    while owed(&got) && Instant::now() < patience {
        if let Ok(content) = received.recv_timeout(Duration::from_millis(200)) {
            *got.entry(content).or_default() += 1;
        }
    }
    // Whatever comes again would come by now.
    while let Ok(content) = received.recv_timeout(Duration::from_secs(3)) {
        *got.entry(content).or_default() += 1;
    }
    STOP.store(true, Ordering::Relaxed);
    let count = |outcome: Outcome| told.values().filter(|o| o.outcome == outcome).count();
    let stored = told.values().filter(|o| o.reason.starts_with("stored"));
    println!(
        "{kills} kills, {} letters: {} delivered, {} timeouts, {} of these stored; {} arrived",
        told.len(),
        count(Outcome::Delivered),
        count(Outcome::Timeout),
        stored.count(),
        got.len(),
    );
    assert!(told.values().any(|o| o.reason.starts_with("stored")));
    for (content, outcome) in &told {
        let arrived = got.get(content).copied().unwrap_or_default();
        assert!(arrived <= 1, "{content} came {arrived} times: {outcome:?}");
        let owed = outcome.outcome == Outcome::Delivered || outcome.reason.starts_with("stored");
        assert!(
            !owed || arrived == 1,
            "{content} did not arrive: {outcome:?}"
        );
        let never = matches!(outcome.outcome, Outcome::Unknown | Outcome::Refused);
        assert!(!never || arrived == 0, "{content} arrived: {outcome:?}");
    }
}
