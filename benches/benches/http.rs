//! Conversations over HTTP between the agents of two processes, one by one and many at once, beside
//! what JADE needs for the same: nothing may be lost, and no size may cost more than its copies.
//! On a machine with other work the processor's time for each says more than the clock.
//!
//! How much longer a content takes than the smallest is told in the times that it takes to copy it
//! there and back within memory, and beside it for the same octets through a bare socket, below
//! which nobody can stay.

use std::hint::black_box;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use fipa::prelude::*;
use fipa_benches::table::Times;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

/// Set in the process that answers.
const MARK: &str = "FIPA_BENCH_ECHO";

/// Octets of the contents.
const CONTENTS: [usize; 6] = [100, 1 << 10, 8_000, 8_192, 10_000, 100_000];

/// Rounds of all, and conversations of each that are timed one by one.
const ROUNDS: usize = 5;
const COUNT: usize = 1_000;

/// Conversations under way where the rate is measured, and for how long.
const WINDOW: usize = 64;
const SPAN: Duration = Duration::from_millis(800);

/// How long JADE takes to JADE, one by one, and how many it ends in a second with 64 under way.
const JADE_MICROS: f64 = 510.0;
const JADE_RATE: f64 = 4_750.0;

const PATIENCE: Duration = Duration::from_secs(20);

fn main() -> ExitCode {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .expect("a runtime");
    if std::env::var_os(MARK).is_some() {
        runtime.block_on(answer());
    } else {
        runtime.block_on(ask());
    }
    ExitCode::SUCCESS
}

/// The echo, the URL under which it is reached, and a bare socket of its process.
struct Echo {
    process: Child,
    agent: AgentId,
    socket: String,
}

impl Echo {
    fn start() -> Echo {
        let program = std::env::current_exe().expect("this program");
        let mut process = Command::new(program)
            .env(MARK, "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("a process");
        let output = process.stdout.take().expect("piped");
        let mut lines = BufReader::new(output).lines();
        let mut line = || lines.next().expect("a line").expect("a text");
        let agent = AgentId::new("echo@robot2").address(line());
        Echo {
            agent,
            socket: line(),
            process,
        }
    }

    /// The processor's time that both processes have had.
    fn processor_micros(&self) -> f64 {
        let both = [self.process.id(), std::process::id()];
        let times = both.map(|process| {
            let told = std::fs::read_to_string(format!("/proc/{process}/schedstat"));
            let told = told.expect("Linux");
            let nanos: f64 = told.split(' ').next().expect("a time").parse().expect("it");
            nanos / 1e3
        });
        times.iter().sum()
    }
}

impl Drop for Echo {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

async fn platform(name: &'static str) -> Platform {
    let builder = Platform::builder().name(name).mdns(false);
    let platform = builder.http("127.0.0.1:0", "/acc").start().await;
    platform.expect("a platform")
}

async fn answer() {
    let platform = platform("robot2").await;
    let echo = Arc::new(platform.agent("echo@robot2").await.expect("an agent"));
    println!("{}", platform.http_urls()[0]);
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    println!("{}", listener.local_addr().expect("bound"));
    tokio::spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            tokio::spawn(answer_octets(stream));
        }
    });
    while let Ok(query) = echo.receive().await {
        let mut answer = query.reply(Performative::Inform);
        answer.content = query.content;
        let echo = Arc::clone(&echo);
        tokio::spawn(async move { echo.send(answer).await });
    }
}

/// Sends back what comes, each time once that is whole: its length, and so many octets.
async fn answer_octets(mut stream: TcpStream) -> std::io::Result<()> {
    stream.set_nodelay(true)?;
    loop {
        let length = stream.read_u32().await?;
        let mut octets = vec![0; 4 + length as usize];
        octets[..4].copy_from_slice(&length.to_be_bytes());
        stream.read_exact(&mut octets[4..]).await?;
        stream.write_all(&octets).await?;
    }
}

/// How long a bare socket takes for so many octets, there and back.
async fn socket_micros(address: &str, octets: usize) -> f64 {
    let mut stream = TcpStream::connect(address).await.expect("the echo is up");
    stream.set_nodelay(true).expect("TCP");
    let length = u32::try_from(octets).expect("a few");
    let mut content = vec![b'x'; 4 + octets];
    content[..4].copy_from_slice(&length.to_be_bytes());
    let mut times = Vec::with_capacity(COUNT);
    for _ in 0..COUNT {
        let start = Instant::now();
        stream.write_all(&content).await.expect("the echo is up");
        let read = stream.read_exact(&mut content).await;
        read.expect("the echo is up");
        times.push(start.elapsed());
    }
    times.iter().sum::<Duration>().as_secs_f64() * 1e6 / COUNT as f64
}

async fn ask() {
    let platform = platform("robot1").await;
    let agent = Arc::new(platform.agent("ping@robot1").await.expect("an agent"));
    let echo = Echo::start();
    println!(
        "content  mean us   p50 us   p99 us  CPU us  of JADE's   {WINDOW} at once/s  of JADE's  CPU us  \
         growth/copies  socket us  its growth/copies"
    );
    let mut smallest = None;
    for octets in CONTENTS {
        let content = Bytes::from(vec![b'x'; octets]);
        // The first ones open connections.
        one_by_one(&agent, &echo.agent, &content, 100).await;
        let (mut means, mut times, mut rates) = (Vec::new(), Vec::new(), Vec::new());
        let (mut alone, mut together, mut bare) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..ROUNDS {
            bare.push(socket_micros(&echo.socket, octets).await);
            let before = echo.processor_micros();
            let taken = one_by_one(&agent, &echo.agent, &content, COUNT).await;
            let between = echo.processor_micros();
            means.push(taken.iter().sum::<Duration>().as_secs_f64() * 1e6 / COUNT as f64);
            alone.push((between - before) / COUNT as f64);
            times.extend(taken);
            let (ended, rate) = many_at_once(&agent, &echo.agent, &content).await;
            together.push((echo.processor_micros() - between) / ended as f64);
            rates.push(rate);
        }
        let (mean, rate, times) = (median(means), median(rates), Times::new(times));
        let socket = median(bare);
        let (first, first_socket) = *smallest.get_or_insert((mean, socket));
        // Each conversation carries the content twice.
        let copies = 2.0 * copy_micros(octets);
        let growth = |by: f64| match octets == CONTENTS[0] {
            true => 0.0,
            false => by / copies,
        };
        let (growth, its_growth) = (growth(mean - first), growth(socket - first_socket));
        println!(
            "{octets:7}  {mean:7.1}  {:7.1}  {:7.1}  {:6.1}  {:9.2}  {rate:13.0}  {:9.2}  {:6.1}  {growth:13.1}  {socket:9.1}  {its_growth:17.1}",
            times.percentile(0.5),
            times.percentile(0.99),
            median(alone),
            mean / JADE_MICROS,
            rate / JADE_RATE,
            median(together),
        );
    }
}

async fn one_by_one(agent: &Agent, echo: &AgentId, content: &Bytes, count: usize) -> Vec<Duration> {
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        let start = Instant::now();
        converse(agent, echo, content).await;
        times.push(start.elapsed());
    }
    times
}

/// Conversations, and how many a second.
async fn many_at_once(agent: &Arc<Agent>, echo: &AgentId, content: &Bytes) -> (usize, f64) {
    let mut asking = JoinSet::new();
    let start = Instant::now();
    for _ in 0..WINDOW {
        let (agent, echo, content) = (Arc::clone(agent), echo.clone(), content.clone());
        asking.spawn(async move {
            let mut ended = 0_usize;
            while start.elapsed() < SPAN {
                converse(&agent, &echo, &content).await;
                ended += 1;
            }
            ended
        });
    }
    let ended: usize = asking.join_all().await.into_iter().sum();
    (ended, ended as f64 / start.elapsed().as_secs_f64())
}

/// One that gets no answer, or another one, ends the bench.
async fn converse(agent: &Agent, echo: &AgentId, content: &Bytes) {
    let query = Message::new(Performative::Request)
        .to(echo.clone())
        .content(content.clone());
    let answer = agent.request(query, PATIENCE).await.expect("an answer");
    assert_eq!(answer.content.as_deref(), Some(&content[..]));
}

/// How long it takes to copy so many octets.
fn copy_micros(octets: usize) -> f64 {
    const COPIES: u32 = 1_000;
    let (from, mut to) = (vec![1_u8; octets], vec![0_u8; octets]);
    let start = Instant::now();
    for _ in 0..COPIES {
        to.copy_from_slice(black_box(&from));
        black_box(&mut to);
    }
    start.elapsed().as_secs_f64() * 1e6 / f64::from(COPIES)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
