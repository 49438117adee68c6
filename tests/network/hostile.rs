//! Whoever connects may say anything: the daemon stays up, keeps its memory, and answers others.

use std::io::Write;
use std::net::{Shutdown, TcpStream};
use std::process::Command;
use std::time::{Duration, Instant};

use fipa::blocking::{Agent, Platform};
use fipa::{Message, Performative};
use rustix::process::{Resource, Rlimit, Signal, getrlimit, setrlimit};

use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};
use crate::support::process::Process;

/// Connections of an attack on which nothing is said.
const SILENT: usize = 2000;

/// Octets that a daemon may have in memory at most, whatever is done to it.
const MEMORY: u64 = 512 << 20;

/// A daemon under attack, and an honest agent on another one that talks to an agent there.
pub(crate) struct Battle {
    pub(crate) daemon: Daemon,
    pub(crate) other: Daemon,
    _echo: Process,
    _platform: Platform,
    honest: Agent,
    _place: Place,
}

impl Battle {
    pub(crate) fn begin() -> Battle {
        Battle::begin_with(|command| command)
    }

    /// The same with the daemon's command changed.
    fn begin_with(change: impl Fn(Command) -> Command) -> Battle {
        let place = Place::new();
        let other = place.start("robot1");
        let daemon = Daemon::start(change(place.fipad("robot2")));
        let echo = daemon.attach("echo", "echo@robot2");
        other.wait_for("echo@robot2");
        let platform = Platform::attach_to(&other.control).unwrap();
        let honest = platform.agent("honest@robot1").unwrap();
        Battle {
            daemon,
            other,
            _echo: echo,
            _platform: platform,
            honest,
            _place: place,
        }
    }

    pub(crate) fn connect(&self) -> TcpStream {
        let endpoint = self.daemon.endpoint().trim_start_matches("tcp://");
        TcpStream::connect(endpoint).unwrap()
    }

    /// Says something and ends; the daemon may end it earlier.
    fn say(&self, octets: &[u8]) {
        let mut stream = self.connect();
        let _ = stream.write_all(octets);
        let _ = stream.shutdown(Shutdown::Write);
    }

    /// Says octets that are no letter, also behind what a letter, our link and XML begin with.
    pub(crate) fn say_anything(&self, random: &mut impl FnMut() -> u64) {
        let octets: Vec<u8> = (0..2000).map(|_| random() as u8).collect();
        for head in [
            &b""[..],
            b"\xfe\x00\x10",
            b"\xfd\x00\xff\xff",
            b"\x8fFIPA\r\n\x01",
            b"<?xml ",
        ] {
            self.say(&[head, &octets].concat());
        }
    }

    /// A letter and a frame of our link that claim 4 GiB.
    pub(crate) fn claim_much(&self) {
        let huge = "<payload-length>4294967296</payload-length>";
        self.say(envelope(huge).as_bytes());
        self.say(b"\x8fFIPA\r\n\x01\xff\xff\xff\xff\x02");
    }

    /// A million elements in each other, in an envelope and in a message.
    pub(crate) fn nest_deeply(&self) {
        self.say(envelope(&"<a>".repeat(1_000_000)).as_bytes());
        self.say("<envelope>".repeat(1_000_000).as_bytes());
        let message = "(".repeat(1_000_000);
        self.say(letter_to("x").replace("(inform", &message).as_bytes());
    }

    /// Letters to patterns that are meant to blow up.
    pub(crate) fn send_to_patterns(&self) {
        let patterns = [
            "(a*)*b".repeat(500),
            "(((x{100}){100}){100}){100}".to_owned(),
            "\\w{1000}".repeat(400),
            "(".repeat(4000),
            "(a|aa)+$".repeat(400),
            ".*".repeat(2000),
            "x".repeat(1 << 20),
        ];
        for pattern in &patterns {
            self.say(letter_to(pattern).as_bytes());
        }
    }

    /// The median of some round trips of the honest agent; each of them succeeds.
    fn round_trip(&self) -> Duration {
        let ask = || {
            let begun = Instant::now();
            let request = Message::new(Performative::QueryRef)
                .to("echo@robot2")
                .content("?");
            let answer = self.honest.request(request, Duration::from_secs(10));
            answer.expect("the honest agent is answered");
            begun.elapsed()
        };
        let mut times: Vec<Duration> = (0..101).map(|_| ask()).collect();
        times.sort();
        times[times.len() / 2]
    }

    /// Octets of the daemon's memory.
    fn memory(&self) -> u64 {
        self.memory_of("VmRSS:")
    }

    /// What the system says of the daemon's memory, in octets.
    pub(crate) fn memory_of(&self, what: &str) -> u64 {
        let status = format!("/proc/{}/status", self.daemon.id());
        let status = std::fs::read_to_string(status).expect("the daemon is up");
        let line = status.lines().find(|line| line.starts_with(what)).unwrap();
        let kib: u64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
        kib << 10
    }

    /// Whether all is well, with the figures.
    fn check(&self, what: &str, before: Duration) {
        let (after, memory) = (self.round_trip(), self.memory());
        let factor = after.as_secs_f64() / before.as_secs_f64();
        println!(
            "{what}: {after:?}, {factor:.2} of {before:?}; {} KiB",
            memory >> 10
        );
        assert!(memory < MEMORY, "{what}: {memory} octets");
    }
}

/// Lets this process have so many connections, and tells whether it may.
pub(crate) fn allow_files(count: u64) -> bool {
    let limit = getrlimit(Resource::Nofile);
    if limit.maximum.is_some_and(|maximum| maximum < count) {
        return false;
    }
    let current = Some(count.max(limit.current.unwrap_or(count)));
    setrlimit(Resource::Nofile, Rlimit { current, ..limit }).is_ok()
}

/// A letter in XML around an envelope with this inside.
fn envelope(inside: &str) -> String {
    format!("<?xml version=\"1.0\"?><envelope><params index=\"1\">{inside}</params></envelope>")
}

/// A letter in XML from nobody to agents that match a pattern.
fn letter_to(pattern: &str) -> String {
    let agent = |name: &str| format!("<agent-identifier><name>{name}</name></agent-identifier>");
    let slots = format!(
        "<to>{to}</to><from>{from}</from>\
         <acl-representation>fipa.acl.rep.string.std</acl-representation>\
         <date>20260101Z120000000</date><intended-receiver>{to}</intended-receiver>",
        to = agent(pattern),
        from = agent("stranger"),
    );
    envelope(&slots) + "(inform :content x)"
}

#[test]
fn octets_that_are_no_letter_harm_nobody() {
    let battle = Battle::begin();
    let before = battle.round_trip();
    let mut random = scramble(1);
    for _ in 0..200 {
        battle.say_anything(&mut random);
    }
    battle.check("arbitrary octets", before);
}

#[test]
fn letters_that_announce_too_much_or_nest_too_deeply_cost_no_memory() {
    let battle = Battle::begin();
    let before = battle.round_trip();
    for _ in 0..20 {
        battle.claim_much();
    }
    battle.check("letters that claim 4 GiB", before);
    battle.nest_deeply();
    battle.check("a million nested elements", before);
}

#[test]
fn patterns_that_are_meant_to_blow_up_do_not() {
    let battle = Battle::begin();
    let before = battle.round_trip();
    for _ in 0..10 {
        battle.send_to_patterns();
    }
    battle.check("patterns", before);
}

#[test]
fn half_letters_and_silent_connections_do_not_keep_others_out() {
    assert!(
        allow_files(SILENT as u64 + 500),
        "{SILENT} connections are not allowed"
    );
    let battle = Battle::begin();
    let before = battle.round_trip();
    let mut open = Vec::new();
    for n in 0..SILENT {
        let mut stream = battle.connect();
        if n % 4 == 0 {
            let _ = stream.write_all(b"\xfe\x00\x10half a letter");
        }
        open.push(stream);
    }
    battle.check(&format!("{SILENT} silent connections"), before);
}

/// The command with a limit on the files that it may open.
fn with_few_files(command: Command) -> Command {
    let mut limited = Command::new("sh");
    let script = "ulimit -n 64 && exec \"$@\"";
    limited.args(["-c", script, "sh"]);
    limited.arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => limited.env(name, value),
            None => limited.env_remove(name),
        };
    }
    limited
}

#[test]
fn a_daemon_that_may_open_no_more_files_goes_on_and_takes_connections_when_it_may_again() {
    let battle = Battle::begin_with(with_few_files);
    let before = battle.round_trip();
    let open: Vec<TcpStream> = (0..200).map(|_| battle.connect()).collect();
    let files = || {
        let files = std::fs::read_dir(format!("/proc/{}/fd", battle.daemon.id()));
        files.unwrap().count()
    };
    let until = Instant::now() + PATIENCE;
    while files() < 64 && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!((64..80).contains(&files()), "{} files", files());
    battle.check("no files left", before);
    drop(open);
    let _echo = battle.daemon.attach("echo", "echo2@robot2");
    battle.check("files again", before);
}

#[test]
fn an_agent_that_never_reads_costs_others_nothing() {
    let battle = Battle::begin();
    let before = battle.round_trip();
    let platform = Platform::attach_to(&battle.daemon.control).unwrap();
    let _deaf = platform.agent("deaf@robot2").unwrap();
    let sender = platform.agent("sender@robot2").unwrap();
    let content = "x".repeat(10_000);
    let mut full = false;
    for _ in 0..20_000 {
        let message = Message::new(Performative::Inform).to("deaf@robot2");
        full |= sender.try_send(message.content(content.clone())).is_err();
    }
    assert!(
        full,
        "there is no end to what an agent may send to one that never reads"
    );
    battle.check("an agent that never reads", before);
}

#[test]
fn what_strangers_do_again_and_again_is_logged_ten_times_a_minute_and_then_counted() {
    let logged = logged_of_a_hundred("warn,fipa=info");
    assert_eq!(count(&logged, "neither a link nor a letter begins"), 10);
    let left_out = "90 more notices about tcp://127.0.0.1 within a minute are left out";
    assert_eq!(count(&logged, left_out), 1, "{logged:?}");
}

#[test]
fn nothing_is_left_out_for_who_looks_for_a_fault() {
    let logged = logged_of_a_hundred("warn,fipa=debug");
    assert_eq!(count(&logged, "neither a link nor a letter begins"), 100);
}

fn count(logged: &[String], what: &str) -> usize {
    logged.iter().filter(|line| line.contains(what)).count()
}

/// What a daemon logs, at these levels, of a hundred strangers who say something wrong.
fn logged_of_a_hundred(levels: &str) -> Vec<String> {
    let place = Place::new();
    let mut command = place.fipad("robot1");
    command.env("FIPA_LOG", levels).arg("--no-mdns");
    let daemon = Daemon::start(command);
    let endpoint = daemon.endpoint().trim_start_matches("tcp://");
    for _ in 0..100 {
        let mut stranger = TcpStream::connect(endpoint).unwrap();
        stranger.write_all(b"x").unwrap();
        let _ = std::io::copy(&mut stranger, &mut std::io::sink());
    }
    daemon.signal(Signal::TERM);
    daemon.into_process().wait().errors
}

/// Numbers that look random, the same each time.
pub(crate) fn scramble(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        state >> 33
    }
}
