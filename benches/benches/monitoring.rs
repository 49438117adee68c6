//! A request and its answer between two agents, with the conversation monitor of both off,
//! advisory and enforcing, in one run: turn by turn, so that all three see the same machine.

use std::time::{Duration, Instant};

use fipa::prelude::*;
use fipa::{Monitoring, Text};

const MODES: [Monitoring; 3] = [Monitoring::Off, Monitoring::Advisory, Monitoring::Enforcing];
const ROUNDS: usize = 41;
const REQUESTS: usize = 500;
const PATIENCE: Duration = Duration::from_secs(10);

fn main() {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .expect("a runtime");
    runtime.block_on(async {
        println!("round trip     one platform   over TCP");
        let near = measure(false).await;
        let far = measure(true).await;
        for (at, mode) in MODES.iter().enumerate() {
            println!(
                "{:12} {:8.1} us {:.3} {:8.1} us {:.3}",
                format!("{mode:?}").to_lowercase(),
                near[at].0,
                near[at].1,
                far[at].0,
                far[at].1
            );
        }
    });
}

/// Microseconds of a round trip in each mode, and how many times as long that is as without.
async fn measure(is_far: bool) -> Vec<(f64, f64)> {
    let one = Platform::builder().name("robot1").mdns(false);
    let one = one.start().await.expect("a platform");
    let two = Platform::builder().name("robot2").mdns(false);
    let two = two.peer(one.endpoints()[0].to_string());
    let two = two.start().await.expect("a platform");
    let arm = one.agent("arm").await.expect("an agent");
    let home = if is_far { &two } else { &one };
    let drive = std::sync::Arc::new(home.agent("drive").await.expect("an agent"));
    one.wait_for("drive").await;
    two.wait_for("arm").await;
    let answering = std::sync::Arc::clone(&drive);
    let answers = tokio::spawn(async move {
        while let Ok(order) = answering.receive().await {
            answering.send(order.reply(Performative::Inform)).await;
        }
    });
    let mut times = vec![Vec::new(); MODES.len()];
    for round in 0..ROUNDS {
        for step in 0..MODES.len() {
            let at = (round + step) % MODES.len();
            arm.set_monitoring(MODES[at]);
            drive.set_monitoring(MODES[at]);
            let start = Instant::now();
            for _ in 0..REQUESTS {
                let mut order = Message::new(Performative::Request).to("drive");
                order.protocol = Some(Text::from_static("fipa-request"));
                arm.request(order, PATIENCE).await.expect("an answer");
            }
            times[at].push(start.elapsed().as_secs_f64() * 1e6 / REQUESTS as f64);
        }
    }
    answers.abort();
    let ratios = |at: usize| {
        let pairs = times[at].iter().zip(&times[0]);
        median(pairs.map(|(with, without)| with / without).collect())
    };
    (0..MODES.len())
        .map(|at| (median(times[at].clone()), ratios(at)))
        .collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
