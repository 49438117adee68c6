//! The objects of the ontology, and how they look in SL.
//!
//! Reading takes a set for a sequence, knows parameters in any case, and passes over what it does
//! not know. Writing leaves empty lists out.

mod ams_description;
mod ap_description;
mod constraints;
mod df_description;
mod expected;
mod frame;

pub(crate) use ams_description::OBJECT as AMS_DESCRIPTION;
pub use ams_description::{AgentState, AmsAgentDescription};
pub use ap_description::{ApDescription, ApService};
pub(crate) use constraints::OBJECT as CONSTRAINTS;
pub use constraints::SearchConstraints;
pub use df_description::{DfAgentDescription, Property, ServiceDescription};
pub(crate) use df_description::{OBJECT as DF_DESCRIPTION, SERVICE as SERVICE_DESCRIPTION};
pub(crate) use expected::unexpected_parameter;
