//! The AMS and the DF of a platform in this process: agents that are reached by their names and
//! listed nowhere; and the agents of other platforms that their AMS lists.

mod host;
mod platforms;
mod view;

pub(crate) use host::{start, start_platform};

use bytes::Bytes;
use fipa_acl::Text;
use fipa_management::{ApDescription, ApService};
use fipa_sl::Term;

/// The transport service over HTTP (FIPA SC00084F).
const HTTP: Text = Text::from_static("fipa.mts.mtp.http.std");

/// The transport services of a platform where letters are posted to these URLs.
fn services(urls: Vec<Text>) -> Vec<ApService> {
    if urls.is_empty() {
        return Vec::new();
    }
    vec![ApService {
        name: HTTP,
        kind: HTTP,
        addresses: urls,
    }]
}

/// The description of a platform as one term of SL0, as JADE's tools read it.
pub(crate) fn description(name: &Text, urls: Vec<Text>) -> Bytes {
    let description = ApDescription {
        name: name.clone(),
        services: services(urls),
    };
    Bytes::from(Term::from(&description).to_string())
}
