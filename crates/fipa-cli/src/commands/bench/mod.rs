//! `fipa bench`: what the link to another robot gives, by each transport, beside bare sockets over
//! the same network in the same run; for QUIC these are connections of `quinn`, with one stream.
//!
//! The other robot runs `fipa bench --serve`. No daemon has a part in it: both ends are platforms of
//! their own, as a daemon is one.

mod client;
mod server;

use std::net::SocketAddr;
use std::time::Duration;

use serde_json::{Value, json};

use self::client::Peer;
use self::server::Server;
use crate::Failure;
use crate::attached::{self, print_json, print_line};
use crate::times::{Times, rounded};

/// The options of `fipa bench`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Where `fipa bench --serve` runs, HOST:PORT; without it both ends are on this machine
    #[arg(value_name = "PEER", conflicts_with = "serve")]
    peer: Option<String>,
    /// Be the other end, at this address, until interrupted
    #[arg(long, value_name = "HOST:PORT")]
    serve: Option<String>,
    /// Measure this transport; can be given again. Default: all
    #[arg(long = "transport", value_name = "NAME", conflicts_with = "serve")]
    transports: Vec<Transport>,
    /// Seconds for each of the three figures, in each of three rounds
    #[arg(long, value_name = "S", default_value = "0.5", value_parser = attached::seconds, conflicts_with = "serve")]
    seconds: Duration,
    /// One JSON object a line
    #[arg(long)]
    json: bool,
}

/// How letters travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Transport {
    Tcp,
    Quic,
    Http,
}

impl Transport {
    const ALL: [Transport; 3] = [Transport::Tcp, Transport::Quic, Transport::Http];

    fn name(self) -> &'static str {
        match self {
            Transport::Tcp => "tcp",
            Transport::Quic => "quic",
            Transport::Http => "http",
        }
    }
}

/// Rounds, of which the middle figure counts.
const ROUNDS: usize = 3;

/// Octets of the content that goes to and fro, of the letters that are counted, and of the large
/// ones; and how many of these are under way at once.
const PING: usize = 100;
const SMALL: usize = 256;
const LARGE: usize = 1 << 20;
const SMALL_WINDOW: u64 = 256;
const LARGE_WINDOW: u64 = 4;

/// What one way of sending gave in one round.
#[derive(Clone, Debug, Default)]
struct Figures {
    times: Times,
    /// Letters of 256 octets a second.
    letters: f64,
    /// Millions of octets a second, in letters of 1 MiB.
    megabytes: f64,
}

/// Measures, or serves.
///
/// # Errors
/// Exit code 1 if letters were lost, 2 for wrong usage, 3 if nobody serves there.
pub fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        match &args.serve {
            Some(endpoint) => serve(endpoint, args.json).await,
            None => measure(args).await,
        }
    })
}

async fn serve(endpoint: &str, json: bool) -> Result<(), Failure> {
    let interrupted = attached::interrupted()?;
    let server = Server::bind(endpoint).await?;
    let address = server.address();
    match json {
        true => print_json(&json!({"event": "ready", "address": address.to_string()}))?,
        false => print_line(format_args!(
            "ready; on the other robot: fipa bench {address}"
        ))?,
    }
    tokio::select! {
        ended = server.run() => ended,
        () = interrupted => Ok(()),
    }
}

async fn measure(args: &Args) -> Result<(), Failure> {
    let peer = match &args.peer {
        Some(peer) => peer.clone(),
        None => own_server()?.to_string(),
    };
    let peer = Peer::find(&peer).await?;
    let wanted = match args.transports.is_empty() {
        true => &Transport::ALL[..],
        false => &args.transports,
    };
    if !args.json {
        print_line(
            "            round trip in us      letters/s      MB/s    beside a bare socket",
        )?;
        print_line("                p50       p99")?;
    }
    let mut failures = Vec::new();
    for transport in wanted {
        let mut client = peer.client(*transport).await?;
        let (mut bare, mut ours) = (Vec::new(), Vec::new());
        for _ in 0..ROUNDS {
            bare.push(peer.bare(*transport, args.seconds).await?);
            ours.push(client.measure(args.seconds).await);
        }
        report(args.json, transport.name(), &middle(&ours), &middle(&bare))?;
        if let Some(failure) = client.failure() {
            failures.push(format!("{}: {failure}", transport.name()));
        }
    }
    match failures.is_empty() {
        true => Ok(()),
        false => Err(Failure::no(failures.join("; "))),
    }
}

/// The other end on this machine, in a thread of its own.
fn own_server() -> Result<SocketAddr, Failure> {
    let (sender, address) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        attached::run(async {
            let server = Server::bind("127.0.0.1:0").await;
            let server = match server {
                Ok(server) => server,
                Err(failure) => {
                    // Whoever waits hears of it, or has gone.
                    let _ = sender.send(Err(failure));
                    return Ok(());
                }
            };
            let _ = sender.send(Ok(server.address()));
            server.run().await
        })
    });
    address.recv().map_err(Failure::environment)?
}

/// Of each figure, the middle one of the rounds.
fn middle(rounds: &[Figures]) -> Figures {
    let of = |figure: fn(&Figures) -> f64| {
        let figures: Times = rounds.iter().map(figure).collect();
        figures.percentile(0.5).unwrap_or_default()
    };
    let median = |round: &&Figures| round.times.percentile(0.5).unwrap_or(f64::MAX);
    let mut by_time: Vec<&Figures> = rounds.iter().collect();
    by_time.sort_by(|a, b| median(a).total_cmp(&median(b)));
    let times = by_time.get(by_time.len() / 2).map(|round| &round.times);
    Figures {
        times: times.cloned().unwrap_or_default(),
        letters: of(|round| round.letters),
        megabytes: of(|round| round.megabytes),
    }
}

fn report(json: bool, name: &str, ours: &Figures, bare: &Figures) -> Result<(), Failure> {
    let time = |figures: &Figures, share| figures.times.percentile(share).unwrap_or(f64::NAN);
    let ratio = |ours: f64, bare: f64| (ours / bare * 1000.0).round() / 1000.0;
    let ratios = [
        ratio(time(ours, 0.5), time(bare, 0.5)),
        ratio(ours.letters, bare.letters),
        ratio(ours.megabytes, bare.megabytes),
    ];
    if json {
        let mut line = to_json(ours);
        line["transport"] = json!(name);
        line["raw"] = to_json(bare);
        line["ratio"] = json!({
            "rtt": number(ratios[0]), "letters": number(ratios[1]), "mb": number(ratios[2]),
        });
        return print_json(&line);
    }
    let row = |name: &str, figures: &Figures| {
        format!(
            "{name:10} {:8.1}  {:8.1}  {:12.0}  {:8.1}",
            time(figures, 0.5),
            time(figures, 0.99),
            figures.letters,
            figures.megabytes
        )
    };
    print_line(row("(bare)", bare))?;
    let [time, letters, megabytes] = ratios;
    print_line(format_args!(
        "{}    {time} x the time, {letters} x the letters, {megabytes} x the MB",
        row(name, ours)
    ))
}

fn to_json(figures: &Figures) -> Value {
    json!({
        "rtt_us": figures.times.to_json(),
        "letters_per_second": rounded(figures.letters),
        "mb_per_second": rounded(figures.megabytes),
    })
}

/// JSON has no word for what is not a number.
fn number(ratio: f64) -> Value {
    match ratio.is_finite() {
        true => json!(ratio),
        false => Value::Null,
    }
}
