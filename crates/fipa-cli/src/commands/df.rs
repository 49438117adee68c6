//! `fipa df`: the yellow pages of a platform.

use std::time::Duration;

use fipa::{Agent, AgentId, FipaTime, Platform, RequestError, Text};
use fipa_json::agent_id_to_json;
use fipa_management::{DfAgentDescription, SearchConstraints, ServiceDescription, client};
use serde_json::{Map, Value, json};

use crate::Failure;
use crate::attached::{self, Control, print_json, print_line};

/// The options of `fipa df`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub what: What,
}

/// The commands of `fipa df`.
#[derive(Debug, clap::Subcommand)]
pub enum What {
    /// Find agents by what they offer
    Search(Search),
    /// Say what an agent offers, in the place of what was said before
    Register(Box<Register>),
    /// Tell what is offered, now and whenever it changes
    Subscribe(Subscribe),
    /// Have the DF of the daemon registered with another one, whose searches then come to it as well
    Federate(Federate),
}

/// What is looked for; what is not given matches everything.
#[derive(Debug, clap::Args)]
struct Wanted {
    /// The type of a service
    #[arg(long, value_name = "T")]
    service_type: Option<String>,
    /// The name of a service
    #[arg(long, value_name = "N")]
    service_name: Option<String>,
    /// An ontology that the agent knows
    #[arg(long, value_name = "O")]
    ontology: Option<String>,
    /// Descriptions at most [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(i64).range(1..))]
    max: Option<i64>,
}

/// Which DF, and how.
#[derive(Debug, clap::Args)]
struct Asked {
    /// The DF to ask [default: that of the daemon]
    #[arg(long, value_name = "NAME")]
    df: Option<String>,
    /// Seconds to wait for the answer
    #[arg(long, value_name = "S", default_value = "10", value_parser = attached::seconds)]
    timeout: Duration,
    /// One JSON object a line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    control: Control,
}

/// The options of `fipa df search`.
#[derive(Debug, clap::Args)]
pub struct Search {
    #[command(flatten)]
    wanted: Wanted,
    /// How many DFs away those are asked that are federated with it; below zero: any number
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    depth: Option<i64>,
    #[command(flatten)]
    asked: Asked,
}

/// The options of `fipa df register`.
#[derive(Debug, clap::Args)]
pub struct Register {
    /// The agent, which must be attached
    #[arg(long = "as", value_name = "NAME")]
    agent: String,
    /// The type of the service
    #[arg(long, value_name = "T")]
    service_type: String,
    /// The name of the service
    #[arg(long, value_name = "N")]
    service_name: String,
    /// An ontology that the agent knows
    #[arg(long, value_name = "O")]
    ontology: Option<String>,
    /// A property of the service, repeatable
    #[arg(long, value_name = "NAME=VALUE", value_parser = property)]
    property: Vec<(String, String)>,
    /// Seconds after which it is forgotten [default: never]
    #[arg(long, value_name = "S", value_parser = attached::seconds)]
    lease: Option<Duration>,
    #[command(flatten)]
    asked: Asked,
}

/// The options of `fipa df subscribe`.
#[derive(Debug, clap::Args)]
pub struct Subscribe {
    #[command(flatten)]
    wanted: Wanted,
    #[command(flatten)]
    asked: Asked,
}

/// The options of `fipa df federate`.
#[derive(Debug, clap::Args)]
pub struct Federate {
    /// The other DF, by a name that is known
    #[arg(value_name = "DF")]
    parent: String,
    /// End the registration
    #[arg(long)]
    leave: bool,
    /// Seconds to wait for the other DF
    #[arg(long, value_name = "S", default_value = "15", value_parser = attached::seconds)]
    timeout: Duration,
    #[command(flatten)]
    control: Control,
}

/// Does what the options say.
///
/// # Errors
/// Exit code 1 if nothing is found, or the DF says no or nothing.
pub fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        match &args.what {
            What::Search(search) => find(search).await,
            What::Register(register) => enter(register).await,
            What::Subscribe(subscribe) => watch(subscribe).await,
            What::Federate(federate) => join(federate).await,
        }
    })
}

fn property(text: &str) -> Result<(String, String), String> {
    let parts = text.split_once('=');
    let (name, value) = parts.ok_or_else(|| format!("{text:?} is not NAME=VALUE"))?;
    Ok((name.to_owned(), value.to_owned()))
}

impl Wanted {
    fn template(&self) -> DfAgentDescription {
        let ontologies = self.ontology.iter().map(|o| Text::from(o.as_str()));
        let template = DfAgentDescription {
            ontologies: ontologies.collect(),
            ..DfAgentDescription::default()
        };
        if self.service_type.is_none() && self.service_name.is_none() {
            return template;
        }
        template.service(ServiceDescription {
            name: self.service_name.as_deref().map(Text::from),
            kind: self.service_type.as_deref().map(Text::from),
            ..ServiceDescription::default()
        })
    }

    fn constraints(&self, depth: Option<i64>) -> SearchConstraints {
        let all = SearchConstraints::all();
        SearchConstraints {
            max_depth: depth,
            max_results: self.max.or(all.max_results),
            ..all
        }
    }
}

impl Asked {
    async fn agent(&self) -> Result<(Platform, Agent, AgentId), Failure> {
        let platform = self.control.attach().await?;
        let agent = attached::register(&platform, &attached::own_name("df-"), None).await?;
        let df = match &self.df {
            Some(df) => AgentId::new(df.as_str()),
            None => AgentId::new(format!("df@{}", platform.name())),
        };
        Ok((platform, agent, df))
    }

    fn show(&self, description: &DfAgentDescription) -> Result<(), Failure> {
        if self.json {
            return print_json(&to_json(description));
        }
        let name = description.name.as_ref();
        let name = name.map(|name| name.name.as_str()).unwrap_or_default();
        let services = description.services.iter().map(|service| {
            let text = |text: &Option<Text>| text.clone().unwrap_or_default();
            format!("{} ({})", text(&service.name), text(&service.kind))
        });
        let services = services.collect::<Vec<_>>().join(", ");
        print_line(format_args!("{name}  {services}"))
    }
}

/// Asks and reads the answer.
pub(super) async fn ask(
    agent: &Agent,
    question: fipa::Message,
    timeout: Duration,
) -> Result<fipa::Message, Failure> {
    let answer = agent.request(question, timeout).await;
    answer.map_err(unanswered)
}

/// Why a question has no answer.
pub(super) fn unanswered(error: RequestError) -> Failure {
    match error {
        RequestError::Ended => Failure::environment(error),
        error => Failure::no(error),
    }
}

async fn find(args: &Search) -> Result<(), Failure> {
    let (_platform, agent, df) = args.asked.agent().await?;
    let (template, constraints) = (args.wanted.template(), args.wanted.constraints(args.depth));
    let question = client::df_search_request(&df, &template, &constraints);
    let answer = ask(&agent, question, args.asked.timeout).await?;
    let found = client::search_result(&answer).map_err(Failure::no)?;
    if found.is_empty() {
        return Err(Failure::no(format_args!("{df} knows nothing like that")));
    }
    found.iter().try_for_each(|found| args.asked.show(found))?;
    warn_of_more(&df, &answer);
    Ok(())
}

/// Nobody shall take what was printed for all that there is.
fn warn_of_more(df: &AgentId, told: &fipa::Message) {
    if client::has_more(told) {
        let name = &df.name;
        eprintln!("fipa: {name} knows more than it tells at once: look for something narrower");
    }
}

async fn enter(args: &Register) -> Result<(), Failure> {
    let (platform, agent, df) = args.asked.agent().await?;
    let timeout = args.asked.timeout;
    let mut service =
        ServiceDescription::new(args.service_name.as_str(), args.service_type.as_str());
    for (name, value) in &args.property {
        service = service.property(name.as_str(), value.as_str());
    }
    let until = args
        .lease
        .map(|lease| platform.now().plus(lease).unix_millis);
    let description = DfAgentDescription {
        ontologies: args
            .ontology
            .iter()
            .map(|o| Text::from(o.as_str()))
            .collect(),
        lease_time: until.map(FipaTime::from_unix_millis),
        ..DfAgentDescription::of(reached(&platform, &agent, &args.agent, timeout).await?)
    };
    let description = description.service(service);
    let question = client::df_register_request(&df, &description);
    let answer = ask(&agent, question, timeout).await?;
    let registered = match client::registered(&answer) {
        Err(client::AnswerError::Failed(fipa_management::Reason::AlreadyRegistered)) => {
            let question = client::df_modify_request(&df, &description);
            client::registered(&ask(&agent, question, timeout).await?)
        }
        registered => registered,
    };
    args.asked.show(&registered.map_err(Failure::no)?)
}

/// An agent of the platform with the addresses under which others reach it, as the AMS tells.
async fn reached(
    platform: &Platform,
    agent: &Agent,
    name: &str,
    timeout: Duration,
) -> Result<AgentId, Failure> {
    let ams = AgentId::new(format!("ams@{}", platform.name()));
    let template = fipa_management::AmsAgentDescription {
        name: Some(AgentId::new(name)),
        ..fipa_management::AmsAgentDescription::default()
    };
    let question = client::ams_search_request(&ams, &template, &SearchConstraints::all());
    let answer = ask(agent, question, timeout).await?;
    let found = client::agents_result(&answer).map_err(Failure::no)?;
    let found = found.into_iter().find_map(|agent| agent.name);
    found.ok_or_else(|| Failure::no(format_args!("no agent {name} is attached to the daemon")))
}

async fn watch(args: &Subscribe) -> Result<(), Failure> {
    let interrupted = attached::interrupted()?;
    let (_platform, agent, df) = args.asked.agent().await?;
    let (template, constraints) = (args.wanted.template(), args.wanted.constraints(None));
    let tag = agent.name().clone();
    let subscribe = client::df_subscribe_request(&df, &template, &constraints)
        .conversation_id(tag.clone())
        .reply_with(tag);
    let outcomes = agent
        .send_within(subscribe.clone(), args.asked.timeout)
        .await;
    if let Some(failed) = outcomes.iter().find(|told| !told.outcome.is_success()) {
        return Err(Failure::no(format_args!(
            "{}: {}",
            failed.to, failed.reason
        )));
    }
    tokio::pin!(interrupted);
    loop {
        let message = tokio::select! {
            message = agent.receive() => message.map_err(Failure::environment)?,
            () = &mut interrupted => break,
        };
        let told = client::notification(&message).map_err(Failure::no)?;
        told.iter().try_for_each(|one| args.asked.show(one))?;
        warn_of_more(&df, &message);
    }
    let cancel = client::df_cancel_request(&df, &subscribe);
    agent.send_within(cancel, Duration::from_secs(1)).await;
    Ok(())
}

async fn join(args: &Federate) -> Result<(), Failure> {
    let platform = args.control.attach().await?;
    let agent = attached::register(&platform, &attached::own_name("df-"), None).await?;
    let df = AgentId::new(format!("df@{}", platform.name()));
    let parent = AgentId::new(args.parent.as_str());
    let question = match args.leave {
        true => client::df_leave_request(&df, &parent),
        false => client::df_federate_request(&df, &parent),
    };
    let answer = ask(&agent, question, args.timeout).await?;
    client::done(&answer).map_err(Failure::no)
}

fn to_json(description: &DfAgentDescription) -> Value {
    let services = description.services.iter().map(|service| {
        let properties = service.properties.iter().map(|property| {
            let value = property.value.as_ref().map(|term| match term.as_text() {
                Some(text) => text.to_string(),
                None => term.to_string(),
            });
            (property.name.to_string(), json!(value))
        });
        json!({
            "name": service.name.as_deref(),
            "type": service.kind.as_deref(),
            "properties": properties.collect::<Map<String, Value>>(),
        })
    });
    let mut json = Map::new();
    if let Some(name) = &description.name {
        json.insert("name".into(), agent_id_to_json(name));
    }
    json.insert("services".into(), services.collect());
    if let Some(until) = &description.lease_time {
        json.insert("lease-until".into(), until.to_string().into());
    }
    json.into()
}
