use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;

use fipa_acl::Message;
use fipa_conversation::{Conversation, Verdict, Violation};
use fipa_protocol::{Library, Protocol};
use serde_json::Value;

use super::recorded::{Recorded, Said, id_of};
use crate::{Failure, streams, verdicts};

/// The options of `fipa protocol replay`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// An SCXML file
    file: PathBuf,
    /// The messages of one conversation as JSON lines, or a letter log; - is standard input
    #[arg(long, value_name = "JSONL")]
    messages: PathBuf,
    /// Only this conversation; else, of a letter log, each one that begins by the protocol
    #[arg(long, value_name = "ID")]
    conversation_id: Option<String>,
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
    let mut library = Library::builtin();
    let protocol = library.add(protocol);
    let id = args.conversation_id.as_deref();
    let recorded = Recorded::read(&input, &protocol, &library, id)
        .map_err(|error| Failure::malformed(format_args!("{shown}:{error}")))?;
    if recorded.lost > 0 {
        // Nobody needs to listen there.
        let lost = recorded.lost;
        let _ = writeln!(io::stderr(), "{shown}: {lost} letters are missing in it");
    }
    let is_chosen = recorded.is_log || id.is_some();
    if is_chosen && recorded.conversations.iter().all(Vec::is_empty) {
        let what = match id {
            Some(id) => format!("conversation {id}"),
            None => format!("conversation by {}", protocol.name()),
        };
        return Err(Failure::no(format_args!("there is no {what} in {shown}")));
    }
    streams::write_output(|output| {
        let mut replay = Replay {
            args,
            library: &library,
            is_log: recorded.is_log,
            output,
        };
        replay.all(&protocol, &recorded.conversations)
    })
}

/// Judges messages one after the other.
struct Replay<'a> {
    args: &'a Args,
    library: &'a Library,
    /// Whether it is said of which conversation each is.
    is_log: bool,
    output: &'a mut dyn Write,
}

impl Replay<'_> {
    /// Each conversation up to its first violation. What is wrong with the first one is the answer.
    fn all(&mut self, protocol: &Arc<Protocol>, all: &[Vec<Said>]) -> Result<(), Failure> {
        let mut wrong: Vec<String> = Vec::new();
        for said in all {
            let id = said.first().and_then(|first| id_of(&first.message));
            let heading = match (self.is_log, id) {
                (true, Some(id)) => format!("conversation {id}: "),
                _ => String::new(),
            };
            if all.len() > 1 && !self.args.json {
                writeln!(self.output, "{}", heading.trim_end())?;
            }
            let found = self.one(protocol, said)?;
            wrong.extend(found.map(|found| heading + &found));
        }
        match &wrong[..] {
            [] => Ok(()),
            [only] => Err(Failure::no(only)),
            [first, others @ ..] => {
                let others = others.len();
                Err(Failure::no(format_args!("{first} (and {others} more)")))
            }
        }
    }

    /// What is wrong with a conversation, if anything is.
    fn one(&mut self, protocol: &Arc<Protocol>, all: &[Said]) -> Result<Option<String>, Failure> {
        let mut conversation = Conversation::new(Arc::clone(protocol), None);
        for (n, Said { now, message }) in (1..).zip(all) {
            match conversation.observe(self.library, *now, message) {
                Verdict::Accepted { state } => self.accepted(n, message, &state)?,
                // One of another conversation within this one, by a protocol that is not known.
                Verdict::NotMonitored => self.accepted(n, message, &conversation.state())?,
                Verdict::Violation(violation) => {
                    self.violated(n, message, &violation)?;
                    return Ok(Some(format!("message {n}: {violation}")));
                }
            }
        }
        let is_open = self.args.complete && !conversation.is_complete();
        Ok(is_open.then(|| unfinished(&conversation, all.len())))
    }

    fn accepted(&mut self, n: u64, message: &Message, state: &str) -> Result<(), Failure> {
        if self.args.json {
            return self.json(verdicts::accepted(n, state), message);
        }
        writeln!(self.output, "{n}  {}  {state}", said(message))?;
        Ok(())
    }

    fn violated(&mut self, n: u64, message: &Message, why: &Violation) -> Result<(), Failure> {
        if self.args.json {
            return self.json(verdicts::violated(n, why), message);
        }
        let (said, rule) = (said(message), why.rule);
        writeln!(self.output, "{n}  {said}  violation [{rule}]: {why}")?;
        Ok(())
    }

    fn json(&mut self, mut verdict: Value, message: &Message) -> Result<(), Failure> {
        if self.is_log {
            verdict["conversation-id"] = id_of(message).into();
        }
        writeln!(self.output, "{verdict}")?;
        Ok(())
    }
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
