//! A contract net: a master calls twenty bidders on three robots for a task. One robot fails while
//! they bid, with the best bid of all. The best of those that live gets the task.
//!
//! With the name of a file, what passes the master's robot is logged there, to be drawn:
//!
//! ```text
//! cargo run --example contract_net -- contract-net.jsonl
//! fipa sniff --file contract-net.jsonl --format svg > contract-net.svg
//! ```

use std::io::Write;
use std::process::{Child, Command};
use std::time::Duration;

use fipa::prelude::*;
use fipa::{Answer, ConversationError, ConversationEvent, EventKind, Order, open_letter};
use fipa_json::sniffed_to_json;
use tokio::task::JoinHandle;

const BIDDERS: usize = 20;
/// The bidder that makes its proposal last.
const LAST: usize = 18;
const PATIENCE: Duration = Duration::from_secs(20);

type Failure = Box<dyn std::error::Error>;

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Failure> {
    let mut args = std::env::args().skip(1);
    match (args.next(), args.next()) {
        // The robot that fails is a process of its own.
        (Some(word), Some(peer)) if word == "--peer" => robot_that_fails(peer).await,
        (log, _) => call_for_proposals(log).await,
    }
}

async fn call_for_proposals(log: Option<String>) -> Result<(), Failure> {
    let robot1 = Platform::builder()
        .name("robot1")
        .mdns(false)
        .start()
        .await?;
    let log = log.map(|file| logged(&robot1, file));
    let peer = robot1.endpoints()[0].to_string();
    let robot2 = platform("robot2", &peer).await?;
    for number in 0..BIDDERS {
        let home = match number % 3 {
            0 => (&robot1, "robot1"),
            1 => (&robot2, "robot2"),
            _ => continue,
        };
        serve(home.0, home.1, number).await?;
    }
    let mut robot3 = Robot3(
        Command::new(std::env::current_exe()?)
            .args(["--peer", &peer])
            .spawn()?,
    );
    let bidders: Vec<String> = (0..BIDDERS)
        .map(|number| format!("bidder{number:02}@robot{}", number % 3 + 1))
        .collect();
    for bidder in &bidders {
        tokio::time::timeout(PATIENCE, robot1.wait_for(bidder)).await?;
    }
    let master = robot1.agent("master@robot1").await?;
    println!("master@robot1 -> {BIDDERS} bidders: cfp carry the payload to the dock");

    let mut events = master.conversation_events();
    let call = Message::new(Performative::Cfp).content("carry the payload to the dock");
    let calling = master.contract_net(call, bidders, PATIENCE, |proposals| {
        for proposal in sorted(proposals) {
            println!("{}", line(proposal));
        }
        let price = |place: &usize| price(&proposals[*place]);
        (0..proposals.len()).min_by_key(price).into_iter().collect()
    });
    let failing = async {
        // All have bid but the last one of robot1, which waits for robot3 to be gone.
        let mut bids = 0;
        while bids < BIDDERS - 1 {
            let event = events.next().await;
            if let Some(ConversationEvent::Progress(event)) = event
                && let EventKind::Updated { state } = event.kind
            {
                bids += usize::from(state == "proposed");
            }
        }
        println!("robot3 fails");
        robot3.0.kill()?;
        robot3.0.wait()
    };
    let (contracts, killed) = tokio::join!(calling, failing);
    killed?;
    let contracts = contracts?;

    let mut absent: Vec<String> = contracts
        .without_proposal()
        .iter()
        .map(|(_, why)| format!("no proposal: {why}"))
        .collect();
    absent.sort();
    absent.iter().for_each(|absent| println!("{absent}"));
    for accepted in contracts.accepted() {
        println!("master@robot1 -> {}: accept-proposal", name(accepted));
    }
    for rejected in sorted(contracts.rejected()) {
        println!("master@robot1 -> {}: reject-proposal", name(rejected));
    }
    for (bidder, result) in contracts.results(PATIENCE).await {
        match result {
            Ok(report) => println!("{}", line(&report)),
            Err(error) => println!("{bidder}: {error}"),
        }
    }
    robot1.shutdown().await;
    if let Some(log) = log {
        log.await??;
    }
    Ok(())
}

/// Writes what passes a robot into a file, until the robot ends.
fn logged(robot: &Platform, file: String) -> JoinHandle<std::io::Result<()>> {
    let mut sniffer = robot.sniff();
    tokio::task::spawn_blocking(move || {
        let mut log = std::fs::File::create(file)?;
        while let Some(sniffed) = sniffer.blocking_next() {
            for line in sniffed_to_json(&sniffed, open_letter) {
                writeln!(log, "{line}")?;
            }
        }
        Ok(())
    })
}

/// Ends with the program that started it, whatever happens.
struct Robot3(Child);

impl Drop for Robot3 {
    fn drop(&mut self) {
        let _ = self.0.kill();
    }
}

async fn robot_that_fails(peer: String) -> Result<(), Failure> {
    let robot3 = platform("robot3", &peer).await?;
    for number in (2..BIDDERS).step_by(3) {
        serve(&robot3, "robot3", number).await?;
    }
    // It is ended from outside, long before.
    tokio::time::sleep(2 * PATIENCE).await;
    Ok(())
}

async fn platform(name: &str, peer: &str) -> Result<Platform, fipa::Error> {
    let builder = Platform::builder().name(name).mdns(false).peer(peer);
    builder.start().await
}

/// A bidder, which answers calls as long as the program runs.
async fn serve(platform: &Platform, robot: &str, number: usize) -> Result<(), Failure> {
    let agent = platform.agent(format!("bidder{number:02}@{robot}")).await?;
    let watcher = platform.clone();
    tokio::spawn(async move {
        let call = move |order| bid(order, number, watcher.clone());
        agent.respond().call(call).run().await;
    });
    Ok(())
}

async fn bid(
    mut order: Order,
    number: usize,
    platform: Platform,
) -> Result<Answer, ConversationError> {
    if number == LAST {
        let mut changes = platform.watch();
        while platform.find("bidder17@robot3").is_some() {
            changes.next().await;
        }
    }
    // Number 17, on the robot that fails, would be the best of all.
    let minutes = (5 * number + 7) % 23 + 4;
    match order.propose(format!("{minutes} minutes")).await? {
        Some(_) => Ok(Answer::inform("the payload is at the dock")),
        None => Ok(Answer::nothing()),
    }
}

fn sorted(messages: &[Message]) -> Vec<&Message> {
    let mut sorted: Vec<&Message> = messages.iter().collect();
    sorted.sort_by_key(|message| name(message));
    sorted
}

fn name(message: &Message) -> String {
    let sender = message.sender.as_ref();
    sender.map_or_else(String::new, |sender| sender.name.to_string())
}

fn price(message: &Message) -> u32 {
    let words = message.content_str().and_then(|text| text.split_once(' '));
    words
        .and_then(|(price, _)| price.parse().ok())
        .unwrap_or(u32::MAX)
}

fn line(message: &Message) -> String {
    let content = message.content_str().unwrap_or_default();
    format!(
        "{} -> master@robot1: {} {content}",
        name(message),
        message.performative
    )
}
