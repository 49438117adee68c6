//! `fipa hiac devices`: what is behind the daemon.

use fipa::{Field, Record};
use fipa_gateway::HIAC_DEVICE;
use serde_json::json;

use crate::Failure;
use crate::attached::{self, Control, print_json, print_line};

/// The options of `fipa hiac devices`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// One JSON object a line
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    control: Control,
}

/// Lists the devices.
pub(super) fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let platform = args.control.attach().await?;
        let found = platform
            .search_field(&format!("{HIAC_DEVICE}.*"), Field::Description)
            .map_err(Failure::malformed)?;
        let own = format!("@{}", platform.name());
        let devices: Vec<Record> = found
            .into_iter()
            .filter(|record| record.entry.name.ends_with(&own))
            .collect();
        if devices.is_empty() {
            return Err(Failure::no("there is no device"));
        }
        devices.iter().try_for_each(|record| {
            let (name, description) = (record.entry.name.as_str(), &record.entry.description);
            let address = description.strip_prefix(HIAC_DEVICE).unwrap_or_default();
            if args.json {
                return print_json(&json!({"name": name, "address": address}));
            }
            print_line(format_args!("{address}  {name}"))
        })
    })
}
