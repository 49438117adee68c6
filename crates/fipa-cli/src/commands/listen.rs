//! `fipa listen`: an agent that prints what it is sent.

use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use fipa::{Agent, Letter, Message, Monitoring, Platform};
use fipa_conversation::{Config, Monitor, Verdict};
use fipa_json::{Body, letter_to_json};
use fipa_protocol::Library;

use crate::attached::{self, Control, print_json, print_line};
use crate::{Failure, verdicts};

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
    /// Say of each message what it is by its interaction protocol, and what would have been legal;
    /// with --json as JSON on standard error
    #[arg(long)]
    explain: bool,
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
        let mut explainer = args.explain.then(|| Explainer::new(&agent));
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
            let verdict = match (&mut explainer, &message) {
                (Some(explainer), Ok(message)) => Some(explainer.judge(&platform, message)),
                _ => None,
            };
            print(args, &letter, message)?;
            printed += 1;
            if let Some(verdict) = verdict {
                explain(args, printed, &verdict)?;
            }
        }
        Ok(())
    })
}

/// Judges what comes. An agent that says nothing sees one half of its conversations only.
struct Explainer(Monitor);

impl Explainer {
    fn new(agent: &Agent) -> Explainer {
        agent.set_monitoring(Monitoring::Off);
        let protocols = Arc::new(Library::builtin());
        let own = Some(agent.name().clone());
        Explainer(Monitor::new(protocols, own, Config::default()))
    }

    fn judge(&mut self, platform: &Platform, message: &Message) -> Verdict {
        let now = platform.now();
        self.0.handle_timeout(now);
        let verdict = self.0.observe(now, message);
        // The verdicts are all that is told.
        while self.0.poll_event().is_some() {}
        verdict
    }
}

/// A line below the message; with `--json` on standard error, so that standard output stays one
/// letter a line.
fn explain(args: &Args, number: u64, verdict: &Verdict) -> Result<(), Failure> {
    if args.json {
        // Nobody needs to listen there.
        let _ = writeln!(io::stderr(), "{}", verdicts::to_json(number, verdict));
        return Ok(());
    }
    match verdict {
        Verdict::Accepted { state } => print_line(format_args!("  accepted: {state}")),
        Verdict::Violation(violation) => print_line(format_args!(
            "  violation [{}]: {violation}",
            violation.rule
        )),
        Verdict::NotMonitored => print_line("  not monitored: no known protocol and conversation"),
    }
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
