//! The resources that the daemon owns: the agent `locks@<name of the daemon>` lends them.

use std::sync::Arc;

use fipa::locks::{self, Forgetful, Keep, OwnError};
use fipa::{Agent, Error, Platform, Text};

use crate::fencing::{FencingError, FencingFile};
use crate::options::Options;

/// Why the daemon does not own what it is to own.
#[derive(Debug, thiserror::Error)]
pub(crate) enum OwnResourceError {
    #[error(transparent)]
    State(#[from] FencingError),
    #[error(transparent)]
    Agent(#[from] Error),
    #[error("{resource}: {source}")]
    Resource { resource: Text, source: OwnError },
}

/// Begins to own the resources of the options; whoever drops the agent ends it.
pub(crate) async fn own(
    platform: &Platform,
    options: &Options,
) -> Result<Option<Agent>, OwnResourceError> {
    if options.owns.is_empty() {
        return Ok(None);
    }
    let keep: Arc<dyn Keep> = match &options.state {
        Some(folder) => Arc::new(FencingFile::open(folder)?),
        None => {
            tracing::warn!(
                "--owns without --state: after a restart nobody knows what was lent, so that a \
                 resource may be lent to two, and its numbers grow only as long as the clock does"
            );
            Arc::new(Forgetful::new())
        }
    };
    let mut registration = locks::registration(format!("locks@{}", platform.name()));
    registration.description = Text::from(format!("owns {}", options.owns.join(", ")));
    let agent = platform.register(registration).await?;
    for resource in &options.owns {
        let resource = Text::from(resource.as_str());
        let owned = agent.own(resource.clone(), Arc::clone(&keep)).await;
        owned.map_err(|source| OwnResourceError::Resource { resource, source })?;
    }
    Ok(Some(agent))
}
