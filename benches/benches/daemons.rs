//! Agent – daemon – daemon – agent and back beside plain relays between as many processes, and
//! agents of two platforms in one process beside a plain ping-pong, in one run. Between daemons
//! of a fleet, over TLS, the same once more.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fipa::prelude::*;
use fipa_benches::daemons::{self, Daemon};
use fipa_benches::plain;
use fipa_benches::relay::{self, Relay};
use fipa_benches::table::Times;

/// Rounds of all, one after the other; round trips that are timed in each, letters under way where
/// the rate is measured, and for how long.
const ROUNDS: usize = 5;
const COUNT: usize = 2_000;
const WINDOW: usize = 256;
const SPAN: Duration = Duration::from_millis(600);

/// Octets of the contents.
const CONTENTS: [usize; 2] = [100, 64 << 10];

fn main() -> ExitCode {
    if daemons::is_daemon() {
        return fipa_daemon::main();
    }
    if let Some(to) = relay::is_relay() {
        relay::run(&to);
        return ExitCode::SUCCESS;
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .expect("a runtime");
    println!("content  path                            p50 us    p99 us  letters/s  p50/plain");
    runtime.block_on(async {
        between_daemons().await;
        in_one_process().await;
    });
    ExitCode::SUCCESS
}

async fn between_daemons() {
    let (_plain, agent) = pair(Daemon::start).await;
    let (_secured, secured) = pair(Daemon::start_in_fleet).await;
    let end = Relay::start(&plain::echo_server().to_string());
    let relay = Relay::start(end.address());
    let address = relay.address().parse().expect("an address");
    let paths = [
        ("agent-daemon-daemon-agent", &agent),
        ("the same over TLS", &secured),
    ];
    compare("plain, two relays between", address, &paths).await;
}

/// Two daemons with agents, and the one that asks.
async fn pair(start: fn(&Path, &str, &[&str]) -> Daemon) -> (Pair, Arc<Agent>) {
    let folder = tempfile::tempdir().expect("a folder");
    let two = start(folder.path(), "robot2", &[]);
    let one = start(folder.path(), "robot1", &[two.endpoint()]);
    serve(two.control().to_owned());
    let platform = Platform::attach_to(one.control()).await.expect("robot1");
    let agent = platform.agent("client@robot1").await.expect("an agent");
    wait_for(&platform).await;
    (([one, two], folder, platform), Arc::new(agent))
}

/// What a pair lives by.
type Pair = ([Daemon; 2], tempfile::TempDir, Platform);

async fn in_one_process() {
    let two = Platform::builder().name("robot2").mdns(false).start().await;
    let two = two.expect("robot2");
    let one = Platform::builder().name("robot1").mdns(false);
    let one = one.peer(two.endpoints()[0].to_string()).start().await;
    let one = one.expect("robot1");
    let agent = Arc::new(one.agent("client@robot1").await.expect("an agent"));
    tokio::spawn(answer(two));
    wait_for(&one).await;
    let address = plain::echo_here().await;
    let paths = [("platform-platform", &agent)];
    compare("plain ping-pong", address, &paths).await;
}

async fn wait_for(platform: &Platform) {
    for name in ["echo@robot2", "sink@robot2"] {
        platform.wait_for(name).await.expect("found");
    }
}

/// What was measured in one round.
struct Round {
    times: Times,
    rate: f64,
}

async fn compare(name: &str, plain: std::net::SocketAddr, paths: &[(&str, &Arc<Agent>)]) {
    for octets in CONTENTS {
        let mut plainly: Vec<Round> = Vec::new();
        let mut rounds: Vec<Vec<Round>> = paths.iter().map(|_| Vec::new()).collect();
        for _ in 0..ROUNDS {
            plainly.push(Round {
                times: plain::round_trips(plain, octets, COUNT).await,
                rate: plain::rate(plain, octets, WINDOW.min(16), SPAN).await,
            });
            for ((_, agent), rounds) in paths.iter().zip(&mut rounds) {
                rounds.push(Round {
                    times: round_trips(agent, octets).await,
                    rate: rate_of(agent, octets).await,
                });
            }
        }
        row(octets, name, &plainly, 1.0);
        for ((path, _), ours) in paths.iter().zip(&rounds) {
            let pairs = plainly.iter().zip(ours);
            let ratio =
                pairs.map(|(plain, ours)| ours.times.percentile(0.5) / plain.times.percentile(0.5));
            row(octets, path, ours, median(ratio));
        }
    }
}

fn row(octets: usize, path: &str, rounds: &[Round], ratio: f64) {
    let percentile = |share| median(rounds.iter().map(|round| round.times.percentile(share)));
    let (p50, p99) = (percentile(0.5), percentile(0.99));
    let rate = median(rounds.iter().map(|round| round.rate));
    println!("{octets:7}  {path:30} {p50:7.1}  {p99:8.1}  {rate:9.0}  {ratio:9.2}");
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The agents of the other robot, on a thread of their own.
fn serve(control: std::path::PathBuf) {
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(async move {
            answer(Platform::attach_to(control).await.expect("robot2")).await;
        });
    });
}

/// An agent that answers, and one that takes what comes.
async fn answer(platform: Platform) {
    let echo = Arc::new(platform.agent("echo@robot2").await.expect("an agent"));
    let sink = platform.agent("sink@robot2").await.expect("an agent");
    tokio::spawn(async move { while sink.receive().await.is_ok() {} });
    while let Ok(query) = echo.receive().await {
        let mut answer = query.reply(Performative::Inform);
        answer.content = query.content;
        let echo = Arc::clone(&echo);
        tokio::spawn(async move { echo.send(answer).await });
    }
}

async fn round_trips(agent: &Agent, octets: usize) -> Times {
    let mut times = Vec::with_capacity(COUNT);
    for _ in 0..COUNT {
        let query = Message::new(Performative::QueryRef)
            .to("echo@robot2")
            .content(vec![b'x'; octets]);
        let start = Instant::now();
        agent
            .request(query, Duration::from_secs(5))
            .await
            .expect("an answer");
        times.push(start.elapsed());
    }
    Times::new(times)
}

/// Letters a second that were delivered, and reported so.
async fn rate_of(agent: &Arc<Agent>, octets: usize) -> f64 {
    let content = bytes::Bytes::from(vec![b'x'; octets]);
    let mut under_way = tokio::task::JoinSet::new();
    let mut delivered = 0_usize;
    let start = Instant::now();
    while start.elapsed() < SPAN || !under_way.is_empty() {
        while under_way.len() < WINDOW && start.elapsed() < SPAN {
            let letter = Message::new(Performative::Inform)
                .to("sink@robot2")
                .content(content.clone());
            let agent = Arc::clone(agent);
            under_way.spawn(async move { agent.send(letter).await });
        }
        if let Some(sent) = under_way.join_next().await {
            let outcomes = sent.expect("sent");
            assert!(outcomes.iter().all(|o| o.outcome == Outcome::Delivered));
            delivered += 1;
        }
    }
    delivered as f64 / start.elapsed().as_secs_f64()
}
