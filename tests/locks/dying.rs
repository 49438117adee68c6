//! Holders that die, stand still, or lose their daemon.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use fastrand::Rng;
use rustix::process::Signal;

use crate::robots::{BOTH, Member, Robots};
use crate::support::process::{Ended, Process};

/// A line that a command wrote while it held the counter.
#[derive(Clone, Debug)]
struct Line {
    number: u64,
    what: String,
    name: String,
    at: Duration,
}

fn lines(file: &Path) -> Vec<Line> {
    let text = fs::read_to_string(file).unwrap_or_default();
    let whole = text
        .split_inclusive('\n')
        .filter(|line| line.ends_with('\n'));
    let line = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [number, what, name, at] = words[..] else {
            panic!("{line:?}");
        };
        Line {
            number: number.parse().unwrap(),
            what: what.to_owned(),
            name: name.to_owned(),
            at: Duration::from_nanos(at.parse().unwrap()),
        }
    };
    whole.map(line).collect()
}

/// The time as `date +%s%N` says it.
fn now() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap()
}

/// Nobody writes with a number after somebody wrote with a greater one.
fn assert_no_overlap(lines: &[Line]) {
    for pair in lines.windows(2) {
        assert!(pair[0].number <= pair[1].number, "{lines:?}");
    }
    let mut begun = BTreeMap::new();
    for line in lines.iter().filter(|line| line.what == "begins") {
        let other = begun.insert(line.number, &line.name);
        assert_eq!(other, None, "{} was granted twice", line.number);
    }
}

/// On a machine that is too busy a lease of 0.6 s may end, and an owner may be silent for 0.8 s:
/// then the command was told.
fn has_ended_well(ended: &Ended) -> bool {
    match ended.code {
        Some(0) => true,
        Some(1) => ["it is lost", "its owner"]
            .iter()
            .any(|told| ended.only_error().contains(told)),
        _ => false,
    }
}

/// Turns of one member after the other, of which chance ends some.
struct Turns<'a> {
    member: Member,
    algorithm: &'a str,
    file: &'a Path,
    random: Rng,
    /// When somebody was killed.
    killed: Vec<(String, Duration)>,
    finished: usize,
}

impl<'a> Turns<'a> {
    fn of(robots: &Robots, at: usize, algorithm: &'a str, file: &'a Path, seed: u64) -> Turns<'a> {
        Turns {
            member: robots.member(at),
            algorithm,
            file,
            random: Rng::with_seed(seed.wrapping_add(at as u64)),
            killed: Vec::new(),
            finished: 0,
        }
    }

    fn start(&self) -> Process {
        let (name, shown) = (&self.member.name, self.file.display());
        let say =
            |what: &str| format!("echo $FIPA_LOCK_FENCING {what} {name} $(date +%s%N) >> {shown}");
        let script = format!("{}; echo; sleep 0.03; {}", say("begins"), say("ends"));
        let options = options(self.algorithm);
        Process::start(self.member.lock("counter", &options, &script))
    }

    fn take(&mut self) {
        let mut holder = self.start();
        let dies = match self.random.u8(0..4) {
            // Before it has attached, while it waits, while it holds, or when it is done.
            0 | 1 => {
                thread::sleep(Duration::from_millis(self.random.u64(0..600)));
                true
            }
            // Right after the grant, unless it is told that there is none.
            2 => holder.line_or_end().is_some(),
            _ => false,
        };
        if !dies {
            let ended = holder.wait();
            assert!(has_ended_well(&ended), "{ended:?}");
            self.finished += usize::from(ended.code == Some(0));
            return;
        }
        self.killed.push((self.member.name.clone(), now()));
        holder.kill();
    }
}

fn options(algorithm: &str) -> [&str; 4] {
    ["--heartbeat", "0.2", "--algorithm", algorithm]
}

/// How long it took until the next one held, where somebody was killed who did.
fn recoveries(lines: &[Line], killed: &[(String, Duration)]) -> Vec<Duration> {
    let recovery = |(name, at): &(String, Duration)| {
        let mut before = lines.iter().filter(|line| line.at < *at);
        let last = before.rfind(|line| line.name == *name)?;
        let mut after = lines.iter().filter(|line| line.at > *at);
        let next = after.find(|line| line.what == "begins")?;
        (last.what == "begins").then(|| next.at - *at)
    };
    let mut recoveries: Vec<Duration> = killed.iter().filter_map(recovery).collect();
    recoveries.sort();
    recoveries
}

fn tell(what: &str, killed: usize, recoveries: &[Duration]) {
    let median = recoveries.get(recoveries.len() / 2);
    println!(
        "{what}: {killed} killed, {} while they held; the next one held after {median:?} (median), \
         {:?} (longest)",
        recoveries.len(),
        recoveries.last()
    );
}

/// The seed of a run that is to be repeated, or another one each time.
fn seed() -> u64 {
    let given = std::env::var("FIPA_SEED").ok();
    let seed = given.map_or_else(|| fastrand::u64(..), |seed| seed.parse().unwrap());
    println!("FIPA_SEED={seed}");
    seed
}

#[test]
fn commands_that_are_killed_at_any_moment_are_followed_and_overlap_with_nobody() {
    const TIMES: usize = 12;
    let seed = seed();
    let robots = Robots::start();
    for algorithm in BOTH {
        let file = robots.place.path(algorithm);
        let mut turns = [0, 1, 2].map(|at| Turns::of(&robots, at, algorithm, &file, seed));
        thread::scope(|scope| {
            for turns in &mut turns {
                scope.spawn(|| (0..TIMES).for_each(|_| turns.take()));
            }
        });
        let last = robots
            .member(0)
            .run(&["--heartbeat", "1", "--algorithm", algorithm], "true");
        assert_eq!(last.code, Some(0), "{last:?}");
        let lines = lines(&file);
        assert_no_overlap(&lines);
        let ended = lines.iter().filter(|line| line.what == "ends").count();
        assert!(ended >= turns.iter().map(|turns| turns.finished).sum());
        let killed: Vec<_> = turns
            .iter()
            .flat_map(|turns| turns.killed.clone())
            .collect();
        tell(algorithm, killed.len(), &recoveries(&lines, &killed));
    }
}

#[test]
fn a_daemon_that_is_killed_at_any_moment_takes_no_lock_with_it() {
    const TIMES: usize = 4;
    let seed = seed();
    let mut random = Rng::with_seed(seed);
    let mut robots = Robots::start();
    let peer = robots.daemons[0].endpoint().to_owned();
    for algorithm in BOTH {
        let file = robots.place.path(algorithm);
        let mut killed = Vec::new();
        for _ in 0..TIMES {
            let [one, two, three] =
                [0, 1, 2].map(|at| Turns::of(&robots, at, algorithm, &file, seed));
            let (mut dying, others) = (three.start(), [one.start(), two.start()]);
            if random.bool() {
                dying.line_or_end();
            } else {
                thread::sleep(Duration::from_millis(random.u64(0..600)));
            }
            killed.push(("a@robot3".to_owned(), now()));
            robots.daemons.remove(2).kill();
            for ended in others.map(Process::wait) {
                assert!(has_ended_well(&ended), "{ended:?}");
            }
            let joining = ["--no-mdns", "--peer", &peer];
            robots
                .daemons
                .push(robots.place.start_with("robot3", &joining));
            robots.daemons[2].wait_for("locks@robot1");
            // It was done before, is told, or had not asked yet and does when the daemon is back.
            let ended = dying.wait();
            assert!(matches!(ended.code, Some(0 | 1 | 3)), "{ended:?}");
        }
        let last = robots
            .member(2)
            .run(&["--heartbeat", "1", "--algorithm", algorithm], "true");
        assert_eq!(last.code, Some(0), "{last:?}");
        let lines = lines(&file);
        assert_no_overlap(&lines);
        tell(algorithm, killed.len(), &recoveries(&lines, &killed));
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
