//! A robot that does what it is asked. Run it, then `request` beside it.

use fipa::prelude::*;

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let robot2 = Platform::builder().name("robot2").start().await?;
    let drive = robot2.agent("drive@robot2").await?;
    println!("drive@robot2 is there");
    loop {
        let order = drive.receive().await?;
        println!("{}", order.content_str().unwrap_or("no text"));
        let outcomes = drive
            .send(order.reply(Performative::Inform).content("at the dock"))
            .await;
        println!("the answer is {}", outcomes[0].outcome);
    }
}
