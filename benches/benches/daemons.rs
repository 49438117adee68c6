//! Agent – daemon – daemon – agent and back, beside a plain TCP echo, in one run.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fipa::prelude::*;
use fipa_benches::daemons::{self, Daemon};
use fipa_benches::plain;
use fipa_benches::table::Times;

/// Round trips that are timed, and letters under way where the rate is measured.
const COUNT: usize = 5_000;
const WINDOW: usize = 256;
const SPAN: Duration = Duration::from_secs(3);

fn main() -> ExitCode {
    if daemons::is_daemon() {
        return fipa_daemon::main();
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .expect("a runtime");
    runtime.block_on(measure());
    ExitCode::SUCCESS
}

async fn measure() {
    let folder = tempfile::tempdir().expect("a folder");
    let two = Daemon::start(folder.path(), "robot2", &[]);
    let one = Daemon::start(folder.path(), "robot1", &[two.endpoint()]);
    serve(two.control().to_owned());
    let platform = Platform::attach_to(one.control()).await.expect("robot1");
    let agent = Arc::new(platform.agent("client@robot1").await.expect("an agent"));
    for name in ["echo@robot2", "sink@robot2"] {
        platform.wait_for(name).await.expect("found");
    }
    let echo = plain::echo_server();

    println!("content    link                       p50 us    p99 us   letters/s");
    for octets in [100, 64 << 10] {
        let times = plain::round_trips(echo, octets, COUNT).await;
        let rate = plain::rate(echo, octets, WINDOW.min(16), SPAN).await;
        row(octets, "plain TCP echo", &times, rate);
        let times = round_trips(&agent, octets).await;
        let rate = rate_of(&agent, octets).await;
        row(octets, "agent-daemon-daemon-agent", &times, rate);
    }
}

fn row(octets: usize, link: &str, times: &Times, rate: f64) {
    let (p50, p99) = (times.percentile(0.5), times.percentile(0.99));
    println!("{octets:7}    {link:25} {p50:8.1}  {p99:8.1}  {rate:10.0}");
}

/// The agents of the other robot, on a thread of their own.
fn serve(control: std::path::PathBuf) {
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(async move {
            let platform = Platform::attach_to(control).await.expect("robot2");
            let echo = Arc::new(platform.agent("echo@robot2").await.expect("an agent"));
            let sink = platform.agent("sink@robot2").await.expect("an agent");
            tokio::spawn(async move { while sink.receive().await.is_ok() {} });
            while let Ok(query) = echo.receive().await {
                let mut answer = query.reply(Performative::Inform);
                answer.content = query.content;
                let echo = Arc::clone(&echo);
                tokio::spawn(async move { echo.send(answer).await });
            }
        });
    });
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
    let content = vec![b'x'; octets];
    let content: &'static [u8] = Box::leak(content.into_boxed_slice());
    let mut under_way = tokio::task::JoinSet::new();
    let mut delivered = 0_usize;
    let start = Instant::now();
    while start.elapsed() < SPAN || !under_way.is_empty() {
        while under_way.len() < WINDOW && start.elapsed() < SPAN {
            let letter = Message::new(Performative::Inform)
                .to("sink@robot2")
                .content(content);
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
