//! `fipa agents`: who is known.

use fipa::{Change, ChangeKind, Field, Now, Platform, Record, State};
use fipa_json::record_to_json;
use serde_json::json;

use crate::Failure;
use crate::attached::{self, Control, print_json, print_line};

/// The options of `fipa agents`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A regular expression that must match all of the field
    #[arg(value_name = "REGEX", default_value = ".*")]
    pattern: String,
    /// The field to look at
    #[arg(long, value_enum, default_value = "name")]
    field: FieldName,
    /// List those as well that went within the last 24 hours
    #[arg(long)]
    gone: bool,
    /// Tell what changes until interrupted; begins with what is there
    #[arg(long)]
    watch: bool,
    /// One JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    control: Control,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum FieldName {
    Name,
    Type,
    Description,
    Location,
}

impl From<FieldName> for Field {
    fn from(field: FieldName) -> Field {
        match field {
            FieldName::Name => Field::Name,
            FieldName::Type => Field::Type,
            FieldName::Description => Field::Description,
            FieldName::Location => Field::Location,
        }
    }
}

/// Lists agents, or tells of changes.
pub fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let interrupted = attached::interrupted()?;
        let platform = args.control.attach().await?;
        if args.watch {
            return watch(args, &platform, interrupted).await;
        }
        let found = search(args, &platform)?;
        if found.is_empty() {
            return Err(Failure::no(format_args!(
                "no agent matches {:?}",
                args.pattern
            )));
        }
        let now = platform.now();
        if args.json {
            found
                .iter()
                .try_for_each(|record| print_json(&record_to_json(record, now)))
        } else {
            print_table(&found, now)
        }
    })
}

fn search(args: &Args, platform: &Platform) -> Result<Vec<Record>, Failure> {
    let field = args.field.into();
    let mut found = platform
        .search_field(&args.pattern, field)
        .map_err(Failure::malformed)?;
    if args.gone {
        let gone = platform.search_gone(&args.pattern, field);
        found.extend(gone.map_err(Failure::malformed)?);
        found.sort_by(|a, b| a.entry.name.cmp(&b.entry.name));
    }
    Ok(found)
}

async fn watch(
    args: &Args,
    platform: &Platform,
    interrupted: impl Future<Output = ()>,
) -> Result<(), Failure> {
    let pattern = fipa::Pattern::new(&args.pattern).map_err(Failure::malformed)?;
    let mut changes = platform.watch();
    for record in search(args, platform)? {
        let event = match record.state {
            State::Gone => "removed",
            _ => "added",
        };
        tell(args, platform, event, &record)?;
    }
    tokio::pin!(interrupted);
    loop {
        let change = tokio::select! {
            change = changes.next() => change,
            () = &mut interrupted => return Ok(()),
        };
        let Some(Change { kind, record }) = change else {
            return Err(Failure::environment("the daemon is gone"));
        };
        if pattern.matches_field(&record, args.field.into()) {
            let event = match kind {
                ChangeKind::Added => "added",
                ChangeKind::Changed => "changed",
                ChangeKind::Removed => "removed",
                ChangeKind::Conflict => "conflict",
            };
            tell(args, platform, event, &record)?;
        }
    }
}

fn tell(args: &Args, platform: &Platform, event: &str, record: &Record) -> Result<(), Failure> {
    if args.json {
        let agent = record_to_json(record, platform.now());
        return print_json(&json!({"event": event, "agent": agent}));
    }
    let state = record.state.as_str();
    print_line(format_args!(
        "{event:8}  {}  {state}  {}",
        record.entry.name,
        places(record)
    ))
}

fn print_table(records: &[Record], now: Now) -> Result<(), Failure> {
    let names = records.iter().map(|r| r.entry.name.chars().count());
    let width = names.max().unwrap_or(0).max(4);
    print_line(format_args!(
        "{:width$}  STATE    SOURCE  AGE     LOCATIONS  DESCRIPTION",
        "NAME"
    ))?;
    records.iter().try_for_each(|record| {
        let age = now.mono.saturating_sub(record.since).as_secs();
        print_line(format_args!(
            "{:width$}  {:7}  {:6}  {:6}  {}  {}",
            record.entry.name,
            record.state.as_str(),
            record.source.as_str(),
            age_text(age),
            places(record),
            record.entry.description,
        ))
    })
}

fn places(record: &Record) -> String {
    let addresses = record.entry.locations.iter().map(|l| l.address.as_str());
    match addresses.collect::<Vec<_>>().join(",") {
        none if none.is_empty() => "-".to_owned(),
        places => places,
    }
}

fn age_text(seconds: u64) -> String {
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7200 => format!("{} min", seconds / 60),
        _ => format!("{} h", seconds / 3600),
    }
}
