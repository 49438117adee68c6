//! `fipad demo`: a tour on loopback with real daemons, which ends by itself.

mod daemons;

use std::future::Future;
use std::time::{Duration, Instant};

use fipa::{Agent, Message, Outcome, Performative, Platform, ReceiverOutcome};

use self::daemons::{Daemon, Place};

/// A step that did not do what it says.
type Wrong = String;

/// Takes the tour. The first step that does not do what it says ends it.
pub(crate) async fn run() -> Result<(), Wrong> {
    println!("Two robots on this machine, each with its daemon. Nothing else is touched.\n");
    let place = Place::new()?;
    let mut robots = meet(&place).await?;
    let arm = agent(&robots.one, "arm@robot1").await?;
    let drive = agent(&robots.two, "drive@robot2").await?;
    let camera = agent(&robots.two, "camera@robot2").await?;
    find(&robots.one).await?;
    request(&arm, &drive).await?;
    pattern(&arm, &drive, &camera).await?;
    unknown(&arm).await?;
    vanish(&mut robots, &arm).await?;
    come_back(&place, &mut robots).await?;
    println!("\nAll of it worked. Next: `fipad`, then `fipa agents`, `fipa echo`, `fipa ping`.");
    Ok(())
}

struct Robots {
    one: Platform,
    two: Platform,
    daemon_one: Daemon,
    daemon_two: Daemon,
    mdns: bool,
}

async fn meet(place: &Place) -> Result<Robots, Wrong> {
    step("Two daemons start, and find each other by mDNS, without a server");
    let daemon_one = place.start("robot1", &[]).await?;
    let mut daemon_two = place.start("robot2", &[]).await?;
    let one = daemon_one.attach().await?;
    let mut two = daemon_two.attach().await?;
    // Whoever is attached to one robot shows that the other knows it.
    let probe = agent(&two, "probe@robot2").await?;
    let mdns = within(4, one.wait_for("probe@robot2")).await.is_ok();
    drop(probe);
    if !mdns {
        println!("   This machine has no multicast on loopback: robot2 is told where robot1 is.");
        two.shutdown().await;
        daemon_two.end();
        daemon_two = place.start("robot2", &[&daemon_one.endpoint]).await?;
        two = daemon_two.attach().await?;
        let _probe = agent(&two, "probe@robot2").await?;
        within(4, one.wait_for("probe@robot2"))
            .await
            .map_err(|_| "the daemons do not find each other".to_owned())?;
    }
    println!(
        "   robot1 at {}, robot2 at {}",
        daemon_one.endpoint, daemon_two.endpoint
    );
    Ok(Robots {
        one,
        two,
        daemon_one,
        daemon_two,
        mdns,
    })
}

async fn find(one: &Platform) -> Result<(), Wrong> {
    step("Programs attach agents; robot1 sees those of robot2");
    for name in ["drive@robot2", "camera@robot2"] {
        within(4, one.wait_for(name))
            .await
            .map_err(|_| format!("{name} is not found"))?;
    }
    let found = one.search(".*").map_err(|error| error.to_string())?;
    for record in found {
        let places: Vec<&str> = record.entry.locations.iter().map(|l| &*l.address).collect();
        println!(
            "   {:14} {:6} {}",
            record.entry.name,
            record.source.as_str(),
            places.join(" ")
        );
    }
    Ok(())
}

async fn request(arm: &Agent, drive: &Agent) -> Result<(), Wrong> {
    step("arm@robot1 requests something of drive@robot2, and is answered");
    let order = Message::new(Performative::Request)
        .to("drive@robot2")
        .protocol("fipa-request")
        .content("(go-to dock)");
    let serve = async {
        let order = drive.receive().await.map_err(|error| error.to_string())?;
        let answer = order.reply(Performative::Inform).content("(at dock)");
        expect_all(&drive.send(answer).await, Outcome::Delivered)
    };
    let start = Instant::now();
    let (answer, served) = tokio::join!(arm.request(order, Duration::from_secs(5)), serve);
    served?;
    let answer = answer.map_err(|error| error.to_string())?;
    println!(
        "   {} {:?} after {} us",
        answer.performative,
        answer.content_str().unwrap_or_default(),
        start.elapsed().as_micros()
    );
    match (answer.performative, answer.content.as_deref()) {
        (Performative::Inform, Some(b"(at dock)")) => Ok(()),
        _ => Err("that is not the answer".to_owned()),
    }
}

async fn pattern(arm: &Agent, drive: &Agent, camera: &Agent) -> Result<(), Wrong> {
    step("One message to the pattern .*@robot2 reaches everybody there, once");
    let call = Message::new(Performative::Inform)
        .to(".*@robot2")
        .content("hello");
    let outcomes = arm.send(call).await;
    show(&outcomes);
    expect_all(&outcomes, Outcome::Delivered)?;
    for agent in [drive, camera] {
        let received = within(2, agent.receive()).await;
        received
            .map_err(|_| format!("{} has nothing", agent.name()))?
            .map_err(|error| error.to_string())?;
        if agent.try_receive().is_some() {
            return Err(format!("{} has it twice", agent.name()));
        }
    }
    match outcomes.len() {
        2 => Ok(()),
        other => Err(format!("it went to {other} agents, not to 2")),
    }
}

async fn unknown(arm: &Agent) -> Result<(), Wrong> {
    step("A message to nobody: the sender is told");
    let call = Message::new(Performative::Inform).to("nobody@robot3");
    let outcomes = arm.send(call).await;
    show(&outcomes);
    expect_all(&outcomes, Outcome::Unknown)
}

async fn vanish(robots: &mut Robots, arm: &Agent) -> Result<(), Wrong> {
    step("robot2's daemon is killed with a message under way: the sender is told that, too");
    robots.daemon_two.stop();
    let call = Message::new(Performative::Inform)
        .to("drive@robot2")
        .content("are you there?");
    let sending = arm.send(call);
    let kill = async {
        tokio::time::sleep(Duration::from_millis(300)).await;
        robots.daemon_two.end();
    };
    let start = Instant::now();
    let (outcomes, ()) = tokio::join!(sending, kill);
    show(&outcomes);
    expect_all(&outcomes, Outcome::Timeout)?;
    while robots.one.find("drive@robot2").is_some() {
        if start.elapsed() > Duration::from_secs(5) {
            return Err("its agents are still in the directory after 5 s".to_owned());
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    println!(
        "   its agents left robot1's directory {:.1} s after that",
        start.elapsed().as_secs_f64()
    );
    Ok(())
}

async fn come_back(place: &Place, robots: &mut Robots) -> Result<(), Wrong> {
    step("robot2's daemon starts again: its agents, which are still attached, are back");
    let start = Instant::now();
    let peers = match robots.mdns {
        true => Vec::new(),
        false => vec![robots.daemon_one.endpoint.as_str()],
    };
    robots.daemon_two = place.start("robot2", &peers).await?;
    within(5, robots.one.wait_for("drive@robot2"))
        .await
        .map_err(|_| "drive@robot2 is not back".to_owned())?;
    println!(
        "   drive@robot2 is back after {:.1} s",
        start.elapsed().as_secs_f64()
    );
    Ok(())
}

async fn agent(platform: &Platform, name: &str) -> Result<Agent, Wrong> {
    platform
        .agent(name)
        .await
        .map_err(|error| error.to_string())
}

fn step(text: &str) {
    static NUMBER: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(1);
    let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    println!("{number}. {text}");
}

fn show(outcomes: &[ReceiverOutcome]) {
    for outcome in outcomes {
        let via = outcome.via.as_deref().unwrap_or("nowhere");
        println!(
            "   {}: {} via {via} {}",
            outcome.to, outcome.outcome, outcome.reason
        );
    }
}

fn expect_all(outcomes: &[ReceiverOutcome], expected: Outcome) -> Result<(), Wrong> {
    match outcomes.iter().find(|o| o.outcome != expected) {
        None if !outcomes.is_empty() => Ok(()),
        None => Err("it has no outcome".to_owned()),
        Some(o) => Err(format!(
            "{}: {} instead of {expected}: {}",
            o.to, o.outcome, o.reason
        )),
    }
}

async fn within<T>(seconds: u64, future: impl Future<Output = T>) -> Result<T, Wrong> {
    tokio::time::timeout(Duration::from_secs(seconds), future)
        .await
        .map_err(|_| format!("it took longer than {seconds} s"))
}
