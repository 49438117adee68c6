//! One message for many.

use fipa::{Agent, Message, Outcome, Performative, Platform};

use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};

const DAEMONS: usize = 5;
const AGENTS: usize = 10;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_pattern_reaches_50_agents_of_5_daemons_once_each_and_nobody_else() {
    let place = Place::new();
    let daemons: Vec<Daemon> = (1..=DAEMONS)
        .map(|n| place.start(&format!("robot{n}")))
        .collect();
    let mut agents = Vec::new();
    for (n, daemon) in daemons.iter().enumerate() {
        let platform = attach(daemon).await;
        for m in 1..=AGENTS {
            let name = format!("agent{m}@robot{}", n + 1);
            agents.push(agent(&platform, &name).await);
        }
    }
    let names: Vec<&str> = agents.iter().map(|agent| agent.name().as_str()).collect();
    let robot1 = attach(&daemons[0]).await;
    all_known(&robot1, &names).await;

    let sender = agent(&robot1, "sender@robot1").await;
    let call = Message::new(Performative::Inform).to(".*").content("all");
    let outcomes = sender.send(call).await;
    let mut reached: Vec<&str> = outcomes.iter().map(|o| o.to.as_str()).collect();
    let mut expected = names.clone();
    reached.sort_unstable();
    expected.sort_unstable();
    assert_eq!(reached, expected);
    assert!(outcomes.iter().all(|o| o.outcome == Outcome::Delivered));
    for agent in &agents {
        only(agent, "all", &sender).await;
    }
    assert!(sender.try_receive().is_none());

    // The tool, in the name of the same sender.
    let words = "send --to .* --from sender@robot1 --performative inform --json";
    let words: Vec<&str> = words.split(' ').collect();
    let ended = tokio::task::block_in_place(|| daemons[0].run(&words));
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let mut reached: Vec<String> = Vec::new();
    for line in ended.json() {
        assert_eq!(line["outcome"], "delivered");
        reached.push(line["to"].as_str().unwrap().to_owned());
    }
    reached.sort_unstable();
    assert_eq!(reached, expected);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn daemons_that_dial_each_other_in_a_circle_deliver_once() {
    let place = Place::new();
    // A loopback address that no other process listens at, so that the ports need not be free.
    let pid = std::process::id();
    let host = format!("127.{}.{}", 1 + pid / 250 % 250, 1 + pid % 250);
    let endpoint = |n: usize| format!("tcp://{host}.{n}:4711");
    let mut platforms = Vec::new();
    let mut daemons = Vec::new();
    for n in 1..=3 {
        let (own, next) = (endpoint(n), endpoint(n % 3 + 1));
        let options = ["--no-mdns", "--listen", &own, "--peer", &next];
        let daemon = place.start_with(&format!("robot{n}"), &options);
        platforms.push(attach(&daemon).await);
        daemons.push(daemon);
    }
    let names = ["agent@robot1", "agent@robot2", "agent@robot3"];
    let mut agents = Vec::new();
    for (platform, name) in platforms.iter().zip(names) {
        agents.push(agent(platform, name).await);
    }
    for platform in &platforms {
        all_known(platform, &names).await;
    }
    let sender = agent(&platforms[0], "sender@robot1").await;
    let one = Message::new(Performative::Inform)
        .to(names[1])
        .content("one");
    let outcomes = sender.send(one).await;
    assert_eq!(outcomes.len(), 1);
    assert_eq!(outcomes[0].outcome, Outcome::Delivered);
    only(&agents[1], "one", &sender).await;

    let all = Message::new(Performative::Inform)
        .to("agent@.*")
        .content("all");
    let outcomes = sender.send(all).await;
    assert_eq!(outcomes.len(), 3);
    assert!(outcomes.iter().all(|o| o.outcome == Outcome::Delivered));
    for agent in &agents {
        only(agent, "all", &sender).await;
    }
}

async fn attach(daemon: &Daemon) -> Platform {
    let attached = within(Platform::attach_to(&daemon.control)).await;
    attached.unwrap()
}

async fn agent(platform: &Platform, name: &str) -> Agent {
    within(platform.agent(name)).await.unwrap()
}

async fn all_known(platform: &Platform, names: &[&str]) {
    for name in names {
        within(platform.wait_for(name)).await;
    }
}

/// The agent gets a message of this content, and then nothing but what is sent after it.
async fn only(agent: &Agent, content: &str, sender: &Agent) {
    assert_eq!(next(agent).await.as_deref(), Some(content));
    let last = Message::new(Performative::Inform)
        .to(agent.name().as_str())
        .content("last");
    assert!(sender.send(last).await[0].outcome.is_success());
    assert_eq!(next(agent).await.as_deref(), Some("last"));
    assert!(agent.try_receive().is_none());
}

async fn next(agent: &Agent) -> Option<String> {
    let message = within(agent.receive()).await.unwrap();
    message.content_str().map(str::to_owned)
}

#[track_caller]
fn within<T>(event: impl Future<Output = T>) -> impl Future<Output = T> {
    let caller = std::panic::Location::caller();
    async move {
        let event = tokio::time::timeout(PATIENCE, event).await;
        event.unwrap_or_else(|_| panic!("{caller}: it does not come"))
    }
}
