//! `fipa attach`: an agent for programs in any language.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use fipa::{Agent, Letter, Message, Notice, ReceiverOutcome};
use fipa_json::{Body, letter_to_json, message_from_json, message_to_json, outcome_to_json};
use serde_json::{Value, json};
use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::task::JoinSet;

use crate::Failure;
use crate::attached::{self, Control, print_json};

/// The options of `fipa attach`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The agent's name, used as it is
    #[arg(long = "as", value_name = "NAME")]
    name: String,
    /// What others read about it in the directory
    #[arg(long, value_name = "TEXT")]
    description: Option<String>,
    #[command(flatten)]
    control: Control,
}

/// How long answers are waited for once the input has ended: from the last thing that came.
const LINGER: Duration = Duration::from_secs(1);

/// Sends the messages on standard input, prints what comes and what became of each, until the
/// input ends and nothing more comes for a second, or it is interrupted. A line that is no message
/// is reported and passed over; the command then ends with 2.
pub fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let interrupted = attached::interrupted()?;
        let platform = args.control.attach().await?;
        let agent = attached::register(&platform, &args.name, args.description.as_deref()).await?;
        let mut notices = platform.notices();
        attached::say_attached(&agent);
        let agent = Arc::new(agent);
        let mut lines = BufReader::new(tokio::io::stdin()).split(b'\n');
        let mut sending = JoinSet::new();
        let mut number = 0_u64;
        let mut wrong: Option<Failure> = None;
        let mut open = true;
        tokio::pin!(interrupted);
        loop {
            let done = !open && sending.is_empty();
            tokio::select! {
                line = lines.next_segment(), if open => {
                    let line = line.map_err(|e| Failure::environment(format_args!("-: {e}")))?;
                    number += 1;
                    match line {
                        None => open = false,
                        Some(line) if line.trim_ascii().is_empty() => {}
                        Some(line) => match read(&line) {
                            Ok((message, tag)) => {
                                sending.spawn(send(Arc::clone(&agent), message, tag));
                            }
                            Err(reason) => {
                                let failure = report(number, &reason)?;
                                wrong.get_or_insert(failure);
                            }
                        },
                    }
                }
                Some(sent) = sending.join_next() => {
                    let (outcomes, tag) = sent.map_err(Failure::environment)?;
                    print_outcomes(&outcomes, tag.as_ref())?;
                }
                received = agent.receive_letter() => {
                    let (letter, message) = received.map_err(Failure::environment)?;
                    print_letter(&letter, message)?;
                }
                Some(notice) = notices.next() => print_notice(&notice)?,
                () = &mut interrupted => break,
                () = tokio::time::sleep(LINGER), if done => break,
            }
        }
        wrong.map_or(Ok(()), Err)
    })
}

/// A message, and the tag beside it.
fn read(line: &[u8]) -> Result<(Message, Option<Value>), String> {
    let mut value: Value = serde_json::from_slice(line).map_err(|error| error.to_string())?;
    let tag = value
        .as_object_mut()
        .and_then(|object| object.remove("tag"));
    let message = message_from_json(&value).map_err(|error| error.to_string())?;
    Ok((message, tag))
}

async fn send(
    agent: Arc<Agent>,
    message: Message,
    tag: Option<Value>,
) -> (Vec<ReceiverOutcome>, Option<Value>) {
    (agent.send(message).await, tag)
}

fn print_outcomes(outcomes: &[ReceiverOutcome], tag: Option<&Value>) -> Result<(), Failure> {
    for outcome in outcomes {
        let mut line = outcome_to_json(outcome);
        if let (Some(object), Some(tag)) = (line.as_object_mut(), tag) {
            object.insert("tag".to_owned(), tag.clone());
        }
        print_json(&line)?;
    }
    Ok(())
}

/// The message; a letter that cannot be read is shown whole.
fn print_letter(letter: &Letter, message: Result<Message, String>) -> Result<(), Failure> {
    match message {
        Ok(message) => print_json(&json!({"message": message_to_json(&message)})),
        Err(reason) => {
            let body = Body::Payload(Bytes::clone(&letter.payload));
            let letter = letter_to_json(&letter.envelope, &body);
            print_json(&json!({"event": "unreadable", "reason": reason, "letter": letter}))
        }
    }
}

fn print_notice(notice: &Notice) -> Result<(), Failure> {
    match notice {
        Notice::DaemonUp => print_json(&json!({"event": "attached"})),
        Notice::DaemonLost { reason } => {
            print_json(&json!({"event": "lost", "reason": reason.as_str()}))
        }
        _ => Ok(()),
    }
}

fn report(number: u64, reason: &str) -> Result<Failure, Failure> {
    print_json(&json!({"event": "malformed", "line": number, "reason": reason}))?;
    Ok(Failure::malformed(format_args!("line {number}: {reason}")))
}
