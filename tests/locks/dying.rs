//! Holders that die, stand still, or lose their daemon.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::robots::{BOTH, Robots};
use crate::support::PATIENCE;
use crate::support::process::{Ended, Process};

/// A line that a command wrote while it held the counter: its number and what it did.
type Line = (u64, String);

fn lines(file: &Path) -> Vec<Line> {
    let text = fs::read_to_string(file).unwrap_or_default();
    let whole = text
        .split_inclusive('\n')
        .filter(|line| line.ends_with('\n'));
    let words = whole.map(|line| line.trim_end().split_once(' ').unwrap());
    let line = |(number, what): (&str, &str)| (number.parse().unwrap(), what.to_owned());
    words.map(line).collect()
}

/// Nobody writes with a number after somebody wrote with a greater one.
fn assert_no_overlap(lines: &[Line]) {
    for pair in lines.windows(2) {
        assert!(pair[0].0 <= pair[1].0, "{lines:?}");
    }
    let mut begun = BTreeMap::new();
    for (number, what) in lines {
        if let Some(name) = what.strip_prefix("begins ") {
            let other = begun.insert(*number, name);
            assert_eq!(other, None, "{number} was granted twice");
        }
    }
}

/// On a machine that is too busy a lease of 0.6 s may end: then the command was told.
fn has_ended_well(ended: &Ended) -> bool {
    match ended.code {
        Some(0) => true,
        Some(1) => ended.only_error().contains("it is lost"),
        _ => false,
    }
}

#[test]
fn holders_that_are_killed_are_followed_and_overlap_with_nobody() {
    const TIMES: usize = 12;
    let robots = Robots::start();
    for algorithm in BOTH {
        let file = robots.place.path(algorithm);
        let shown = file.display();
        let options = ["--heartbeat", "0.2", "--algorithm", algorithm];
        thread::scope(|scope| {
            for at in 0..3 {
                let (member, file, options) = (robots.member(at), &file, &options);
                let begins = format!("begins {}", member.name);
                let script = format!(
                    "echo $FIPA_LOCK_FENCING {begins} >> {shown}; \
                     sleep 0.03; echo $FIPA_LOCK_FENCING ends >> {shown}"
                );
                scope.spawn(move || {
                    for turn in 0..TIMES {
                        let begun = || lines(file).iter().filter(|l| l.1 == begins).count();
                        let before = begun();
                        let holder = Process::start(member.lock("counter", options, &script));
                        // One in three dies while it holds.
                        if (turn + at) % 3 > 0 {
                            let ended = holder.wait();
                            assert!(has_ended_well(&ended), "{ended:?}");
                            continue;
                        }
                        let since = Instant::now();
                        while begun() == before {
                            assert!(since.elapsed() < PATIENCE, "it is stuck");
                            thread::sleep(Duration::from_millis(2));
                        }
                        holder.kill();
                    }
                });
            }
        });
        let lines = lines(&file);
        assert_no_overlap(&lines);
        let begun = lines.iter().filter(|line| line.1.starts_with("begins"));
        assert_eq!(begun.count(), 3 * TIMES, "{algorithm}");
    }
}

#[test]
fn a_killed_holder_is_followed_long_before_its_lease_ends_and_its_command_dies_with_it() {
    let robots = Robots::start();
    for algorithm in BOTH {
        let options = ["--algorithm", algorithm];
        let file = robots.place.path(algorithm);
        let script = format!("echo held; sleep 1; echo alive > {}", file.display());
        let mut holder = Process::start(robots.member(1).lock("counter", &options, &script));
        holder.line();
        let mut waiting = Process::start(robots.member(2).lock(
            "counter",
            &options,
            "echo held; sleep 1.5",
        ));
        while robots.listed(0)["waiting"] != serde_json::json!(["a@robot3"]) {
            thread::sleep(Duration::from_millis(10));
        }
        let killed = Instant::now();
        holder.kill();
        waiting.line();
        // A lease of the usual heartbeat is 15 s.
        println!("{algorithm}: followed after {:?}", killed.elapsed());
        assert!(killed.elapsed() < Duration::from_secs(10));
        assert_eq!(waiting.wait().code, Some(0));
        assert!(!file.exists(), "the command outlived its lock");
    }
}

#[test]
fn a_holder_that_stands_still_loses_it_and_its_command_is_ended() {
    let robots = Robots::start();
    for algorithm in BOTH {
        let options = ["--heartbeat", "0.5", "--algorithm", algorithm];
        // It does not mind SIGTERM.
        let script = "trap '' TERM; echo $FIPA_LOCK_FENCING; while :; do sleep 0.05; done";
        let mut holder = Process::start(robots.member(1).lock("counter", &options, script));
        let first: u64 = holder.line().parse().unwrap();
        holder.signal(Signal::STOP);
        let stopped = Instant::now();
        let next = robots.member(2).run(&options, "echo $FIPA_LOCK_FENCING");
        println!("{algorithm}: followed after {:?}", stopped.elapsed());
        assert_eq!(next.code, Some(0), "{next:?}");
        let second: u64 = next.output[0].parse().unwrap();
        assert!(second > first, "{second} after {first}");
        holder.signal(Signal::CONT);
        let ended = holder.wait();
        assert_eq!(ended.code, Some(1), "{ended:?}");
        let said = ended.only_error();
        assert!(
            said.starts_with("fipa lock: counter: it is lost: "),
            "{said}"
        );
    }
}

#[test]
fn a_holder_whose_daemon_dies_has_lost_it_at_once_and_is_followed_when_its_lease_is_over() {
    let mut robots = Robots::start();
    let options = ["--heartbeat", "0.5"];
    let holder = robots.member(1).hold(&options);
    let killed = robots.daemons.remove(1);
    killed.kill();
    let ended = holder.wait();
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let said = "fipa lock: counter: it is lost: the connection to the other agents ended";
    assert_eq!(ended.only_error(), said);
    let next = robots.member(1).run(&options, "echo $FIPA_LOCK_FENCING");
    assert_eq!(next.output, ["2"], "{next:?}");
}

#[test]
fn a_holder_that_does_not_hear_its_owner_loses_it_and_waiters_are_told() {
    let mut robots = Robots::start();
    let options = ["--heartbeat", "0.2"];
    let holder = robots.member(1).hold(&options);
    let waiting = Process::start(robots.member(2).lock("counter", &options, "echo ran"));
    while robots.listed(0)["waiting"] != serde_json::json!(["a@robot3"]) {
        thread::sleep(Duration::from_millis(10));
    }
    robots.daemons.remove(0).kill();
    let ended = holder.wait();
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let said = "fipa lock: counter: it is lost: its owner was not heard for three heartbeats";
    assert_eq!(ended.only_error(), said);
    let ended = waiting.wait();
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert!(ended.output.is_empty());
    assert!(ended.only_error().contains("its owner"), "{ended:?}");
}
