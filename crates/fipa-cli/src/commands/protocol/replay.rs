use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use fipa_acl::Message;
use fipa_conversation::{Conversation, Verdict, Violation};
use fipa_directory::Now;
use fipa_json::message_from_json;
use fipa_protocol::{Library, Protocol};

use crate::json_values::JsonValues;
use crate::{Failure, streams, verdicts};

/// The options of `fipa protocol replay`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// An SCXML file
    file: PathBuf,
    /// The messages of one conversation as JSON lines; - is standard input
    #[arg(long, value_name = "JSONL")]
    messages: PathBuf,
    /// Insist on an end: every participant in a final state
    #[arg(long)]
    complete: bool,
    /// Print one JSON object for each message
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let protocol = super::protocol(&args.file)?;
    let input = streams::read_input(&args.messages)?;
    let shown = args.messages.display();
    let messages =
        messages(&input).map_err(|error| Failure::malformed(format_args!("{shown}:{error}")))?;
    streams::write_output(|output| replay(protocol, &messages, args, output))
}

/// All messages of an input; letters, as other commands print them, count as their messages.
fn messages(input: &[u8]) -> Result<Vec<Message>, String> {
    JsonValues::new(input)
        .map(|value| {
            let (position, value) = value.map_err(|failure| failure.to_string())?;
            message_from_json(value.get("message").unwrap_or(&value))
                .map_err(|error| format!("{position}: {error}"))
        })
        .collect()
}

/// Judges the messages one after the other, up to the first violation.
fn replay(
    protocol: Protocol,
    messages: &[Message],
    args: &Args,
    output: &mut dyn Write,
) -> Result<(), Failure> {
    let mut library = Library::builtin();
    let protocol = library.add(protocol);
    let mut conversation = Conversation::new(Arc::clone(&protocol), None);
    // The messages do not say when they were sent: nothing is late.
    let now = Now::default();
    for (n, message) in (1..).zip(messages) {
        match conversation.observe(&library, now, message) {
            Verdict::Accepted { state } => accepted(args, n, message, &state, output)?,
            // One of another conversation within this one, by a protocol that is not known.
            Verdict::NotMonitored => accepted(args, n, message, &conversation.state(), output)?,
            Verdict::Violation(violation) => {
                violated(args, n, message, &violation, output)?;
                return Err(Failure::no(format_args!("message {n}: {violation}")));
            }
        }
    }
    if args.complete && !conversation.is_complete() {
        return Err(Failure::no(unfinished(&conversation, messages.len())));
    }
    Ok(())
}

fn unfinished(conversation: &Conversation, messages: usize) -> String {
    let participants = conversation.participants();
    let open = participants
        .iter()
        .find(|participant| participant.outcome.is_none());
    let protocol = conversation.protocol().name();
    let state = open.map_or_else(
        || conversation.state(),
        |participant| participant.state.clone(),
    );
    format!("after {messages} messages, {protocol} is in the state {state}, where it does not end")
}

fn accepted(
    args: &Args,
    n: u64,
    message: &Message,
    state: &str,
    output: &mut dyn Write,
) -> Result<(), Failure> {
    if args.json {
        writeln!(output, "{}", verdicts::accepted(n, state))?;
    } else {
        writeln!(output, "{n}  {}  {state}", said(message))?;
    }
    Ok(())
}

fn violated(
    args: &Args,
    n: u64,
    message: &Message,
    violation: &Violation,
    output: &mut dyn Write,
) -> Result<(), Failure> {
    if args.json {
        writeln!(output, "{}", verdicts::violated(n, violation))?;
    } else {
        writeln!(
            output,
            "{n}  {}  violation [{}]: {violation}",
            said(message),
            violation.rule
        )?;
    }
    Ok(())
}

/// `a -> b, c: act`.
fn said(message: &Message) -> String {
    let sender = message
        .sender
        .as_ref()
        .map_or("-", |sender| sender.name.as_str());
    let receivers: Vec<&str> = message
        .receiver
        .iter()
        .map(|receiver| receiver.name.as_str())
        .collect();
    format!(
        "{sender} -> {}: {}",
        receivers.join(", "),
        message.performative
    )
}
