//! How fast letters are over a bad radio, by each transport and beside a bare socket.
//!
//! A long run that prints tables:
//! `cargo test --release --test network rates -- --ignored --nocapture`.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::thread::spawn;
use std::time::{Duration, Instant};

use fipa::{Agent, AgentId, Message, Outcome, Performative, Platform};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::task::JoinSet;

use crate::support::daemon::{Daemon, Place};
use crate::support::radio::{Quality, Radio};

/// How letters travel: the scheme of the listeners, and how the far agents are reached.
const TRANSPORTS: [(&str, Reach); 3] = [
    ("tcp", Reach::Linked),
    ("quic", Reach::Linked),
    ("http", Reach::Posted),
];

#[derive(Clone, Copy, PartialEq, Eq)]
enum Reach {
    /// One daemon dials the other, and they tell each other of their agents.
    Linked,
    /// Letters are posted to the URL of the other daemon.
    Posted,
}

/// The shares of packets that are lost, each way.
const LOSSES: [f64; 4] = [0.0, 0.01, 0.05, 0.2];

/// How long each packet is under way.
const DELAY: Duration = Duration::from_millis(100);

/// How long round trips are timed, one after the other, and how long letters are counted.
const TIMED: Duration = Duration::from_secs(20);
const COUNTED: Duration = Duration::from_secs(15);

/// How long a letter is waited for, and found out what became of.
const PATIENCE: Duration = Duration::from_secs(60);

/// Octets of what goes to and fro, of the small letters and of the large ones.
const PING: usize = 100;
const SMALL: usize = 256;
const LARGE: usize = 64 << 10;

/// Small and large letters that are under way at once: as many small ones as one agent may have,
/// or as may be posted before the first one is answered.
const WINDOWS: (usize, usize) = (1024, 64);
const POSTED_WINDOWS: (usize, usize) = (64, 16);

/// What one transport gave over one radio.
#[derive(Default)]
struct Figures {
    /// Of a round trip, in milliseconds.
    median: f64,
    p99: f64,
    /// Letters of 256 octets, or octets of that kind, a second.
    letters: f64,
    /// Millions of octets a second, in letters of 64 KiB.
    megabytes: f64,
}

#[test]
#[ignore = "takes a quarter of an hour"]
fn rates_over_radios_that_lose_packets() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let mut rows: BTreeMap<&str, Vec<Figures>> = BTreeMap::new();
    for loss in LOSSES {
        let quality = Quality { loss, delay: DELAY };
        let Some(radio) = Radio::new(quality, 7) else {
            return;
        };
        rows.entry("(bare)").or_default().push(bare(&radio));
        for (name, reach) in TRANSPORTS {
            let Some(radio) = Radio::new(quality, 7) else {
                return;
            };
            let cell = runtime.block_on(Cell::new(radio, name, reach));
            let figures = runtime.block_on(cell.measure());
            rows.entry(name).or_default().push(figures);
        }
    }
    let table = |of: &str, figure: &dyn Fn(&Figures) -> String| {
        println!(
            "\n{of}\npackets lost {:>12} {:>12} {:>12} {:>12}",
            "0 %", "1 %", "5 %", "20 %"
        );
        for (name, figures) in &rows {
            let columns: Vec<String> = figures
                .iter()
                .map(|f| format!("{:>12}", figure(f)))
                .collect();
            println!("{name:12} {}", columns.join(" "));
        }
    };
    table("round trip in ms, median/p99", &|f| {
        format!("{:.0}/{:.0}", f.median, f.p99)
    });
    table("letters of 256 octets a second", &|f| {
        format!("{:.1}", f.letters)
    });
    table("MB a second", &|f| format!("{:.3}", f.megabytes));
}

/// Two daemons that reach each other by one transport, over one radio.
struct Cell {
    reach: Reach,
    client: Arc<Agent>,
    echo: AgentId,
    sink: AgentId,
    arrivals: UnboundedReceiver<(Instant, String)>,
    _platforms: [Platform; 2],
    _daemons: [Daemon; 2],
    _place: Place,
    radio: Radio,
}

impl Cell {
    async fn new(radio: Radio, name: &str, reach: Reach) -> Cell {
        let place = Place::new();
        let start = |number: u8, peer: &[&str]| {
            let host = [&radio.one, &radio.two][usize::from(number - 1)];
            let at = format!("10.0.0.{number}:0");
            let url = format!("{name}://{at}");
            let listen = match reach {
                Reach::Linked => ["--listen", &url],
                Reach::Posted => ["--http", &at],
            };
            let options = [&["--no-mdns"], &listen[..], peer].concat();
            place.start_in(host, &format!("robot{number}"), &options)
        };
        let one = start(1, &[]);
        let peer = match reach {
            Reach::Linked => vec!["--peer", one.endpoint()],
            Reach::Posted => vec![],
        };
        let two = start(2, &peer);
        let near = Platform::attach_to(&one.control).await.unwrap();
        let far = Platform::attach_to(&two.control).await.unwrap();
        let client = near.agent("client@robot1").await.unwrap();
        let echo = far.agent("echo@robot2").await.unwrap();
        let sink = far.agent("sink@robot2").await.unwrap();
        if reach == Reach::Linked {
            let found = tokio::time::timeout(PATIENCE, near.wait_for("sink@robot2")).await;
            found.unwrap().unwrap();
        }
        let named = |name: &str| match reach {
            Reach::Linked => AgentId::new(name),
            Reach::Posted => AgentId::new(name).address(two.ready["http"].as_str().unwrap()),
        };
        let (echo_id, sink_id) = (named("echo@robot2"), named("sink@robot2"));
        tokio::spawn(answer(echo));
        let (sender, arrivals) = unbounded_channel();
        tokio::spawn(async move {
            while let Ok(message) = sink.receive().await {
                let content = message.content_str().unwrap();
                let number = content.split(' ').next().unwrap().to_owned();
                let _ = sender.send((Instant::now(), number));
            }
        });
        Cell {
            reach,
            client: Arc::new(client),
            echo: echo_id,
            sink: sink_id,
            arrivals,
            _platforms: [near, far],
            _daemons: [one, two],
            _place: place,
            radio,
        }
    }

    async fn measure(mut self) -> Figures {
        let windows = match self.reach {
            Reach::Linked => WINDOWS,
            Reach::Posted => POSTED_WINDOWS,
        };
        let times = self.round_trips().await;
        let letters = self.rate(SMALL, windows.0).await;
        let large = self.rate(LARGE, windows.1).await;
        println!("  {} packets lost", self.radio.lost());
        Figures {
            median: percentile(&times, 0.5),
            p99: percentile(&times, 0.99),
            letters,
            megabytes: large * LARGE as f64 / 1e6,
        }
    }

    async fn round_trips(&self) -> Vec<f64> {
        let (mut times, begun) = (Vec::new(), Instant::now());
        while begun.elapsed() < TIMED {
            let query = Message::new(Performative::QueryRef)
                .to(self.echo.clone())
                .content("x".repeat(PING));
            let sent = Instant::now();
            self.client.request(query, PATIENCE).await.unwrap();
            times.push(sent.elapsed().as_secs_f64() * 1e3);
        }
        times
    }

    /// Letters a second that arrived. What senders were told of each must be true.
    async fn rate(&mut self, size: usize, window: usize) -> f64 {
        let (mut under_way, mut told) = (JoinSet::new(), BTreeMap::new());
        let (mut sent, begun) = (0, Instant::now());
        while begun.elapsed() < COUNTED || !under_way.is_empty() {
            while under_way.len() < window && begun.elapsed() < COUNTED {
                let number = format!("{size}.{sent}");
                sent += 1;
                let letter = Message::new(Performative::Inform)
                    .to(self.sink.clone())
                    .content(format!("{number} {}", "x".repeat(size - number.len() - 1)));
                let agent = Arc::clone(&self.client);
                under_way.spawn(async move {
                    let outcome = agent.send_within(letter, PATIENCE).await.remove(0);
                    (number, outcome)
                });
            }
            let (number, outcome) = under_way.join_next().await.unwrap().unwrap();
            told.insert(number, outcome);
        }
        let mut arrived: BTreeMap<String, Instant> = BTreeMap::new();
        // What was handed over is there soon.
        let soon = Duration::from_secs(1);
        while let Ok(Some((at, number))) = tokio::time::timeout(soon, self.arrivals.recv()).await {
            assert!(arrived.insert(number, at).is_none(), "a letter came twice");
        }
        for (number, told) in &told {
            match told.outcome {
                Outcome::Timeout => {}
                outcome => assert!(
                    outcome.is_success() && arrived.contains_key(number),
                    "{told:?}"
                ),
            }
        }
        let unknown = told.values().filter(|told| !told.outcome.is_success());
        println!(
            "  {size}: {sent} sent, {} arrived, {} timeouts, {:?}",
            arrived.len(),
            unknown.count(),
            begun.elapsed()
        );
        let counted = arrived.values().filter(|at| **at - begun <= COUNTED);
        counted.count() as f64 / COUNTED.as_secs_f64()
    }
}

async fn answer(echo: Agent) {
    let echo = Arc::new(echo);
    while let Ok(query) = echo.receive().await {
        let mut answer = query.reply(Performative::Inform);
        answer.content = query.content;
        let echo = Arc::clone(&echo);
        tokio::spawn(async move { echo.send_within(answer, PATIENCE).await });
    }
}

/// What TCP gives without anything of ours.
fn bare(radio: &Radio) -> Figures {
    let listener = radio
        .two
        .run_inside(|| TcpListener::bind("10.0.0.2:0").unwrap());
    let address = listener.local_addr().unwrap();
    let connect = || {
        let stream = radio
            .one
            .run_inside(|| TcpStream::connect(address).unwrap());
        stream.set_nodelay(true).unwrap();
        (stream, listener.accept().unwrap().0)
    };
    let (mut near, mut far) = connect();
    spawn(move || {
        let mut frame = [0; PING];
        while far.read_exact(&mut frame).is_ok() && far.write_all(&frame).is_ok() {}
    });
    let (mut times, begun) = (Vec::new(), Instant::now());
    let mut frame = [0; PING];
    while begun.elapsed() < TIMED {
        let sent = Instant::now();
        near.write_all(&frame).unwrap();
        near.read_exact(&mut frame).unwrap();
        times.push(sent.elapsed().as_secs_f64() * 1e3);
    }
    let (mut near, mut far) = connect();
    spawn(move || while near.write_all(&[0; LARGE]).is_ok() {});
    let (mut octets, begun) = (0, Instant::now());
    let mut buffer = vec![0; LARGE];
    far.set_read_timeout(Some(COUNTED)).unwrap();
    while begun.elapsed() < COUNTED {
        octets += far.read(&mut buffer).unwrap_or_default();
    }
    let rate = octets as f64 / COUNTED.as_secs_f64();
    Figures {
        median: percentile(&times, 0.5),
        p99: percentile(&times, 0.99),
        letters: rate / SMALL as f64,
        megabytes: rate / 1e6,
    }
}

fn percentile(times: &[f64], share: f64) -> f64 {
    let mut times = times.to_vec();
    times.sort_by(f64::total_cmp);
    times[((times.len() - 1) as f64 * share).round() as usize]
}
