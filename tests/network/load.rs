//! Agents that write to each other without a pause, and the account of what became of each letter.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

use fipa::blocking::{Agent, Platform};
use fipa::{FipaTime, Message, Outcome, Performative, ReceiverOutcome};

/// Agents of each robot that send.
const SENDERS: usize = 2;

/// Octets of a letter, at most.
const OCTETS: usize = 40_000;

/// How long a letter is waited for that must come.
const PATIENCE: Duration = Duration::from_secs(60);

/// What was told of each letter, by its number and the robot that it went to.
type Told = BTreeMap<String, ReceiverOutcome>;

/// Agents of several robots under load.
pub(crate) struct Load {
    arrivals: Receiver<String>,
    senders: Vec<JoinHandle<(Agent, Told)>>,
    ended: Arc<AtomicBool>,
}

/// Each robot's agent that receives.
pub(crate) fn receiver(robot: usize) -> String {
    format!("b@robot{robot}")
}

impl Load {
    /// Attaches programs to the daemons of the robots 1, 2 and so on, whose agents send until then.
    pub(crate) fn begin(controls: &[&Path], until: Instant) -> Load {
        let ended = Arc::new(AtomicBool::new(false));
        let (sender, arrivals) = channel();
        let robots = controls.len();
        let platforms = controls.iter().map(|c| Platform::attach_to(c).unwrap());
        let platforms: Vec<Platform> = platforms.collect();
        for (robot, platform) in (1..).zip(&platforms) {
            let agent = platform.agent(receiver(robot)).unwrap();
            let (sender, ended) = (sender.clone(), Arc::clone(&ended));
            spawn(move || receive(&agent, &receiver(robot), &sender, &ended));
        }
        for platform in &platforms {
            for robot in 1..=robots {
                let found = platform.wait_for(&receiver(robot), Duration::from_secs(30));
                assert!(found.is_some(), "{} is not found", receiver(robot));
            }
        }
        let senders = (1..).zip(platforms).flat_map(|(robot, platform)| {
            let agent = |n| (robot * 10 + n, platform.agent(format!("a{n}@robot{robot}")));
            let agents: Vec<_> = (0..SENDERS).map(agent).collect();
            agents
                .into_iter()
                .map(move |(seed, agent)| spawn(move || send(agent.unwrap(), seed, robots, until)))
        });
        Load {
            senders: senders.collect(),
            arrivals,
            ended,
        }
    }

    /// Waits for the end of the load and for what must arrive, and checks the account; all daemons
    /// must be up. How many letters were told of, by their outcome.
    pub(crate) fn check(self) -> BTreeMap<String, usize> {
        let mut told = Told::new();
        let mut agents = Vec::new();
        for sender in self.senders {
            let (agent, of_agent) = sender.join().unwrap();
            told.extend(of_agent);
            agents.push(agent);
        }
        let mut missing: Vec<&String> = told
            .iter()
            .filter(|(_, told)| is_owed(told))
            .map(|(letter, _)| letter)
            .collect();
        let mut arrived: BTreeMap<String, usize> = BTreeMap::new();
        let mut failed: BTreeMap<String, String> = BTreeMap::new();
        let begun = Instant::now();
        let mut quiet = Instant::now();
        // What comes again would come soon.
        while quiet.elapsed() < Duration::from_secs(3) {
            while let Ok(letter) = self.arrivals.try_recv() {
                quiet = Instant::now();
                *arrived.entry(letter).or_default() += 1;
            }
            failed.extend(agents.iter().flat_map(failures));
            missing
                .retain(|letter| !arrived.contains_key(*letter) && !failed.contains_key(*letter));
            if !missing.is_empty() && begun.elapsed() < PATIENCE {
                quiet = Instant::now();
            }
            sleep(Duration::from_millis(20));
        }
        self.ended.store(true, Ordering::Relaxed);
        let mut counts = BTreeMap::new();
        for (letter, told) in &told {
            let times = arrived.get(letter).copied().unwrap_or_default();
            assert!(times <= 1, "{letter} came {times} times: {told:?}");
            let failure = failed.get(letter);
            let excused = is_stored(told) && failure.is_some();
            assert!(
                !is_owed(told) || times == 1 || excused,
                "{letter} did not arrive: {told:?}"
            );
            assert!(
                times == 0 || failure.is_none_or(|why| why.contains("timeout")),
                "{letter} arrived: {failure:?}"
            );
            let never = matches!(
                told.outcome,
                Outcome::Unknown | Outcome::Refused | Outcome::Expired
            );
            assert!(!never || times == 0, "{letter} arrived: {told:?}");
            let kind = match is_stored(told) {
                true => "stored".to_owned(),
                false => told.outcome.to_string(),
            };
            *counts.entry(kind).or_default() += 1;
        }
        counts.insert("arrived".to_owned(), arrived.len());
        counts.insert("failed later".to_owned(), failed.len());
        counts
    }
}

fn is_stored(told: &ReceiverOutcome) -> bool {
    told.outcome == Outcome::Timeout && told.reason.starts_with("stored")
}

/// Whether the letter must arrive - or, where it is stored and there is a time by which its answer
/// is wanted, its sender must be told that it did not.
fn is_owed(told: &ReceiverOutcome) -> bool {
    told.outcome == Outcome::Delivered || is_stored(told)
}

/// The notices that have come to a sender: the letter, and what it says.
fn failures(agent: &Agent) -> Vec<(String, String)> {
    let mut failures = Vec::new();
    while let Some(message) = agent.try_receive() {
        assert_eq!(message.performative, Performative::Failure, "{message:?}");
        let about = message.conversation_id.as_ref().unwrap().to_string();
        let content = message.content_str().unwrap_or_default().to_owned();
        failures.push((about.trim_matches('"').to_owned(), content));
    }
    failures
}

/// Takes letters, which must be what was sent, and tells their numbers.
fn receive(agent: &Agent, name: &str, sender: &Sender<String>, ended: &AtomicBool) {
    while !ended.load(Ordering::Relaxed) {
        let Some(message) = agent.receive_timeout(Duration::from_millis(200)) else {
            continue;
        };
        let message = message.unwrap();
        let content = message.content_str().unwrap();
        let [number, octets, filling] = content.splitn(3, ' ').collect::<Vec<_>>()[..] else {
            panic!("{content:?} was not sent");
        };
        let whole =
            filling.len() == octets.parse::<usize>().unwrap() && filling.bytes().all(|o| o == b'x');
        assert!(whole, "letter {number} is not what was sent");
        // Nobody listens any more once the account is made.
        let _ = sender.send(format!("{number} to {name}"));
    }
}

/// Sends letters one after the other, some of which are not wanted after a while.
fn send(agent: Agent, seed: usize, robots: usize, until: Instant) -> (Agent, Told) {
    let mut random = fastrand::Rng::with_seed(seed as u64);
    let mut told = Told::new();
    while Instant::now() < until {
        let number = format!("{seed}.{}", told.len());
        let to = receiver(random.usize(1..=robots));
        let octets = random.usize(0..OCTETS);
        let letter = format!("{number} to {to}");
        let mut message = Message::new(Performative::Inform)
            .to(to.as_str())
            .conversation_id(letter.as_str())
            .content(format!("{number} {octets} {}", "x".repeat(octets)));
        if random.u8(0..6) == 0 {
            message = message.reply_by(FipaTime::from_unix_millis(
                unix_millis() + random.i64(0..1500),
            ));
        }
        let timeout = Duration::from_millis(random.u64(400..2500));
        let outcome = agent.send_within(message, timeout).remove(0);
        told.insert(letter, outcome);
    }
    (agent, told)
}

fn unix_millis() -> i64 {
    let since = std::time::UNIX_EPOCH.elapsed().unwrap();
    i64::try_from(since.as_millis()).unwrap()
}
