//! A robot that asks another one for something. `serve` is the other one.

use std::time::Duration;

use fipa::prelude::*;

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let robot1 = Platform::builder().name("robot1").start().await?;
    let arm = robot1.agent("arm@robot1").await?;
    robot1.wait_for("drive@robot2").await;

    let order = Message::new(Performative::Request)
        .to("drive@robot2")
        .content("go to the dock");
    let answer = arm.request(order, Duration::from_secs(5)).await?;
    println!(
        "{}: {}",
        answer.performative,
        answer.content_str().unwrap_or_default()
    );
    Ok(())
}
