//! `fipa ams`: the white pages of a platform.

use std::time::Duration;

use fipa::{Address, Agent, AgentId, RequestError};
use fipa_json::agent_id_to_json;
use fipa_management::{AgentState, AmsAgentDescription, SearchConstraints, client};
use serde_json::json;

use super::df::{ask, unanswered};
use crate::Failure;
use crate::attached::{self, Control, print_json, print_line};

/// The options of `fipa ams`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub what: What,
}

/// The commands of `fipa ams`.
#[derive(Debug, clap::Subcommand)]
pub enum What {
    /// List the agents of a platform
    List(List),
}

/// The options of `fipa ams list`.
#[derive(Debug, clap::Args)]
pub struct List {
    /// The platform: http://HOST:PORT/PATH, with #NAME if its name is not to be found out; or the
    /// name of an AMS that is known
    #[arg(value_name = "ADDRESS")]
    address: String,
    /// Seconds to wait for each answer
    #[arg(long, value_name = "S", default_value = "10", value_parser = attached::seconds)]
    timeout: Duration,
    /// One JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    control: Control,
}

/// Lists the agents of a platform.
///
/// # Errors
/// Exit code 1 if the platform does not answer, 2 if the address is none.
pub fn run(args: &Args) -> Result<(), Failure> {
    let What::List(args) = &args.what;
    attached::run(list(args))
}

async fn list(args: &List) -> Result<(), Failure> {
    let platform = args.control.attach().await?;
    let agent = attached::register(&platform, &attached::own_name("ams-"), None).await?;
    let ams = ams_at(&agent, &args.address, args.timeout).await?;
    let question = client::ams_description_request(&ams);
    let answer = ask(&agent, question, args.timeout).await?;
    let described = client::description_result(&answer).map_err(Failure::no)?;
    let all = AmsAgentDescription::default();
    let question = client::ams_search_request(&ams, &all, &SearchConstraints::all());
    let answer = ask(&agent, question, args.timeout).await?;
    let found = client::agents_result(&answer).map_err(Failure::no)?;
    found
        .into_iter()
        .try_for_each(|one| show(args, &one.at(&described)))
}

fn show(args: &List, one: &AmsAgentDescription) -> Result<(), Failure> {
    let name = one.name.clone().unwrap_or_default();
    let state = one.state.as_ref().map(AgentState::as_str);
    if args.json {
        let ownership = one.ownership.as_deref();
        return print_json(&json!({
            "name": agent_id_to_json(&name), "ownership": ownership, "state": state,
        }));
    }
    let addresses: Vec<&str> = name.addresses.iter().map(|url| url.as_str()).collect();
    let state = state.unwrap_or("-");
    print_line(format_args!("{name}  {state}  {}", addresses.join(" ")))
}

/// The AMS that is meant. Whatever AMS answers at a URL, be it that it does not know the agent that
/// was asked, says by its own name which platform it manages.
async fn ams_at(agent: &Agent, address: &str, timeout: Duration) -> Result<AgentId, Failure> {
    if !address.contains("://") {
        return Ok(AgentId::new(address));
    }
    let url = match address.parse() {
        Ok(url @ Address::Http { .. }) => url.to_text(),
        Ok(_) => {
            return Err(Failure::malformed(format_args!(
                "{address:?} is no http:// URL"
            )));
        }
        Err(error) => return Err(Failure::malformed(error)),
    };
    if let Some((_, name)) = address.split_once('#') {
        return Ok(AgentId::new(format!("ams@{name}")).address(url));
    }
    let nobody = AgentId::new("ams@unknown").address(url.clone());
    let question = client::ams_description_request(&nobody);
    let sender = match agent.request(question, timeout).await {
        Ok(answer) => answer.sender,
        Err(RequestError::Returned(failure)) => failure.service,
        Err(error) => return Err(unanswered(error)),
    };
    let sender = sender.map(|sender| sender.name).unwrap_or_default();
    match sender.split_once('@') {
        Some((role, _)) if role.eq_ignore_ascii_case("ams") => {
            Ok(AgentId::new(sender).address(url))
        }
        _ => Err(Failure::no(format_args!(
            "{sender} answered, which is no AMS"
        ))),
    }
}
