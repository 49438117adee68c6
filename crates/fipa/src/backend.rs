//! What agents and directories need from a platform, whether it is in this process or a daemon.

use std::sync::Arc;
use std::time::Duration;

use fipa_directory::Now;
use fipa_mts::{Machine, Mts, Program};

use crate::node::{Hub, Node};

/// A running machine of either kind.
#[derive(Clone)]
pub(crate) enum Backend {
    Service(Arc<Node<Mts>>),
    Program(Arc<Node<Program>>),
}

impl Backend {
    /// Hands something to the machine, whichever it is.
    pub(crate) fn with<R>(&self, call: impl FnOnce(Now, &mut dyn Machine, &mut Hub) -> R) -> R {
        match self {
            Backend::Service(node) => node.with(|now, machine, hub| call(now, machine, hub)),
            Backend::Program(node) => node.with(|now, machine, hub| call(now, machine, hub)),
        }
    }

    /// Waits until every connection is closed, for so long at most.
    pub(crate) async fn wait_closed(&self, at_most: Duration) {
        let closed = async {
            match self {
                Backend::Service(node) => node.wait_closed().await,
                Backend::Program(node) => node.wait_closed().await,
            }
        };
        // Whoever does not take the goodbye is left behind.
        let _ = tokio::time::timeout(at_most, closed).await;
    }
}
