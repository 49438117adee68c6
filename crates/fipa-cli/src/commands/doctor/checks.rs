//! What follows from the evidence: checks, each with a verdict and what to do about it.
//!
//! **Never knows** a socket, a clock or the daemon: the evidence is a value.

mod backs;

use std::collections::BTreeMap;
use std::net::IpAddr;

use fipa::{Facts, GreetError, Greeting, InstanceId, InterfaceProbe, Multicast, PeerFacts};

use super::evidence::{Call, Evidence};

/// Clocks may differ by so much, in milliseconds.
const NEAR: u64 = 1_000;
/// From here on letters expire too early or too late.
const FAR: u64 = 30_000;

/// How a check went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    Ok,
    Warning,
    Failed,
}

impl State {
    /// The word that people and programs are shown.
    pub(super) fn as_str(self) -> &'static str {
        match self {
            State::Ok => "ok",
            State::Warning => "warning",
            State::Failed => "failed",
        }
    }
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Check {
    /// What was looked at: a word.
    pub(super) check: &'static str,
    pub(super) state: State,
    /// What was found.
    pub(super) said: String,
    /// What to do; `None` where all is well.
    pub(super) advice: Option<String>,
}

fn ok(check: &'static str, said: String) -> Check {
    Check {
        check,
        state: State::Ok,
        said,
        advice: None,
    }
}

fn warning(check: &'static str, said: String, advice: &str) -> Check {
    Check {
        check,
        state: State::Warning,
        said,
        advice: Some(advice.to_owned()),
    }
}

fn failed(check: &'static str, said: String, advice: &str) -> Check {
    Check {
        state: State::Failed,
        ..warning(check, said, advice)
    }
}

/// All checks, in the order in which a person would look.
pub(super) fn examine(evidence: &Evidence) -> Vec<Check> {
    let mut checks = vec![daemon(evidence)];
    checks.extend(interfaces(evidence));
    checks.extend(multicast(evidence));
    checks.extend(heard(evidence));
    checks.extend(evidence.own.iter().map(own_port));
    checks.extend(
        evidence
            .calls
            .iter()
            .flat_map(|call| called(evidence, call)),
    );
    checks.extend(evidence.backs.iter().flat_map(backs::called_back));
    checks.extend(links(evidence));
    checks.extend(names(evidence));
    checks.extend(doubles(evidence));
    checks.extend(unknown(evidence));
    checks
}

fn daemon(evidence: &Evidence) -> Check {
    match &evidence.daemon {
        Ok(facts) => ok(
            "daemon",
            format!("{} runs here, at {}", facts.name, facts.endpoints.join(" ")),
        ),
        Err(reason) => warning(
            "daemon",
            format!("{reason}; only the network is looked at"),
            "start fipad, or say by --control where it is",
        ),
    }
}

fn interfaces(evidence: &Evidence) -> Vec<Check> {
    let all = match &evidence.interfaces {
        Ok(all) => all,
        Err(reason) => {
            let advice = "run the doctor where the interfaces of this host can be listed";
            return vec![failed("interface", reason.clone(), advice)];
        }
    };
    let outer: Vec<&InterfaceProbe> = all.iter().filter(|i| !i.loopback).collect();
    if outer.is_empty() {
        let said = "this host has no address on any network".to_owned();
        return vec![warning("interface", said, "join the network of the robots")];
    }
    outer.iter().map(|i| interface(evidence, i)).collect()
}

fn interface(evidence: &Evidence, interface: &InterfaceProbe) -> Check {
    let addresses: Vec<String> = interface.addresses.iter().map(IpAddr::to_string).collect();
    let shown = format!("{} has {}", interface.name, addresses.join(" "));
    let Ok(facts) = &evidence.daemon else {
        return ok("interface", shown);
    };
    if listens_on(facts, interface) {
        return ok("interface", format!("{shown}; the daemon listens there"));
    }
    let strangers = evidence.heard().filter(|(heard_on, heard)| {
        let linked = |peer: &PeerFacts| is(peer, heard.instance) && peer.heard_millis.is_some();
        heard_on.name == interface.name
            && heard.scope == facts.scope.as_str()
            && !facts.peers.iter().any(linked)
    });
    let strangers: Vec<&str> = strangers.map(|(_, heard)| heard.name.as_str()).collect();
    if strangers.is_empty() {
        return ok(
            "interface",
            format!("{shown}; the daemon does not listen there"),
        );
    }
    failed(
        "interface",
        format!(
            "{shown}; {} is heard there, but the daemon listens at {} only",
            strangers.join(", "),
            facts.endpoints.join(" ")
        ),
        &format!(
            "start fipad with --listen {}:PORT, and name {} if --interface is used",
            addresses.first().map_or("ADDRESS", String::as_str),
            interface.name
        ),
    )
}

fn listens_on(facts: &Facts, interface: &InterfaceProbe) -> bool {
    let mut endpoints = facts.endpoints.iter();
    endpoints.any(|endpoint| interface.addresses.iter().any(|ip| is_at(endpoint, *ip)))
}

/// Whether a transport address is one of this host.
fn is_at(address: &str, ip: IpAddr) -> bool {
    match address.parse() {
        Ok(fipa::Address::Tcp { host, .. } | fipa::Address::Quic { host, .. }) => {
            host.parse() == Ok(ip)
        }
        _ => false,
    }
}

fn is(peer: &PeerFacts, instance: InstanceId) -> bool {
    peer.instance == Some(instance)
}

fn multicast(evidence: &Evidence) -> Vec<Check> {
    let interfaces = evidence.interfaces.iter().flatten();
    let sent = interfaces.flat_map(|i| [Some(sent(i)), sent_v6(i)]);
    let mut checks: Vec<Check> = sent.flatten().collect();
    let Ok(facts) = &evidence.daemon else {
        return checks;
    };
    if facts.mdns_port.is_none() {
        checks.push(warning(
            "multicast",
            "the daemon does without mDNS".to_owned(),
            "leave out --no-mdns, or give every robot an address of another one by --peer",
        ));
        return checks;
    }
    let is_heard = |peer: &PeerFacts| {
        peer.announced || evidence.heard().any(|(_, heard)| is(peer, heard.instance))
    };
    let unheard = facts
        .peers
        .iter()
        .filter(|peer| peer.heard_millis.is_some());
    for peer in unheard.filter(|peer| !is_heard(peer)) {
        checks.push(warning(
            "multicast",
            format!(
                "{} is linked at {}, but not heard by mDNS",
                peer.name,
                peer.addresses
                    .first()
                    .map_or("", |address| address.as_str())
            ),
            "the network between does not pass multicast, or it runs with --no-mdns: keep --peer",
        ));
    }
    checks
}

fn sent(interface: &InterfaceProbe) -> Check {
    let name = &interface.name;
    match &interface.multicast {
        Multicast::Works => ok("multicast", format!("{name} sends multicast and hears it")),
        Multicast::NotHeard => failed(
            "multicast",
            format!("multicast is blocked on {name}: what is sent does not come back"),
            "let UDP port 5353 in through the firewall of this host, or give --peer",
        ),
        Multicast::NotSent(reason) => failed(
            "multicast",
            format!("multicast is blocked on {name}: it cannot be sent: {reason}"),
            "let UDP port 5353 out through the firewall of this host, or give --peer",
        ),
        Multicast::Untried if interface.usable => ok(
            "multicast",
            format!("{name} has no IPv4 address, on which it could be tried"),
        ),
        Multicast::Untried => ok(
            "multicast",
            format!("{name} is down or leads to one host only, so no mDNS is spoken there"),
        ),
    }
}

/// Over IPv6; nothing where it was not tried.
fn sent_v6(interface: &InterfaceProbe) -> Option<Check> {
    let name = &interface.name;
    let (said, door) = match &interface.multicast_v6 {
        Multicast::Untried => return None,
        Multicast::Works => {
            let said = format!("{name} sends IPv6 multicast and hears it");
            return Some(ok("multicast", said));
        }
        Multicast::NotHeard => (
            format!("IPv6 multicast is blocked on {name}: what is sent does not come back"),
            "in",
        ),
        Multicast::NotSent(reason) => (
            format!("IPv6 multicast is blocked on {name}: it cannot be sent: {reason}"),
            "out",
        ),
    };
    Some(match interface.multicast {
        Multicast::Works => warning(
            "multicast",
            said,
            &format!(
                "robots find each other by IPv4 there; for IPv6 alone let UDP port 5353 {door} \
                 through the firewall of this host"
            ),
        ),
        _ => failed(
            "multicast",
            said,
            &format!(
                "let UDP port 5353 {door} through the firewall of this host, for IPv6 as well, or \
                 give --peer"
            ),
        ),
    })
}

fn heard(evidence: &Evidence) -> Vec<Check> {
    let facts = evidence.daemon.as_ref().ok();
    let checks = evidence.heard().map(|(interface, heard)| {
        let said = format!(
            "{} is heard on {} from {}, {} ms after it was asked",
            heard.name,
            interface.name,
            heard.from,
            heard.after.as_millis()
        );
        match facts {
            Some(facts) if heard.scope != facts.scope.as_str() => {
                let said = format!(
                    "{said}; its scope is {:?}, that of this daemon {:?}",
                    heard.scope,
                    facts.scope.as_str()
                );
                match &evidence.wanted {
                    Some(wanted) if wanted.name == heard.name => {
                        failed("heard", said, "give both daemons the same --scope")
                    }
                    _ => ok("heard", said),
                }
            }
            _ => ok("heard", said),
        }
    });
    checks.collect()
}

fn own_port(call: &Call) -> Check {
    let places = call.addresses.join(" ");
    match &call.result {
        Ok(_) => ok("port", format!("this daemon answers at {places}")),
        Err(error) => failed(
            "port",
            format!("this daemon does not answer at {places}, where it says it is: {error}"),
            "see that --advertise is an address of this host, and that its firewall lets it through",
        ),
    }
}

fn called(evidence: &Evidence, call: &Call) -> Vec<Check> {
    match &call.result {
        Ok(greeting) => {
            let mut checks = vec![ok(
                "port",
                format!("{} answers at {}", call.whom, greeting.address),
            )];
            checks.push(clock(&call.whom, greeting.clock_ahead_millis));
            checks.push(version(&call.whom, greeting.version));
            checks.extend(scope(evidence, greeting));
            checks
        }
        Err(GreetError::Mute) if call.other_make => {
            let said = format!(
                "{} takes letters at {}",
                call.whom,
                call.addresses.join(" ")
            );
            vec![ok("port", said)]
        }
        Err(error) => vec![no_answer(evidence, call, error)],
    }
}

fn no_answer(evidence: &Evidence, call: &Call, error: &GreetError) -> Check {
    let (whom, places) = (&call.whom, call.addresses.join(" "));
    let is_heard = evidence.heard().any(|(_, heard)| heard.name == *whom);
    match error {
        GreetError::Refused(_) => failed(
            "port",
            format!("{whom} is down: its host is there, but nobody listens at {places}"),
            "start fipad there, and see that it listens at this port",
        ),
        GreetError::Unreachable(reason) if is_heard => failed(
            "port",
            format!(
                "the port of {whom} is blocked: it is heard by mDNS, but not reached: {reason}"
            ),
            "let its TCP port in through the firewall of its host; fipad --listen ADDRESS:PORT fixes the port",
        ),
        GreetError::Unreachable(reason) => failed(
            "port",
            format!("{whom} is not reached: {reason}"),
            "see that its host is on and in the same network, and that its firewall lets the port in",
        ),
        GreetError::Keyless => failed(
            "scope",
            format!("{whom} lets in robots of its fleet only, and this one has no key of it"),
            "have both in one fleet (fipa key join), or neither",
        ),
        GreetError::Strange(reason) => failed(
            "version",
            format!("at {places} no fipad of this version answers: {reason}"),
            "see that the address is that of a fipad, and install the same version on both",
        ),
        error => failed(
            "port",
            format!("{whom} accepts the connection at {places} and does not answer: {error}"),
            "its daemon stands still, or the port belongs to another program: restart fipad there",
        ),
    }
}

fn clock(whom: &str, ahead_millis: i64) -> Check {
    let off = ahead_millis.unsigned_abs();
    let side = if ahead_millis < 0 { "behind" } else { "ahead" };
    if off <= NEAR {
        return ok("clock", format!("the clock of {whom} agrees within 1 s"));
    }
    let said = format!("the clock of {whom} is {} s {side} of ours", off / 1000);
    let advice = "set both clocks, best by NTP: reply-by and timestamps go by them";
    match off {
        ..=FAR => warning("clock", said, advice),
        _ => failed("clock", said, advice),
    }
}

fn version(whom: &str, version: u16) -> Check {
    if version == Greeting::VERSION {
        return ok("version", format!("{whom} speaks the same version"));
    }
    warning(
        "version",
        format!(
            "{whom} speaks version {version} of the link, this is version {}",
            Greeting::VERSION
        ),
        "install the same version on both",
    )
}

fn scope(evidence: &Evidence, greeting: &Greeting) -> Option<Check> {
    let facts = evidence.daemon.as_ref().ok()?;
    (facts.scope != greeting.scope).then(|| {
        failed(
            "scope",
            format!(
                "{} is of scope {:?}, this daemon of {:?}",
                greeting.name,
                greeting.scope.as_str(),
                facts.scope.as_str()
            ),
            "give both daemons the same --scope",
        )
    })
}

fn links(evidence: &Evidence) -> Vec<Check> {
    let facts = evidence.daemon.as_ref().ok();
    let called = |peer: &PeerFacts| {
        evidence.wanted.is_none()
            || evidence
                .calls
                .iter()
                .any(|call| matches!(&call.result, Ok(greeting) if is(peer, greeting.instance)))
    };
    let peers = facts.into_iter().flat_map(|facts| &facts.peers);
    let checks = peers.filter(|peer| called(peer)).map(|peer| {
        let name = match peer.name.as_str() {
            "" => peer
                .addresses
                .first()
                .map_or("", |address| address.as_str()),
            name => name,
        };
        match peer.heard_millis {
            Some(millis) => ok(
                "link",
                format!("the link with {name} is open; it was heard {millis} ms ago"),
            ),
            None => warning(
                "link",
                format!("there is no link with {name}: {}", peer.error),
                "it is dialled again by itself; see what is said of its port",
            ),
        }
    });
    checks.collect()
}

fn names(evidence: &Evidence) -> Vec<Check> {
    let Ok(facts) = &evidence.daemon else {
        return Vec::new();
    };
    let left_out = facts.left_out.iter().map(|(name, reason)| {
        warning(
            "names",
            format!("{name} is not announced to C++ robots: {reason}"),
            "give it a shorter or another name, or raise --mdns-agents; daemons know it all the same",
        )
    });
    let left_out: Vec<Check> = left_out.collect();
    match left_out.is_empty() {
        true => vec![ok("names", "all names fit into announcements".to_owned())],
        false => left_out,
    }
}

fn doubles(evidence: &Evidence) -> Vec<Check> {
    let mut daemons: BTreeMap<&str, Vec<InstanceId>> = BTreeMap::new();
    if let Ok(facts) = &evidence.daemon {
        daemons.insert(&facts.name, vec![facts.instance]);
        for peer in facts
            .peers
            .iter()
            .filter(|peer| peer.heard_millis.is_some())
        {
            daemons.entry(&peer.name).or_default().extend(peer.instance);
        }
    }
    for (_, heard) in evidence.heard() {
        let scope = evidence
            .daemon
            .as_ref()
            .ok()
            .map(|facts| facts.scope.as_str());
        if scope.is_none_or(|scope| scope == heard.scope) {
            daemons.entry(&heard.name).or_default().push(heard.instance);
        }
    }
    let twice = daemons.into_iter().filter_map(|(name, mut instances)| {
        instances.sort();
        instances.dedup();
        (instances.len() > 1).then(|| {
            failed(
                "duplicate",
                format!("{} daemons bear the name {name}", instances.len()),
                "give each of them another --name",
            )
        })
    });
    let agents = evidence.doubles.iter().map(|name| {
        failed(
            "duplicate",
            format!("more than one platform holds the agent name {name}"),
            "give one of these agents another name: letters may go to either",
        )
    });
    let found: Vec<Check> = twice.chain(agents).collect();
    match found.is_empty() {
        true => vec![ok("duplicate", "no name is held twice".to_owned())],
        false => found,
    }
}

fn unknown(evidence: &Evidence) -> Option<Check> {
    let wanted = evidence.wanted.as_ref().filter(|wanted| !wanted.known)?;
    let said = match &evidence.daemon {
        Ok(_) => format!(
            "{} is not heard, and the daemon does not know it",
            wanted.name
        ),
        Err(_) => format!("{} is not heard", wanted.name),
    };
    Some(failed(
        "peer",
        said,
        "see that fipad runs there with the same --scope and listens on this network; where \
         multicast does not pass, give --peer",
    ))
}

#[cfg(test)]
mod tests;
