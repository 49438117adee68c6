//! The daemon at work: a platform with a control socket, until a signal ends it.

use std::io::{self, Write};
use std::sync::Arc;

use fipa::{Change, ChangeKind, Error, LetterTransport, Notice, Platform};
use serde_json::json;
use tokio::signal::unix::{SignalKind, signal};

use crate::hiac::{BindHiacError, HiacService};
use crate::letter_log::{LetterLog, OpenLogError};
use crate::locks::{self, OwnResourceError};
use crate::membership::{self, MembershipError, Watched};
use crate::options::Options;
use crate::text::{BindTextError, TextService};

/// Why the daemon does not run.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RunError {
    #[error(transparent)]
    Platform(#[from] Error),
    #[error(transparent)]
    Membership(#[from] MembershipError),
    #[error(transparent)]
    Text(#[from] BindTextError),
    #[error(transparent)]
    Hiac(#[from] BindHiacError),
    #[error(transparent)]
    Log(#[from] OpenLogError),
    #[error(transparent)]
    Owns(#[from] OwnResourceError),
}

/// Runs the daemon until SIGINT or SIGTERM.
pub(crate) async fn run(
    options: &Options,
    transports: &[Arc<dyn LetterTransport>],
) -> Result<(), RunError> {
    let mut interrupt = signal(SignalKind::interrupt()).map_err(Error::Runtime)?;
    let mut terminate = signal(SignalKind::terminate()).map_err(Error::Runtime)?;
    let mut fleet = membership::load(options)?;
    let platform = platform(options, transports, fleet.as_ref()).await?;
    let log = match &options.log_letters {
        Some(path) => Some(LetterLog::start(&platform, path)?),
        None => None,
    };
    let mut changes = platform.watch();
    let mut notices = platform.notices();
    let mut text = TextService::start(&platform, options).await?;
    let mut hiac = HiacService::start(&platform, options).await?;
    let _owner = locks::own(&platform, options).await?;
    say_ready(options, &platform, hiac.bound(), text.bound());
    loop {
        tokio::select! {
            _ = interrupt.recv() => break,
            _ = terminate.recv() => break,
            Some(change) = changes.next() => {
                say_conflict(options, &platform, &change);
                text.directory_changed(&change);
                hiac.directory_changed(&change);
            }
            Some(notice) = notices.next() => say_notice(options, &notice),
            () = look(&mut fleet, &platform) => {}
            () = text.run() => {}
            () = hiac.run() => {}
        }
    }
    hiac.end().await;
    tracing::info!("ends");
    platform.shutdown().await;
    if let Some(log) = log {
        log.wait().await;
    }
    Ok(())
}

/// Looks after the fleet, if there is one.
async fn look(fleet: &mut Option<Watched>, platform: &Platform) {
    match fleet {
        Some(fleet) => fleet.look(platform).await,
        None => std::future::pending().await,
    }
}

async fn platform(
    options: &Options,
    transports: &[Arc<dyn LetterTransport>],
    fleet: Option<&Watched>,
) -> Result<Platform, Error> {
    let mut builder = Platform::builder()
        .scope(&options.scope)
        .mdns(!options.no_mdns)
        .mdns_agents(options.mdns_agents)
        .mdns_port(options.mdns_port)
        .control(&options.control)
        .max_letter(options.max_letter);
    builder = builder.outbox(options.outbox.clone());
    if let Some(directory) = &options.state {
        builder = builder.state(directory);
    }
    builder = builder.rules(options.rules.clone());
    if let Some(fleet) = fleet {
        builder = builder.fleet(fleet.membership());
    }
    for transport in transports {
        builder = builder.transport(Arc::clone(transport));
    }
    if let Some(name) = &options.name {
        builder = builder.name(name);
    }
    for endpoint in &options.listen {
        builder = builder.listen(endpoint.to_string());
    }
    if let Some(endpoint) = &options.http {
        builder = builder.http(endpoint, &options.http_path);
    }
    for address in &options.advertise {
        builder = builder.advertise(address.to_string());
    }
    for peer in &options.peer {
        builder = builder.peer(peer.to_string());
    }
    for interface in &options.interface {
        builder = builder.interface(interface.clone());
    }
    builder.start().await
}

fn say_ready(options: &Options, platform: &Platform, hiac: &[String], text: &[String]) {
    let endpoints: Vec<String> = platform.endpoints().iter().map(|e| e.to_string()).collect();
    let http = platform.http_urls().first().map(|url| url.to_string());
    let name = platform.name();
    let control = options.control.display().to_string();
    if options.json {
        say(&json!({
            "event": "ready",
            "name": name.as_str(),
            "endpoints": endpoints,
            "http": http,
            "hiac": hiac,
            "text": text,
            "control": control,
        }));
    } else {
        let endpoints = endpoints.into_iter().chain(http);
        let endpoints = endpoints.collect::<Vec<_>>().join(" ");
        say(&format_args!(
            "{name} is ready at {endpoints}; programs attach at {control}"
        ));
    }
}

/// Two platforms hold the same agent name: loudly, once a time.
fn say_conflict(options: &Options, platform: &Platform, change: &Change) {
    if change.kind != ChangeKind::Conflict {
        return;
    }
    let name = &change.record.entry.name;
    tracing::error!("two platforms hold the agent name {name}: letters to it may go to either");
    if options.json {
        let agent = fipa_json::record_to_json(&change.record, platform.now());
        say(&json!({"event": "conflict", "agent": agent}));
    }
}

/// What somebody has to look at: another daemon bears our name, C++ robots cannot be told of an
/// agent, somebody is not let in, or gives cause for more notices than are told.
fn say_notice(options: &Options, notice: &Notice) {
    let event = match notice {
        Notice::Conflict { name, other } => {
            tracing::error!("{notice}: give one of them another --name");
            json!({"event": "conflict", "name": name.as_str(), "other": other.as_str()})
        }
        Notice::NotAnnounced { name, reason } => {
            tracing::warn!("{notice}");
            json!({"event": "not-announced", "name": name.as_str(), "reason": reason.as_str()})
        }
        Notice::Refused { who, reason } => {
            tracing::warn!("{notice}");
            json!({"event": "refused", "who": who.as_str(), "reason": reason.as_str()})
        }
        Notice::LeftOut { who, count } => {
            tracing::warn!("{notice}");
            json!({"event": "left-out", "who": who.as_str(), "count": count})
        }
        _ => return,
    };
    if options.json {
        say(&event);
    }
}

/// One line on standard output, at once. A daemon whose output nobody reads goes on.
fn say(line: &dyn std::fmt::Display) {
    let mut out = io::stdout().lock();
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}
