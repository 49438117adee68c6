//! A robot whose address changes while letters are under way.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Barrier;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use fipa::blocking::{Agent, Platform};
use fipa::{Message, Outcome, Performative, ReceiverOutcome};
use rustix::process::Signal;

use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};
use crate::support::namespace::Namespace;

/// Letters that are sent, half of them each way, and the sending agents of each robot.
const LETTERS: usize = 1000;
const SENDERS: usize = 4;

/// How long a letter's outcome is waited for.
const TIMEOUT: Duration = Duration::from_secs(40);

/// For how long the robot has no address at all.
const NOWHERE: Duration = Duration::from_millis(500);

#[test]
fn quic_goes_on_when_the_address_changes_and_no_letter_is_lost() {
    let Some((told, log)) = roam("quic") else {
        return;
    };
    for (letter, told) in &told {
        assert_eq!(told.outcome, Outcome::Delivered, "{letter}: {told:?}");
        let via = told.via.as_deref().unwrap_or_default();
        assert!(via.starts_with("quic://") || via == "local", "{via}");
    }
    let ends = |line: &str| line.contains("the service ends");
    let lost = |line: &str| line.contains("is not heard") || line.contains("is gone");
    let broke = |line: &&String| lost(line) && !ends(line);
    assert_eq!(log.iter().find(broke), None, "it is the same connection");
    let met = log.iter().filter(|line| line.contains("is reached at"));
    assert_eq!(met.count(), 2, "one link, told by both ends: {log:?}");
}

#[test]
fn tcp_connects_anew_when_the_address_changes_and_what_is_told_of_each_letter_is_true() {
    let Some((told, log)) = roam("tcp") else {
        return;
    };
    let delivered = told.values().filter(|t| t.outcome == Outcome::Delivered);
    assert!(delivered.count() > LETTERS / 2);
    assert!(
        log.iter().any(|line| line.contains("is not heard")),
        "{log:?}"
    );
    let met = log.iter().filter(|line| line.contains("is reached at"));
    assert!(met.count() > 2, "there is another link: {log:?}");
}

/// Sends letters both ways, in the middle of which the address of the robot that dialled changes.
/// What was told of each letter, after that was found to be true, and what the daemons logged.
fn roam(scheme: &str) -> Option<(BTreeMap<String, ReceiverOutcome>, Vec<String>)> {
    let (here, there) = Namespace::pair()?;
    let place = Place::new();
    let start = |host: &Namespace, name: &str, options: [&str; 4]| {
        let mut command = place.fipad(name);
        command.env("FIPA_LOG", "fipa=info");
        command.arg("--no-mdns").args(options);
        Daemon::start(host.enter(&command))
    };
    let at = format!("{scheme}://10.0.0.1:7000");
    let base = start(
        &here,
        "robot1",
        ["--listen", &at, "--max-letter", "1000000"],
    );
    let rover = start(
        &there,
        "robot2",
        ["--listen", "tcp://127.0.0.1:0", "--peer", &at],
    );
    let daemons = [&base, &rover];
    let platforms = daemons.map(|daemon| Platform::attach_to(&daemon.control).unwrap());
    let names = ["sink@robot1", "sink@robot2"];
    let sinks: Vec<Agent> = (names.iter().zip(&platforms))
        .map(|(name, platform)| platform.agent(*name).unwrap())
        .collect();
    for (platform, other) in platforms.iter().zip([names[1], names[0]]) {
        assert!(platform.wait_for(other, PATIENCE).is_some());
    }

    let (number, halfway) = (AtomicUsize::new(0), Barrier::new(2 * SENDERS + 1));
    let told = thread::scope(|scope| {
        let sender = |robot: usize, n: usize| {
            let agent = platforms[robot].agent(format!("a{n}@robot{}", robot + 1));
            let (agent, to) = (agent.unwrap(), names[1 - robot]);
            let (number, halfway) = (&number, &halfway);
            scope.spawn(move || send(&agent, to, number, halfway))
        };
        let robots = (0..2).flat_map(|robot| (0..SENDERS).map(move |n| (robot, n)));
        let senders: Vec<_> = robots.map(|(robot, n)| sender(robot, n)).collect();
        halfway.wait();
        there.remove_address("10.0.0.2");
        thread::sleep(NOWHERE);
        there.add_address("10.0.0.3");
        let told = senders
            .into_iter()
            .flat_map(|sender| sender.join().unwrap());
        told.collect::<BTreeMap<_, _>>()
    });
    assert_eq!(told.len(), LETTERS);
    is_true(&told, &sinks);
    let ended = [base, rover].map(|daemon| {
        daemon.signal(Signal::TERM);
        daemon.into_process().wait()
    });
    let log = ended.into_iter().flat_map(|ended| ended.errors);
    Some((told, log.collect()))
}

/// Sends its share one after the other. Each sender has one under way when the address changes.
fn send(
    agent: &Agent,
    to: &str,
    number: &AtomicUsize,
    halfway: &Barrier,
) -> Vec<(String, ReceiverOutcome)> {
    let share = LETTERS / (2 * SENDERS);
    let letters = (0..share).map(|n| {
        if n == share / 2 {
            halfway.wait();
        }
        let letter = number.fetch_add(1, Ordering::Relaxed).to_string();
        let message = Message::new(Performative::Inform)
            .to(to)
            .content(letter.clone());
        let told = agent.send_within(message, TIMEOUT).remove(0);
        (letter, told)
    });
    letters.collect()
}

/// What was told to be delivered has come, once; what was refused has not.
fn is_true(told: &BTreeMap<String, ReceiverOutcome>, sinks: &[Agent]) {
    let mut come = BTreeSet::new();
    for message in sinks
        .iter()
        .flat_map(|sink| std::iter::from_fn(|| sink.try_receive()))
    {
        let letter = message.content_str().unwrap().to_owned();
        assert!(!come.contains(&letter), "{letter} came twice");
        come.insert(letter);
    }
    for (letter, told) in told {
        match told.outcome {
            Outcome::Delivered => assert!(come.contains(letter), "{letter}: {told:?}"),
            // The receipt may be what was lost.
            Outcome::Timeout => {}
            _ => assert!(!come.contains(letter), "{letter}: {told:?}"),
        }
    }
}
