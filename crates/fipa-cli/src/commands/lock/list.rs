//! `fipa lock list`: what agents own, who holds it, and who waits.

use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use fipa::locks::{self, LockView};
use fipa::{Agent, Field, Outcome, RequestError, Text};
use serde_json::{Value, json};
use tokio::task::JoinSet;

use crate::Failure;
use crate::attached::{self, Control, print_json, print_line};

/// How long an agent may take to say what it owns.
const PATIENCE: Duration = Duration::from_secs(3);

/// The options of `fipa lock list`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// One JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    control: Control,
}

/// Asks every agent that takes part in locks, all at once.
pub(super) fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let platform = args.control.attach().await?;
        let found = platform.search_field(locks::AGENT_TYPE, Field::Type);
        let found = found.map_err(Failure::malformed)?;
        let asker = attached::register(&platform, &attached::own_name("lock-"), None).await?;
        let asker = Arc::new(asker);
        let mut asking = JoinSet::new();
        for record in found {
            asking.spawn(ask(Arc::clone(&asker), record.entry.name));
        }
        let mut views = Vec::new();
        for (name, answer) in asking.join_all().await {
            match answer {
                Ok(owned) => views.extend(owned),
                // Nobody needs to listen there.
                Err(why) => drop(writeln!(io::stderr(), "fipa lock: {name}: {why}")),
            }
        }
        if views.is_empty() {
            return Err(Failure::no("no agent owns anything"));
        }
        views.sort_by(|a, b| (&a.resource, &a.owner).cmp(&(&b.resource, &b.owner)));
        match args.json {
            true => views.iter().try_for_each(|view| print_json(&to_json(view))),
            false => print_table(&views),
        }
    })
}

async fn ask(asker: Arc<Agent>, name: Text) -> (Text, Result<Vec<LockView>, String>) {
    let query = locks::list_query(name.clone());
    let answer = match asker.request(query, PATIENCE).await {
        Ok(answer) => locks::read_list(&answer).map_err(|error| error.to_string()),
        // It has gone meanwhile.
        Err(RequestError::Undelivered {
            outcome: Outcome::Unknown,
            ..
        }) => Ok(Vec::new()),
        Err(error) => Err(error.to_string()),
    };
    (name, answer)
}

fn to_json(view: &LockView) -> Value {
    let waiting: Vec<&str> = view.waiting.iter().map(Text::as_str).collect();
    json!({
        "resource": view.resource.as_str(),
        "owner": view.owner.as_str(),
        "holder": view.holder.as_deref(),
        "waiting": waiting,
        "fencing": view.fencing,
    })
}

fn print_table(views: &[LockView]) -> Result<(), Failure> {
    let rows = views.iter().map(|view| {
        let fencing = view.fencing.map(|number| number.to_string());
        let waiting: Vec<&str> = view.waiting.iter().map(Text::as_str).collect();
        [
            view.resource.to_string(),
            view.owner.to_string(),
            view.holder.as_deref().unwrap_or("-").to_owned(),
            fencing.unwrap_or_else(|| "-".to_owned()),
            waiting.join(","),
        ]
    });
    let head = ["RESOURCE", "OWNER", "HOLDER", "FENCING", "WAITING"].map(str::to_owned);
    let rows: Vec<[String; 5]> = std::iter::once(head).chain(rows).collect();
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.max().unwrap_or_default()
    };
    let [resource, owner, holder, fencing] = [0, 1, 2, 3].map(width);
    rows.iter().try_for_each(|[r, o, h, f, waiting]| {
        let line = format!("{r:resource$}  {o:owner$}  {h:holder$}  {f:fencing$}  {waiting}");
        print_line(line.trim_end())
    })
}
