//! `fipa platform`: platforms of other makes.

use std::time::Duration;

use fipa::{Address, AgentId};
use fipa_management::client;

use super::df::ask;
use crate::Failure;
use crate::attached::{self, Control, print_line};

/// The options of `fipa platform`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub what: What,
}

/// The commands of `fipa platform`.
#[derive(Debug, clap::Subcommand)]
pub enum What {
    /// List the agents of a platform among those of the daemon, until that ends
    Add(Add),
}

/// The options of `fipa platform add`.
#[derive(Debug, clap::Args)]
pub struct Add {
    /// Where letters are posted to it: http://HOST:PORT/PATH, with #NAME if its name is not to be
    /// found out
    #[arg(value_name = "URL")]
    url: String,
    /// Seconds to wait for the platform
    #[arg(long, value_name = "S", default_value = "20", value_parser = attached::seconds)]
    timeout: Duration,
    #[command(flatten)]
    control: Control,
}

/// Has the daemon look after a platform; prints the platform's name.
///
/// # Errors
/// Exit code 1 if the platform does not answer, 2 if the URL is none.
pub fn run(args: &Args) -> Result<(), Failure> {
    let What::Add(args) = &args.what;
    match args.url.parse() {
        Ok(Address::Http { .. }) => attached::run(add(args)),
        Ok(_) => Err(Failure::malformed(format_args!(
            "{:?} is no http:// URL",
            args.url
        ))),
        Err(error) => Err(Failure::malformed(error)),
    }
}

async fn add(args: &Add) -> Result<(), Failure> {
    let platform = args.control.attach().await?;
    let agent = attached::register(&platform, &attached::own_name("platform-"), None).await?;
    let ams = AgentId::new(format!("ams@{}", platform.name()));
    let question = client::platform_request(&ams, &args.url);
    let answer = ask(&agent, question, args.timeout).await?;
    let name = client::platform_result(&answer).map_err(Failure::no)?;
    print_line(name)
}
