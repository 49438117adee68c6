//! Many letters over HTTP between two of our processes: none is lost, whatever its size.

use std::time::{Duration, Instant};

use fipa::{AgentId, Message, Performative, Platform};
use tokio::task::JoinSet;

use crate::agents::{HTTP, http_of};
use crate::support::daemon::Place;

#[test]
fn every_letter_is_echoed_one_by_one_and_many_at_once() {
    let place = Place::new();
    let daemon = place.start_with("robot2", &HTTP);
    let _echo = daemon.attach("echo", "echo@robot2");
    let echo = AgentId::new("echo@robot2").address(http_of(&daemon));
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let builder = Platform::builder().name("robot1").mdns(false);
        let platform = builder.http("127.0.0.1:0", "/acc").start().await.unwrap();
        let agent = std::sync::Arc::new(platform.agent("ping@robot1").await.unwrap());
        for size in [100, 1000, 8000, 8192, 10_000, 100_000] {
            for window in [1, 64] {
                let count = if size > 10_000 { 40 } else { 100 };
                let begun = Instant::now();
                let mut under_way = JoinSet::new();
                for number in 0..count {
                    if number >= window {
                        under_way.join_next().await.unwrap().unwrap();
                    }
                    let (agent, echo) = (agent.clone(), echo.clone());
                    under_way.spawn(async move {
                        let content = format!("{number:04}") + &"x".repeat(size - 4);
                        let query = Message::new(Performative::Request)
                            .to(echo)
                            .content(content.clone());
                        let answer = agent.request(query, Duration::from_secs(20)).await.unwrap();
                        assert_eq!(answer.content_str(), Some(content.as_str()));
                    });
                }
                while let Some(ended) = under_way.join_next().await {
                    ended.unwrap();
                }
                let each = begun.elapsed() / count as u32;
                println!("{size} octets, {window} at once: {each:?} each");
            }
        }
    });
}
