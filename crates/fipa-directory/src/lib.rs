//! The directory of agents.
mod instance;
pub use instance::{InstanceId, ParseInstanceIdError};
