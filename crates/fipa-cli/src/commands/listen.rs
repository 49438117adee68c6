//! `fipa listen`: an agent that prints what it is sent.

use std::time::Duration;

use bytes::Bytes;
use fipa::{Letter, Message};
use fipa_json::{Body, letter_to_json};

use crate::Failure;
use crate::attached::{self, Control, print_json, print_line};

/// The options of `fipa listen`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The agent's name, used as it is
    #[arg(long = "as", value_name = "NAME")]
    name: String,
    /// What others read about it in the directory
    #[arg(long, value_name = "TEXT")]
    description: Option<String>,
    /// End after so many messages
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// End after so many seconds
    #[arg(long, value_name = "S", value_parser = attached::seconds)]
    timeout: Option<Duration>,
    /// One letter a line, as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    control: Control,
}

/// Prints each letter, until there were enough, the time is over, or it is interrupted.
pub fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let interrupted = attached::interrupted()?;
        let platform = args.control.attach().await?;
        let agent = attached::register(&platform, &args.name, args.description.as_deref()).await?;
        attached::say_attached(&agent);
        let over = async {
            match args.timeout {
                Some(timeout) => tokio::time::sleep(timeout).await,
                None => std::future::pending().await,
            }
        };
        tokio::pin!(interrupted, over);
        let mut printed = 0;
        while args.count.is_none_or(|count| printed < count) {
            let received = tokio::select! {
                // What came before the time was over is printed.
                biased;
                () = &mut interrupted => return Ok(()),
                received = agent.receive_letter() => received,
                () = &mut over => return time_is_over(args, printed),
            };
            let (letter, message) = received.map_err(Failure::environment)?;
            print(args, &letter, message)?;
            printed += 1;
        }
        Ok(())
    })
}

fn time_is_over(args: &Args, printed: u64) -> Result<(), Failure> {
    match args.count {
        Some(count) => Err(Failure::no(format_args!(
            "{printed} of {count} messages came in time"
        ))),
        None => Ok(()),
    }
}

fn print(args: &Args, letter: &Letter, message: Result<Message, String>) -> Result<(), Failure> {
    if args.json {
        let body = match message {
            Ok(message) => Body::Message(Box::new(message)),
            Err(_) => Body::Payload(Bytes::clone(&letter.payload)),
        };
        return print_json(&letter_to_json(&letter.envelope, &body));
    }
    let from = letter.envelope.from();
    let from = from.map_or("nobody", |from| from.name.as_str());
    match message {
        Err(reason) => print_line(format_args!(
            "{from}: a letter that cannot be read: {reason}"
        )),
        Ok(message) => {
            let content = message.content.as_deref().unwrap_or_default();
            print_line(format_args!(
                "{from}: {} {}",
                message.performative,
                String::from_utf8_lossy(content)
            ))
        }
    }
}
