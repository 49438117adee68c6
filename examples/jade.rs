//! Asks an agent of a JADE platform, and is answered over HTTP.
//!
//! With JADE's EchoAgent as `echo` on a platform `platA` that takes letters at this URL:
//! `cargo run --example jade -- http://127.0.0.1:7778/acc echo@platA`

use std::time::Duration;

use fipa::prelude::*;

#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let (Some(url), Some(name)) = (words.next(), words.next()) else {
        return Err("give the URL of the platform and the name of an agent there".into());
    };
    let robot1 = Platform::builder()
        .name("robot1")
        .mdns(false)
        .http("127.0.0.1:0", "/acc")
        .peer(url)
        .start()
        .await?;
    let arm = robot1.agent("arm@robot1").await?;
    // Its AMS is asked who is there.
    robot1.wait_for(&name).await;

    let question = Message::new(Performative::Request)
        .to(name)
        .content("hello");
    let answer = arm.request(question, Duration::from_secs(5)).await?;
    println!(
        "{}: {}",
        answer.performative,
        answer.content_str().unwrap_or_default()
    );
    Ok(())
}
