use std::time::Duration;

use fipa_acl::Text;

/// What a [`LockAgent`](crate::LockAgent) is made with.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Config {
    /// The agent's name.
    pub name: Text,
    /// How often agents that depend on each other probe each other. A grant lasts three of these.
    pub heartbeat: Duration,
    /// The number of the first conversation. An agent that starts again must not use a
    /// conversation of its earlier life once more: draw it at random, or from the clock.
    pub first_conversation: u64,
    /// Agents that are asked for one resource, or wait for it, at most.
    pub max_participants: usize,
    /// Resources of which anything is kept, at most.
    pub max_resources: usize,
}

impl Config {
    /// The usual settings for an agent of this name: a heartbeat every five seconds.
    pub fn new(name: impl Into<Text>, first_conversation: u64) -> Config {
        Config {
            name: name.into(),
            heartbeat: Duration::from_secs(5),
            first_conversation,
            max_participants: 1024,
            max_resources: 256,
        }
    }
}
