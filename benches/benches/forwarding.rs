//! What a daemon in the middle passes on, beside a plain relay of length-prefixed pieces, in one
//! run; and what its agents and links cost while nothing happens.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use fipa::Platform;
use fipa_benches::daemons::{self, Daemon};
use fipa_benches::partner::{self, Partner};
use fipa_benches::relay::{self, Relay};

/// Octets of a letter or piece, how many go in a round, and how many may be without a receipt.
const LETTERS: [(usize, usize, usize); 3] = [
    (256, 200_000, 8_192),
    (1 << 10, 100_000, 8_192),
    (1 << 20, 400, 16),
];

/// Each runs both, one after the other.
const ROUNDS: usize = 5;

/// The agent that takes the letters.
const SINK: &str = "sink@bench";

/// Octets that are written at once.
const BATCH: usize = 64 << 10;

/// Agents and links that do nothing. More links of one address are not let in.
const IDLE_AGENTS: usize = 10_000;
const IDLE_LINKS: usize = 1_000;

fn main() -> ExitCode {
    if daemons::is_daemon() {
        return fipa_daemon::main();
    }
    if let Some(to) = relay::is_relay() {
        relay::run(&to);
        return ExitCode::SUCCESS;
    }
    println!("one way, octets      relay/s     daemon/s   daemon MB/s   daemon/relay   ns of each");
    for (octets, count, window) in LETTERS {
        compare(octets, count, window);
    }
    idle_agents();
    idle_links();
    ExitCode::SUCCESS
}

fn compare(octets: usize, count: usize, window: usize) {
    let folder = tempfile::tempdir().expect("a folder");
    let end = TcpListener::bind("127.0.0.1:0").expect("a port");
    let relay = Relay::start(&end.local_addr().expect("bound").to_string());
    let daemon = Daemon::start(folder.path(), "middle", &[]);
    let mut sink = Partner::greet(daemon.endpoint(), "sink", SINK);
    let mut source = Partner::greet(daemon.endpoint(), "source", "source@bench");
    // What the sink has is known in the middle.
    thread::sleep(Duration::from_millis(100));
    let mut number = 0;
    let mut round = || {
        let plain = Passed::during(relay.process(), count, || {
            through_relay(&relay, &end, octets, count);
        });
        let ours = Passed::during(daemon.process(), count, || {
            through_daemon(&mut source, &mut sink, octets, count, window, &mut number);
        });
        (plain, ours)
    };
    // The first round makes buffers.
    round();
    let rounds: Vec<(Passed, Passed)> = (0..ROUNDS).map(|_| round()).collect();
    let median = |of: fn(&(Passed, Passed)) -> f64| {
        let mut values: Vec<f64> = rounds.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let (plain, ours) = (median(|r| r.0.rate), median(|r| r.1.rate));
    let (mega, ratio) = (ours * octets as f64 / 1e6, median(|r| r.1.rate / r.0.rate));
    let (plain_work, our_work) = (median(|r| r.0.work), median(|r| r.1.work));
    println!(
        "{octets:15} {plain:12.0} {ours:12.0}  {mega:12.1}  {ratio:13.2}   {plain_work:.0} {our_work:.0}"
    );
}

/// What one round has shown.
struct Passed {
    /// Letters or pieces a second.
    rate: f64,
    /// Nanoseconds of a processor that the one in the middle took for each, its system calls
    /// included: on a machine that others use too, that says more than the rate.
    work: f64,
}

impl Passed {
    fn during(process: u32, count: usize, pass: impl FnOnce()) -> Passed {
        let (start, before) = (Instant::now(), processor_time(process));
        pass();
        Passed {
            rate: count as f64 / start.elapsed().as_secs_f64(),
            work: (processor_time(process) - before) / count as f64,
        }
    }
}

/// Nanoseconds that the only thread of a process has run.
fn processor_time(process: u32) -> f64 {
    let told = std::fs::read_to_string(format!("/proc/{process}/schedstat"));
    let told = told.expect("the system tells");
    let number = told.split_whitespace().next();
    number
        .and_then(|number| number.parse().ok())
        .expect("a number")
}

fn through_relay(relay: &Relay, end: &TcpListener, octets: usize, count: usize) {
    let mut source = TcpStream::connect(relay.address()).expect("the relay");
    let (mut sink, _) = end.accept().expect("the relay");
    let mut piece = vec![b'x'; 4 + octets];
    piece[..4].copy_from_slice(&(octets as u32).to_be_bytes());
    let mut left = count * piece.len();
    thread::scope(|scope| {
        scope.spawn(|| write_pieces(&mut source, &mut piece, count, |_, _| ()));
        let mut buffer = vec![0; BATCH];
        while left > 0 {
            left -= sink.read(&mut buffer).expect("the relay").min(left);
        }
    });
}

fn through_daemon(
    source: &mut Partner,
    sink: &mut Partner,
    octets: usize,
    count: usize,
    window: usize,
    number: &mut u64,
) {
    let mut letter = partner::letter_frame(SINK, octets);
    let mut writer = source.writer();
    let receipts = AtomicUsize::new(0);
    let begin = *number;
    *number += count as u64;
    thread::scope(|scope| {
        scope.spawn(|| sink.take_letters(count, SINK));
        let writing = thread::current();
        let receipts = &receipts;
        scope.spawn(move || {
            source.await_receipts(count, || {
                receipts.fetch_add(1, Ordering::Release);
                writing.unpark();
            });
        });
        write_pieces(&mut writer, &mut letter, count, |piece, written| {
            while written - receipts.load(Ordering::Acquire) >= window {
                thread::park();
            }
            let id = begin + written as u64;
            piece[partner::NUMBER].copy_from_slice(&id.to_be_bytes());
        });
    });
}

/// Writes so many pieces, as many at once as fit into a batch.
fn write_pieces(
    stream: &mut TcpStream,
    piece: &mut [u8],
    count: usize,
    mut prepare: impl FnMut(&mut [u8], usize),
) {
    let mut batch = Vec::with_capacity(BATCH);
    for written in 0..count {
        prepare(piece, written);
        if batch.len() + piece.len() > BATCH {
            stream.write_all(&batch).expect("written");
            batch.clear();
        }
        match piece.len() > BATCH {
            true => stream.write_all(piece).expect("written"),
            false => batch.extend_from_slice(piece),
        }
    }
    stream.write_all(&batch).expect("written");
}

fn idle_agents() {
    let folder = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(folder.path(), "idle", &[]);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .expect("a runtime");
    runtime.block_on(async {
        let platform = Platform::attach_to(daemon.control()).await.expect("idle");
        let before = resident(&daemon);
        let mut agents = Vec::with_capacity(IDLE_AGENTS);
        for number in 0..IDLE_AGENTS {
            let agent = platform.agent(format!("agent{number}@idle")).await;
            agents.push(agent.expect("an agent"));
        }
        tell("idle agent", resident(&daemon) - before, IDLE_AGENTS);
    });
}

fn idle_links() {
    let folder = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(folder.path(), "idle", &[]);
    let greet = |number: usize| {
        let name = format!("peer{number}").leak();
        Partner::greet(daemon.endpoint(), name, name)
    };
    let _first = greet(IDLE_LINKS);
    let before = resident(&daemon);
    let _links: Vec<Partner> = (0..IDLE_LINKS).map(greet).collect();
    thread::sleep(Duration::from_millis(500));
    tell(
        "idle link with an agent",
        resident(&daemon) - before,
        IDLE_LINKS,
    );
}

fn tell(what: &str, octets: i64, count: usize) {
    let each = octets as f64 / count as f64 / 1024.0;
    println!("{count} x {what}: {each:.2} KB each");
}

/// Octets of memory that the daemon has.
fn resident(daemon: &Daemon) -> i64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", daemon.process()));
    let status = status.expect("the system tells");
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("RssAnon:"));
    let number = line.and_then(|line| line.split_whitespace().next());
    number
        .and_then(|number| number.parse::<i64>().ok())
        .expect("a number")
        * 1024
}
