//! What attacks cost others, in figures.

use std::io::Write;
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use fipa::blocking::{Agent, Platform};
use fipa::{Message, Performative};
use serde_json::Value;
use socket2::{Domain, Socket, Type};

use crate::hostile::{Battle, allow_files, scramble};
use crate::support::process::Process;

/// Silent connections that each of two processes opens.
const SILENT: u16 = 5000;

/// The pause between two rounds of an attack.
const PAUSE: Duration = Duration::from_millis(5);

/// How long a measurement may take on a machine that has much else to do.
const AT_MOST: Duration = Duration::from_secs(120);

/// Connections with half a letter.
const HALVES: usize = 500;

/// Tells a process of this very test that it is to open silent connections, and to whom.
const TO: &str = "FIPA_TEST_SILENT_TO";

/// An attack: its name, and what it does until it is told to stop, after it has said that it is
/// under way.
type Attack = (&'static str, fn(&Battle, &Stop));

/// When an attack is under way, and when it is over.
#[derive(Default)]
struct Stop {
    under_way: AtomicBool,
    over: AtomicBool,
}

impl Stop {
    /// Does something again and again, two hundred times a second at most: who has more connections
    /// to spare than a daemon can take fills the machine, whatever the daemon does.
    fn repeat(&self, mut round: impl FnMut()) {
        while !self.over.load(Ordering::Relaxed) {
            round();
            std::thread::sleep(PAUSE);
            self.under_way.store(true, Ordering::Relaxed);
        }
    }

    /// Does something once the attack is under way, and ends it.
    fn after_begin<T>(&self, act: impl FnOnce() -> T) -> T {
        while !self.under_way.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let over = std::panic::catch_unwind(std::panic::AssertUnwindSafe(act));
        self.over.store(true, Ordering::Relaxed);
        over.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }

    /// Holds something.
    fn hold(&self) {
        self.repeat(|| ());
    }
}

const ATTACKS: &[Attack] = &[
    ("nothing", |_, stop| stop.hold()),
    ("arbitrary octets", |battle, stop| {
        let mut random = scramble(1);
        stop.repeat(|| battle.say_anything(&mut random));
    }),
    ("half a letter and a stall", |battle, stop| {
        let half = || {
            let mut stream = battle.connect();
            let _ = stream.write_all(b"\xfe\x00\x10half a letter");
            stream
        };
        let _open: Vec<TcpStream> = (0..HALVES).map(|_| half()).collect();
        stop.hold();
    }),
    ("10,000 silent connections", |battle, stop| {
        let _processes = [0, 1].map(|n| silent(battle, n));
        stop.hold();
    }),
    ("letters that claim 4 GiB", |battle, stop| {
        stop.repeat(|| battle.claim_much());
    }),
    ("a million nested elements", |battle, stop| {
        stop.repeat(|| battle.nest_deeply());
    }),
    ("patterns", |battle, stop| {
        stop.repeat(|| battle.send_to_patterns());
    }),
    ("an agent that never reads", |battle, stop| {
        let platform = Platform::attach_to(&battle.daemon.control).unwrap();
        let _deaf = platform.agent("deaf@robot2").unwrap();
        let sender = platform.agent("sender@robot2").unwrap();
        stop.repeat(|| flood(&sender));
    }),
];

fn flood(sender: &Agent) {
    for _ in 0..100 {
        let message = Message::new(Performative::Inform).to("deaf@robot2");
        let _ = sender.try_send(message.content("x".repeat(10_000)));
    }
}

/// A process with silent connections, when all are open.
fn silent(battle: &Battle, number: u8) -> Process {
    let mut command = Command::new(std::env::current_exe().unwrap());
    let name = "attacks::opens_silent_connections";
    command.args(["--exact", name, "--ignored", "--nocapture"]);
    let endpoint = battle.daemon.endpoint().trim_start_matches("tcp://");
    command.env(TO, format!("{endpoint} {number}"));
    let mut process = Process::start(command);
    while !process.line().ends_with("open") {}
    process
}

/// Not a test: what [`silent`] starts. Each address of the network 127.0.0.0/8 is somebody else to the
/// daemon, which lets in a thousand connections of each.
#[test]
#[ignore = "opens connections until its input ends, for another test"]
fn opens_silent_connections() {
    let Ok(to) = std::env::var(TO) else {
        return;
    };
    let (endpoint, number) = to.split_once(' ').unwrap();
    let (endpoint, number): (SocketAddr, u8) = (endpoint.parse().unwrap(), number.parse().unwrap());
    assert!(allow_files(u64::from(SILENT) + 100), "not allowed");
    let open = |n: u16| {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
        let address = Ipv4Addr::new(127, 1, number, 1 + (n / 500) as u8);
        socket.bind(&SocketAddr::from((address, 0)).into()).unwrap();
        socket.connect(&endpoint.into()).unwrap();
        socket
    };
    let open: Vec<Socket> = (0..SILENT).map(open).collect();
    println!("{} are open", open.len());
    let _ = std::io::stdin().read_line(&mut String::new());
}

/// `fipa ping` from one daemon to the other.
fn ping(battle: &Battle) -> Command {
    let words = ["ping", "echo@robot2", "--count", "500", "--json"];
    let mut command = battle.other.fipa(&words);
    command.args(["--timeout", "10"]);
    command
}

/// The times that it measures.
fn measure(ping: Command) -> Value {
    let mut process = Process::start(ping);
    process.close_input();
    let ended = process.wait_within(AT_MOST);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    ended.only_json()["rtt_us"].clone()
}

/// `cargo test --release --test network -- --ignored --nocapture figures`
#[test]
#[ignore = "prints figures, for a machine that does nothing else"]
fn figures_of_what_attacks_cost_others() {
    println!(
        "{:28} {:>9} {:>9} {:>7} {:>9} {:>9} {:>9} {:>9}",
        "round trip in us, memory in KiB",
        "before",
        "during",
        "ratio",
        "p99",
        "p99",
        "memory",
        "peak"
    );
    for (name, attack) in ATTACKS {
        let battle = Battle::begin();
        measure(ping(&battle));
        let before = measure(ping(&battle));
        let (stop, ping) = (Stop::default(), ping(&battle));
        let during = std::thread::scope(|scope| {
            let measuring = scope.spawn(|| stop.after_begin(|| measure(ping)));
            attack(&battle, &stop);
            measuring.join().unwrap()
        });
        let of = |times: &Value, what: &str| times[what].as_f64().unwrap();
        let (one, two) = (of(&before, "p50"), of(&during, "p50"));
        println!(
            "{name:31} {one:9.0} {two:9.0} {:7.2} {:9.0} {:9.0} {:9} {:9}",
            two / one,
            of(&before, "p99"),
            of(&during, "p99"),
            battle.memory_of("VmRSS:") >> 10,
            battle.memory_of("VmHWM:") >> 10
        );
    }
}
