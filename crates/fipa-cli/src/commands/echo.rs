//! `fipa echo`: an agent that answers.

use fipa::{Message, Performative};
use tokio::task::JoinSet;

use crate::Failure;
use crate::attached::{self, Control};

/// The options of `fipa echo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The agent's name, used as it is
    #[arg(long = "as", value_name = "NAME")]
    name: String,
    /// What others read about it in the directory
    #[arg(long, value_name = "TEXT")]
    description: Option<String>,
    #[command(flatten)]
    control: Control,
}

/// Answers under way at once; more wait in the mailbox.
const AT_ONCE: usize = 256;

/// Answers every REQUEST and QUERY-REF with an INFORM of the same content, until interrupted.
pub fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let interrupted = attached::interrupted()?;
        let platform = args.control.attach().await?;
        let agent = attached::register(&platform, &args.name, args.description.as_deref()).await?;
        attached::say_attached(&agent);
        let agent = std::sync::Arc::new(agent);
        let mut answers = JoinSet::new();
        tokio::pin!(interrupted);
        loop {
            let received = tokio::select! {
                received = agent.receive(), if answers.len() < AT_ONCE => received,
                Some(_) = answers.join_next() => continue,
                () = &mut interrupted => return Ok(()),
            };
            match received {
                Ok(message) => {
                    if let Some(answer) = answer(message) {
                        let agent = std::sync::Arc::clone(&agent);
                        answers.spawn(async move {
                            for outcome in agent.send(answer).await {
                                if !outcome.outcome.is_success() {
                                    eprintln!("the answer to {}: {}", outcome.to, outcome.reason);
                                }
                            }
                        });
                    }
                }
                Err(error @ fipa::ReceiveError::Unreadable { .. }) => eprintln!("{error}"),
                Err(error) => return Err(Failure::environment(error)),
            }
        }
    })
}

fn answer(message: Message) -> Option<Message> {
    let asked = matches!(
        message.performative,
        Performative::Request | Performative::QueryRef
    );
    let mut answer = message.reply(Performative::Inform);
    answer.content = message.content;
    (asked && !answer.receiver.is_empty()).then_some(answer)
}
