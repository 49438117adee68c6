//! `fipa doctor`: why robots do not see each other.
//!
//! ```text
//!   daemon (facts), interfaces (mDNS), others (a greeting) ──▶ evidence ──▶ checks ──▶ lines
//! ```

mod checks;
mod evidence;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use fipa::{
    Address, Facts, Folder, GreetError, Greeting, InstanceId, InterfaceProbe, MDNS_PORT,
    Membership, Platform, State as Life, default_folder,
};
use serde_json::json;
use tokio::task::JoinSet;

use self::checks::{Check, State, examine};
use self::evidence::{Back, Call, Evidence, Wanted};
use crate::Failure;
use crate::attached::{self, Control, print_json, print_line};

/// How long answers are listened for.
const LISTEN: Duration = Duration::from_millis(2500);
/// Others that are called when nobody in particular is asked for, at most.
const MOST: usize = 64;

/// The options of `fipa doctor`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A daemon, an agent or an address that is not seen; without it everybody is looked at
    #[arg(value_name = "PEER")]
    peer: Option<String>,
    /// One JSON object a check
    #[arg(long)]
    json: bool,
    /// The UDP port of mDNS where no daemon tells it
    #[arg(long, value_name = "PORT", default_value_t = MDNS_PORT, hide = true)]
    mdns_port: u16,
    #[command(flatten)]
    control: Control,
}

/// Prints the checks; a "no" if any has failed.
pub fn run(args: &Args) -> Result<(), Failure> {
    attached::run(async {
        let checks = examine(&gather(args).await);
        checks.iter().try_for_each(|check| print(args, check))?;
        let failed = checks.iter().filter(|check| check.state == State::Failed);
        match failed.count() {
            0 => Ok(()),
            1 => Err(Failure::no("one check has failed")),
            failed => Err(Failure::no(format_args!("{failed} checks have failed"))),
        }
    })
}

fn print(args: &Args, check: &Check) -> Result<(), Failure> {
    let state = check.state.as_str();
    if args.json {
        return print_json(&json!({
            "check": check.check,
            "state": state,
            "said": check.said,
            "advice": check.advice,
        }));
    }
    print_line(format_args!("{state:7}  {:9}  {}", check.check, check.said))?;
    check
        .advice
        .iter()
        .try_for_each(|advice| print_line(format_args!("{:7}  {:9}  > {advice}", "", "")))
}

async fn gather(args: &Args) -> Evidence {
    let platform = args.control.try_attach().await;
    let daemon = match &platform {
        Ok(platform) => platform.facts().await.ok_or_else(|| {
            "the daemon does not say how it is: it stands still, or is of an older version".into()
        }),
        Err(error) => Err(error.to_string()),
    };
    let facts = daemon.as_ref().ok();
    let port = facts.and_then(|facts| facts.mdns_port);
    let port = port.unwrap_or(args.mdns_port);
    let interfaces = fipa::probe_mdns(port, LISTEN).await;
    let interfaces = interfaces.map_err(|error| error.to_string());
    let (others, wanted) = match &args.peer {
        Some(name) => {
            let heard = interfaces.as_deref().unwrap_or_default();
            let callee = whereabouts(name, facts, heard, platform.as_ref().ok());
            let known = !callee.places.is_empty();
            let others = known.then_some(callee);
            let name = name.clone();
            (others.into_iter().collect(), Some(Wanted { name, known }))
        }
        None => (everybody(facts, &interfaces), None),
    };
    let own = facts.map(own_places).unwrap_or_default();
    let (own, calls) = tokio::join!(call(own), call(others));
    let backs = match (&platform, facts) {
        (Ok(platform), Some(facts)) => {
            call_back(platform, linked(facts, wanted.as_ref(), &calls)).await
        }
        _ => Vec::new(),
    };
    Evidence {
        doubles: platform.as_ref().map(doubles).unwrap_or_default(),
        own,
        calls,
        backs,
        daemon,
        interfaces,
        wanted,
    }
}

/// Somebody to be called.
#[derive(Debug)]
struct Callee {
    whom: String,
    places: Vec<Address>,
    other_make: bool,
}

/// Each endpoint of the daemon by itself.
fn own_places(facts: &Facts) -> Vec<Callee> {
    let endpoints = facts.endpoints.iter();
    let parsed = endpoints.filter_map(|endpoint| {
        Some(Callee {
            whom: endpoint.to_string(),
            places: vec![endpoint.parse().ok()?],
            other_make: false,
        })
    });
    parsed.collect()
}

/// Where somebody is said to be.
fn whereabouts(
    name: &str,
    facts: Option<&Facts>,
    interfaces: &[InterfaceProbe],
    platform: Option<&Platform>,
) -> Callee {
    let agent = platform.and_then(|platform| platform.find(name));
    let owner = agent.as_ref().map(|record| record.owner);
    let peers = facts.into_iter().flat_map(|facts| &facts.peers);
    let peers = peers.filter(|p| p.name == name || p.instance.is_some() && p.instance == owner);
    let told = peers.flat_map(|peer| &peer.addresses);
    let mut places: Vec<Address> = told.filter_map(|a| a.parse().ok()).collect();
    let own = facts.map(|facts| facts.instance);
    let heard = interfaces.iter().flat_map(|interface| &interface.heard);
    let heard = heard.filter(|heard| heard.name == name && Some(heard.instance) != own);
    places.extend(heard.map(|heard| Address::tcp(heard.from.to_string(), heard.port)));
    if places.is_empty() {
        let locations = agent.iter().flat_map(|record| &record.entry.locations);
        places.extend(locations.filter_map(|location| location.address.parse().ok()));
    }
    if places.is_empty() {
        places.extend(name.parse::<Address>().ok());
    }
    let mut seen = BTreeSet::new();
    places.retain(|place| seen.insert(place.to_string()));
    Callee {
        whom: name.to_owned(),
        places,
        other_make: agent.is_some_and(|agent| is_other_make(agent.owner)),
    }
}

/// Whether no platform of ours vouches for an agent: its owner begins with eight octets of zero.
fn is_other_make(owner: InstanceId) -> bool {
    owner.as_bytes().starts_with(&[0; 8])
}

/// Everybody of whom the daemon or the network tells.
fn everybody(
    facts: Option<&Facts>,
    interfaces: &Result<Vec<InterfaceProbe>, String>,
) -> Vec<Callee> {
    let callee = |whom, places| Callee {
        whom,
        places,
        other_make: false,
    };
    let mut others: BTreeMap<String, Callee> = BTreeMap::new();
    for peer in facts.into_iter().flat_map(|facts| &facts.peers) {
        let places: Vec<Address> = peer.addresses.iter().flat_map(|a| a.parse()).collect();
        let name = match (peer.name.as_str(), places.first()) {
            ("", Some(place)) => place.to_string(),
            (name, _) => name.to_owned(),
        };
        let key = peer.instance.map_or(name.clone(), |i| i.to_string());
        others.insert(key, callee(name, places));
    }
    let own = facts.map(|facts| facts.instance);
    for heard in interfaces.iter().flatten().flat_map(|i| &i.heard) {
        // Another fleet is no business of ours.
        let ours = facts.is_none_or(|facts| facts.scope.as_str() == heard.scope);
        if ours && Some(heard.instance) != own {
            let place = Address::tcp(heard.from.to_string(), heard.port);
            let known = others.entry(heard.instance.to_string());
            let known = known.or_insert_with(|| callee(heard.name.clone(), Vec::new()));
            if !known.places.contains(&place) {
                known.places.push(place);
            }
        }
    }
    others.into_values().take(MOST).collect()
}

/// The daemons with which there are links, as far as the question is about them.
fn linked<'a>(
    facts: &'a Facts,
    wanted: Option<&Wanted>,
    calls: &[Call],
) -> impl Iterator<Item = (String, InstanceId)> + use<'a> {
    let answered = calls.iter().filter_map(|call| call.result.as_ref().ok());
    let answered: Vec<InstanceId> = answered.map(|greeting| greeting.instance).collect();
    let name = wanted.map(|wanted| wanted.name.clone());
    let open = facts
        .peers
        .iter()
        .filter(|peer| peer.heard_millis.is_some());
    let asked = open.filter_map(|peer| Some((peer.name.to_string(), peer.instance?)));
    asked
        .filter(move |(peer, instance)| match &name {
            Some(name) => name == peer || answered.contains(instance),
            None => true,
        })
        .take(MOST)
}

/// Has all of them call the daemon at once.
async fn call_back(
    platform: &Platform,
    whom: impl Iterator<Item = (String, InstanceId)>,
) -> Vec<Back> {
    let mut calls = JoinSet::new();
    for (whom, instance) in whom {
        let platform = platform.clone();
        calls.spawn(async move {
            let answer = platform.call_back(instance).await;
            Back { whom, answer }
        });
    }
    let mut backs = calls.join_all().await;
    backs.sort_by(|a, b| a.whom.cmp(&b.whom));
    backs
}

/// Agent names that more than one platform holds.
fn doubles(platform: &Platform) -> Vec<String> {
    let mut names: BTreeMap<String, usize> = BTreeMap::new();
    for record in platform.search(".*").unwrap_or_default() {
        if record.state != Life::Gone {
            *names.entry(record.entry.name.to_string()).or_default() += 1;
        }
    }
    let twice = names.into_iter().filter(|(_, holders)| *holders > 1);
    twice.map(|(name, _)| name).collect()
}

/// The fleet that this machine has joined.
fn fleet() -> Option<Arc<Membership>> {
    let folder = Folder::new(default_folder(|name| std::env::var_os(name))?);
    folder.membership().ok().map(Arc::new)
}

/// Robots of a fleet greet nobody else; who is in none greets everybody.
async fn greet(
    places: &[Address],
    fleet: Option<&Arc<Membership>>,
) -> Result<Greeting, GreetError> {
    if let Some(fleet) = fleet
        && let Ok(greeting) = fipa::greet_in_fleet(places, fleet).await
    {
        return Ok(greeting);
    }
    fipa::greet(places).await
}

/// Calls all of them at once.
async fn call(whom: Vec<Callee>) -> Vec<Call> {
    let mut calls = JoinSet::new();
    let fleet = fleet();
    for (number, callee) in whom.into_iter().enumerate() {
        let fleet = fleet.clone();
        calls.spawn(async move {
            let call = Call {
                result: greet(&callee.places, fleet.as_ref()).await,
                addresses: callee.places.iter().map(Address::to_string).collect(),
                whom: callee.whom,
                other_make: callee.other_make,
            };
            (number, call)
        });
    }
    let mut calls = calls.join_all().await;
    calls.sort_by_key(|(number, _)| *number);
    calls.into_iter().map(|(_, call)| call).collect()
}
