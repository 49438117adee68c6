//! `fipa send`: one message, and what became of it.

use std::collections::HashSet;
use std::path::PathBuf;
use std::time::Duration;

use bytes::Bytes;
use fipa::{
    Agent, DeliveryFailure, Message, Performative, Platform, ReceiverOutcome, RegisterError, Text,
};
use fipa_json::{message_to_json, outcome_to_json};
use serde_json::json;
use tokio::time::Instant;

use crate::attached::{self, Control, print_json, print_line};
use crate::{Failure, streams};

/// The options of `fipa send`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Who it is for: a name, or a regular expression that must match all of one
    #[arg(long, value_name = "NAME_OR_REGEX")]
    to: String,
    /// In whose name; default fipa-PID@HOSTNAME
    #[arg(long, value_name = "NAME")]
    from: Option<String>,
    /// The communicative act, such as inform, request or query-ref
    #[arg(long, value_name = "P", value_parser = word)]
    performative: Text,
    /// The content
    #[arg(long, value_name = "TEXT", conflicts_with = "content_file")]
    content: Option<String>,
    /// A file that holds the content; - for standard input
    #[arg(long, value_name = "F")]
    content_file: Option<PathBuf>,
    /// The interaction protocol
    #[arg(long, value_name = "P", value_parser = word)]
    protocol: Option<Text>,
    /// The conversation; made up where --wait needs one
    #[arg(long, value_name = "ID")]
    conversation_id: Option<String>,
    /// The language of the content
    #[arg(long, value_name = "L")]
    language: Option<String>,
    /// The ontology of the content
    #[arg(long, value_name = "O")]
    ontology: Option<String>,
    /// The tag that the answer must carry
    #[arg(long, value_name = "R")]
    reply_with: Option<String>,
    /// Seconds within which the outcome must be known
    #[arg(long, value_name = "S", default_value = "10", value_parser = attached::seconds)]
    timeout: Duration,
    /// Then print the replies of the conversation, for so many seconds at most
    #[arg(long, value_name = "S", value_parser = attached::seconds)]
    wait: Option<Duration>,
    /// One JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    control: Control,
}

/// Sends, prints one outcome a receiver, and the replies if they are waited for.
pub fn run(args: &Args) -> Result<(), Failure> {
    let content = content(args)?;
    attached::run(async {
        let platform = args.control.attach().await?;
        let from = match &args.from {
            Some(name) => name.clone(),
            None => attached::own_name(""),
        };
        let message = message(args, &from, content);
        match args.wait {
            None => {
                let outcomes = platform.send_as(message, args.timeout).await;
                report(args, &outcomes)
            }
            Some(wait) => {
                let agent = attach(&platform, &from).await?;
                send_and_wait(args, &agent, message, wait).await
            }
        }
    })
}

/// A performative or protocol, which can only be written as a word.
fn word(text: &str) -> Result<Text, String> {
    let word = Text::from(text);
    match word.is_word() {
        true => Ok(word),
        false => Err("it must be one ASCII word, not beginning with a digit, # - or @".to_owned()),
    }
}

fn content(args: &Args) -> Result<Option<Bytes>, Failure> {
    match (&args.content, &args.content_file) {
        (Some(text), _) => Ok(Some(Bytes::from(text.clone()))),
        (None, Some(path)) => streams::read_input(path).map(Some),
        (None, None) => Ok(None),
    }
}

fn message(args: &Args, from: &str, content: Option<Bytes>) -> Message {
    let mut message = Message::new(Performative::from(args.performative.clone()))
        .from_agent(from)
        .to(args.to.as_str());
    message.content = content;
    message.protocol = args.protocol.clone();
    message.language = args.language.as_deref().map(Into::into);
    message.ontology = args.ontology.as_deref().map(Into::into);
    message.reply_with = args.reply_with.as_deref().map(Into::into);
    message.conversation_id = args.conversation_id.as_deref().map(Into::into);
    if args.wait.is_some() && message.conversation_id.is_none() {
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let nanos = now.unwrap_or_default().as_nanos();
        message = message.conversation_id(format!("{from}-{nanos:x}"));
    }
    message
}

/// The agent to which the replies come. Those to a name that somebody else holds go there.
async fn attach(platform: &Platform, from: &str) -> Result<Agent, Failure> {
    platform.agent(from).await.map_err(|error| match error {
        fipa::Error::Register(RegisterError::Refused(_) | RegisterError::Held(_)) => {
            Failure::malformed(format_args!(
                "--wait needs a name of its own, and {from} is held by another connection, \
                 to which the replies go"
            ))
        }
        error => attached::failure_of(error),
    })
}

async fn send_and_wait(
    args: &Args,
    agent: &Agent,
    message: Message,
    wait: Duration,
) -> Result<(), Failure> {
    let conversation = message.conversation_id.clone();
    let endless = matches!(
        message.performative,
        Performative::Subscribe | Performative::RequestWhenever | Performative::Cfp
    );
    let outcomes = agent.send_within(message, args.timeout).await;
    let delivered = report(args, &outcomes);
    let mut open: HashSet<Text> = outcomes
        .iter()
        .filter(|outcome| outcome.outcome.is_success())
        .map(|outcome| outcome.to.clone())
        .collect();
    let until = Instant::now() + wait;
    let mut replies = 0;
    let mut returned = None;
    while !open.is_empty() {
        let reply = match tokio::time::timeout_at(until, agent.receive()).await {
            Err(_) => break,
            Ok(Err(error)) => return Err(Failure::environment(error)),
            Ok(Ok(reply)) => reply,
        };
        if reply.conversation_id != conversation {
            continue;
        }
        print_reply(args, &reply)?;
        if let Some(failure) = DeliveryFailure::of(&reply) {
            let failed = |name: &Text| failure.receivers.iter().any(|r| r.name == *name);
            open.retain(|name| !failed(name));
            returned = Some(failure);
            continue;
        }
        replies += 1;
        // An agree is followed by the result; a subscription goes on.
        if !endless
            && reply.performative != Performative::Agree
            && let Some(sender) = &reply.sender
        {
            open.remove(&sender.name);
        }
    }
    delivered?;
    if let Some(failure) = returned {
        return Err(Failure::no(failure));
    }
    if replies == 0 {
        return Err(Failure::no("no reply came"));
    }
    Ok(())
}

fn print_reply(args: &Args, reply: &Message) -> Result<(), Failure> {
    if args.json {
        return print_json(&json!({"message": message_to_json(reply)}));
    }
    let sender = reply.sender.as_ref().map_or("nobody", |s| s.name.as_str());
    let content = reply.content.as_deref().unwrap_or_default();
    print_line(format_args!(
        "{sender}: {} {}",
        reply.performative,
        String::from_utf8_lossy(content)
    ))
}

/// Prints the outcomes; a "no" if any receiver was not reached.
fn report(args: &Args, outcomes: &[ReceiverOutcome]) -> Result<(), Failure> {
    for outcome in outcomes {
        if args.json {
            print_json(&outcome_to_json(outcome))?;
        } else {
            print_line(line(outcome))?;
        }
    }
    let failed = outcomes.iter().filter(|o| !o.outcome.is_success()).count();
    if failed == 0 {
        return Ok(());
    }
    Err(Failure::no(format_args!(
        "{failed} of {} receivers not reached",
        outcomes.len()
    )))
}

fn line(outcome: &ReceiverOutcome) -> String {
    let mut line = format!("{}: {}", outcome.to, outcome.outcome);
    if let Some(via) = &outcome.via {
        line.push_str(&format!(" via {via}"));
    }
    if !outcome.reason.is_empty() {
        line.push_str(&format!(" ({})", outcome.reason));
    }
    line
}
