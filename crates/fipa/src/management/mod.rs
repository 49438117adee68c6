//! The AMS and the DF of a platform in this process: agents that are reached by their names and
//! listed nowhere; and the agents of other platforms that their AMS lists.

mod host;
mod platforms;
mod view;

pub(crate) use host::{start, start_platform};

use bytes::Bytes;
use fipa_acl::Text;
use fipa_directory::Address;
use fipa_management::{ApDescription, ApService};
use fipa_mts::Mts;
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

/// Where letters are posted to a service: what others reach too, or else, for somebody on this host,
/// what only this host reaches. Who is told both may hand both on to another host.
pub(crate) fn urls(mts: &Mts, same_host: bool) -> Vec<Text> {
    let urls = mts.http_urls(false);
    if !urls.is_empty() || !same_host {
        return urls;
    }
    let is_loopback = |url: &Text| url.parse().is_ok_and(|url: Address| url.is_loopback());
    let (loopback, others): (Vec<Text>, Vec<Text>) =
        mts.http_urls(true).into_iter().partition(is_loopback);
    if others.is_empty() { loopback } else { others }
}

/// The description of a platform as one term of SL0, as JADE's tools read it.
pub(crate) fn description(name: &Text, urls: Vec<Text>) -> Bytes {
    let description = ApDescription {
        name: name.clone(),
        services: services(urls),
    };
    Bytes::from(Term::from(&description).to_string())
}
