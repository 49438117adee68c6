//! `fipa sniff`: what passes the daemon, or passed it.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use fipa::{Passed, Pattern, Sniffer, open_letter};
use fipa_json::sniffed_to_json;
use serde_json::Value;

use crate::attached::{self, Control, print_json, print_line};
use crate::chart::{to_svg, to_text};
use crate::sniffed::{Entry, charts, lines};
use crate::{Failure, streams};

/// The options of `fipa sniff`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Only what an agent whose name matches all of this regular expression says or is told
    #[arg(long, value_name = "REGEX")]
    agent: Option<String>,
    /// A letter log to read instead of watching a daemon; - is standard input
    #[arg(long, value_name = "LOG")]
    file: Option<PathBuf>,
    /// As lines while it passes, or as a sequence chart of each conversation in the end
    #[arg(long, value_enum, default_value = "lines")]
    format: Format,
    /// One JSON object a line, as in a letter log
    #[arg(long, conflicts_with = "format")]
    json: bool,
    #[command(flatten)]
    control: Control,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Lines,
    Chart,
    Svg,
}

/// How long the daemon may take to tell what is under way when the watch ends.
const LINGER: Duration = Duration::from_secs(1);

/// Shows what passes until interrupted, or what a log holds. A line of a log that cannot be read is
/// reported and passed over; the command then ends with 2.
pub fn run(args: &Args) -> Result<(), Failure> {
    let agent = args.agent.as_deref().map(Pattern::new).transpose();
    let mut show = Show {
        agent: agent.map_err(Failure::malformed)?,
        format: args.format,
        json: args.json,
        kept: Vec::new(),
    };
    match &args.file {
        Some(file) => read(file, &mut show),
        None => watch(args, &mut show),
    }
}

/// Shows what it is given, at once or in the end.
struct Show {
    agent: Option<Pattern>,
    format: Format,
    json: bool,
    kept: Vec<Entry>,
}

impl Show {
    fn take(&mut self, line: &Value, entry: Entry) -> Result<(), Failure> {
        let is_wanted = |agent: &Pattern| entry.concerns(agent);
        let is_wanted = self.agent.as_ref().is_none_or(is_wanted);
        match self.format {
            _ if self.json && is_wanted => print_json(line),
            Format::Lines if is_wanted => lines(&entry).into_iter().try_for_each(print_line),
            // All of a conversation is needed to judge what is drawn of it.
            Format::Chart | Format::Svg => {
                self.kept.push(entry.with_message(line));
                Ok(())
            }
            Format::Lines => Ok(()),
        }
    }

    fn finish(&mut self) -> Result<(), Failure> {
        let charts = charts(std::mem::take(&mut self.kept), self.agent.as_ref());
        let drawn = match self.format {
            Format::Svg => to_svg(&charts),
            _ => charts.iter().map(to_text).collect::<Vec<_>>().join("\n"),
        };
        if !self.json && self.format != Format::Lines {
            streams::write_output(|output| Ok(output.write_all(drawn.as_bytes())?))?;
        }
        Ok(())
    }
}

/// A log holds letters in the order in which their outcomes were known; they are shown in the order
/// in which they came.
fn read(file: &Path, show: &mut Show) -> Result<(), Failure> {
    let log = streams::read_input(file)?;
    let mut entries: Vec<(Value, Entry)> = Vec::new();
    let mut wrong: Option<Failure> = None;
    for (number, line) in log.split(|octet| *octet == b'\n').enumerate() {
        if line.trim_ascii().is_empty() {
            continue;
        }
        let value = serde_json::from_slice::<Value>(line).map_err(|error| error.to_string());
        match value.and_then(|value| Ok((Entry::read(&value)?, value))) {
            Ok((entry, value)) => entries.push((value, entry)),
            Err(reason) => {
                let failure = Failure::malformed(format_args!("line {}: {reason}", number + 1));
                if let Some(before) = wrong.replace(failure) {
                    // Nobody needs to listen there.
                    let _ = writeln!(io::stderr(), "fipa sniff: {before}");
                }
            }
        }
    }
    entries.sort_by(|(_, a), (_, b)| a.order().cmp(&b.order()));
    for (value, entry) in entries {
        show.take(&value, entry)?;
    }
    show.finish()?;
    wrong.map_or(Ok(()), Err)
}

fn watch(args: &Args, show: &mut Show) -> Result<(), Failure> {
    attached::run(async {
        let interrupted = attached::interrupted()?;
        let platform = args.control.attach().await?;
        let mut sniffer = platform.sniff();
        let mut said = false;
        tokio::pin!(interrupted);
        loop {
            tokio::select! {
                sniffed = sniffer.next() => match sniffed {
                    None => {
                        show.finish()?;
                        return Err(Failure::environment("the daemon is gone"));
                    }
                    Some(sniffed) => {
                        take(show, &sniffed)?;
                        if !std::mem::replace(&mut said, true) {
                            // Nobody needs to listen there.
                            let _ = writeln!(io::stderr(), "watching {}", platform.name());
                        }
                    }
                },
                () = &mut interrupted => break,
            }
        }
        sniffer.finish();
        // A daemon that stands still tells nothing more.
        if let Ok(rest) = tokio::time::timeout(LINGER, rest(show, &mut sniffer)).await {
            rest?;
        }
        show.finish()
    })
}

/// What is under way when the watch ends.
async fn rest(show: &mut Show, sniffer: &mut Sniffer) -> Result<(), Failure> {
    while let Some(sniffed) = sniffer.next().await {
        take(show, &sniffed)?;
        if sniffed.passed == Passed::End {
            break;
        }
    }
    Ok(())
}

fn take(show: &mut Show, sniffed: &fipa::Sniffed) -> Result<(), Failure> {
    for line in sniffed_to_json(sniffed, open_letter) {
        let entry = Entry::read(&line).map_err(Failure::environment)?;
        show.take(&line, entry)?;
    }
    Ok(())
}
