//! `fipa ping`: how long it takes to be answered.

use std::sync::Arc;
use std::time::{Duration, Instant};

use fipa::{Agent, Message, Performative, RequestError};
use serde_json::{Value, json};
use tokio::task::JoinSet;

use crate::Failure;
use crate::attached::{self, Control, print_json, print_line};
use crate::times::{Times, rounded};

/// The options of `fipa ping`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// An agent that answers queries, such as that of `fipa echo`
    #[arg(value_name = "NAME")]
    name: String,
    /// How many queries
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..))]
    count: u64,
    /// Octets of content in each
    #[arg(long, value_name = "BYTES", default_value_t = 100)]
    size: usize,
    /// Queries under way at once
    #[arg(long, value_name = "W", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    window: u64,
    /// Seconds to wait for NAME to appear, and for each answer
    #[arg(long, value_name = "S", default_value = "5", value_parser = attached::seconds)]
    timeout: Duration,
    /// One JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    control: Control,
}

/// Queries, and prints the times; a "no" if any answer is missing.
pub fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let platform = args.control.attach().await?;
        let agent = attached::register(&platform, &attached::own_name("ping-"), None).await?;
        let known = tokio::time::timeout(args.timeout, platform.wait_for(&args.name)).await;
        let results = match known {
            Ok(Some(_)) => ping(args, agent).await?,
            Ok(None) => return Err(Failure::environment("the daemon is gone")),
            Err(_) => Results::default(),
        };
        let missing = args.count - results.times.len() as u64;
        report(args, results)?;
        match (missing, known) {
            (0, _) => Ok(()),
            (_, Err(_)) => Err(Failure::no(format_args!(
                "{} did not appear within {:?}",
                args.name, args.timeout
            ))),
            (missing, _) => Err(Failure::no(format_args!("{missing} answers are missing"))),
        }
    })
}

#[derive(Default)]
struct Results {
    sent: u64,
    /// Round trips.
    times: Times,
    elapsed: Duration,
    complaint: Option<String>,
}

async fn ping(args: &Args, agent: Agent) -> Result<Results, Failure> {
    let agent = Arc::new(agent);
    let content = bytes::Bytes::from(vec![b'x'; args.size]);
    let mut results = Results::default();
    let mut times = Vec::new();
    let mut under_way = JoinSet::new();
    let start = Instant::now();
    loop {
        while results.sent < args.count && (under_way.len() as u64) < args.window {
            let query = Message::new(Performative::QueryRef)
                .to(args.name.as_str())
                .content(content.clone());
            under_way.spawn(once(Arc::clone(&agent), query, args.timeout));
            results.sent += 1;
        }
        match under_way.join_next().await {
            None => break,
            Some(Ok(Ok(time))) => times.push(time.as_secs_f64() * 1e6),
            Some(Ok(Err(RequestError::Ended))) => {
                return Err(Failure::environment("the daemon is gone"));
            }
            Some(Ok(Err(error))) => results.complaint = Some(error.to_string()),
            Some(Err(error)) => return Err(Failure::environment(error)),
        }
    }
    results.elapsed = start.elapsed();
    results.times = times.into_iter().collect();
    Ok(results)
}

async fn once(
    agent: Arc<Agent>,
    query: Message,
    timeout: Duration,
) -> Result<Duration, RequestError> {
    let start = Instant::now();
    agent.request(query, timeout).await?;
    Ok(start.elapsed())
}

fn report(args: &Args, results: Results) -> Result<(), Failure> {
    let received = results.times.len();
    let per_second = match results.elapsed.as_secs_f64() {
        0.0 => 0.0,
        seconds => received as f64 / seconds,
    };
    let times = results.times.to_json();
    if args.json {
        return print_json(&json!({
            "sent": results.sent,
            "received": received,
            "rtt_us": times,
            "per_second": rounded(per_second),
        }));
    }
    print_line(format_args!(
        "{received} of {} answered, {per_second:.0} a second",
        args.count
    ))?;
    if let Value::Object(times) = times {
        let shown: Vec<String> = times.iter().map(|(k, v)| format!("{k} {v}")).collect();
        print_line(format_args!("round trip in us: {}", shown.join(", ")))?;
    }
    if let Some(complaint) = results.complaint {
        print_line(complaint)?;
    }
    Ok(())
}
