//! Who is who in a fleet: links prove the names of robots, names of agents that end in `@` and the
//! name of a robot are that robot's, and whoever has no key needs a rule of the operator.
//!
//! A name without a robot in it belongs to the robot that has it first, as long as it has it; who
//! claims it meanwhile gets it when it is free. So agents that move keep such names.

use std::collections::{BTreeMap, BTreeSet};
use std::net::IpAddr;

use bytes::Bytes;
use fipa_acl::{Envelope, Text};
use fipa_directory::{Address, Entry, InstanceId, Now, State};
use fipa_link::{Frame, Link, LinkConfig, Outcome, ReceiverOutcome};

use super::Mts;
use super::connections::{FarEnd, Partner};
use super::deliveries::Origin;
use crate::machine::{ConnId, Notice, RegisterError};
use crate::rules::{Action, Judgement, Request};

/// The goodbye to who has no key, where there is a fleet.
pub const FLEET: &str = "only links of the fleet are taken here";

/// The goodbye to a robot under a name that its certificate does not say.
pub(super) const NAME: &str = "the name is not that of the certificate";

/// Agents of other makes of which it was told that they are left out, at most.
const MAX_TOLD: usize = 1000;

/// What is known of the fleet, where there is one.
#[derive(Debug)]
pub(super) struct Fleet {
    /// The robots that there are: those known from the beginning, and those that were met.
    robots: BTreeSet<Text>,
    /// Names that others hold, and who would have them.
    claims: BTreeMap<(Text, InstanceId), Entry>,
    /// What is revoked, as all are told.
    revoked: Option<Bytes>,
    /// Agents of other makes that are left out, and of whom that was told.
    told: BTreeSet<Text>,
}

impl Fleet {
    pub(super) fn new(own: &Text, robots: &[Text]) -> Fleet {
        let robots = robots.iter().chain([own]).cloned();
        Fleet {
            robots: robots.collect(),
            claims: BTreeMap::new(),
            revoked: None,
            told: BTreeSet::new(),
        }
    }

    /// The robot to which the name of an agent belongs, if it says one that is known.
    fn robot_of(&self, name: &str) -> Option<&Text> {
        let ends = name
            .match_indices('@')
            .filter_map(|(at, _)| name.get(at + 1..));
        let mut robots = ends.chain([name]).filter_map(|end| self.robots.get(end));
        robots.next()
    }
}

/// Where a letter comes from, as far as that is proven.
struct Sender {
    robot: Option<Text>,
    address: Option<IpAddr>,
}

impl Mts {
    /// Whether somebody has not shown who they are, though there is a fleet.
    pub(super) fn is_keyless(&self, far: &FarEnd) -> bool {
        self.fleet.is_some() && far.identity.is_none()
    }

    /// Ends what would be a link, with somebody who is not told who we are.
    pub(super) fn refuse_link(&mut self, now: Now, conn: ConnId, far: FarEnd) {
        let remote = far.remote.clone();
        let config = LinkConfig::new(self.hello(now, far.same_host, false));
        let link = Link::refusal(config, now, FLEET);
        self.add_conn(conn, link, None, false, far);
        self.part_silently(conn, FLEET);
        self.refused(remote, "it has no key of the fleet".to_owned());
    }

    /// Why a link with somebody who gives this name is refused, if it is.
    pub(super) fn link_refusal(
        &mut self,
        conn: ConnId,
        instance: InstanceId,
        name: &Text,
    ) -> Option<&'static str> {
        self.fleet.as_ref()?;
        let open = self.conns.get(&conn)?;
        let (identity, remote) = (open.identity.clone(), open.remote.clone());
        let Some(identity) = identity else {
            let reason = format!("it has no key of the fleet; it calls itself {name}");
            self.refused(remote, reason);
            return Some(FLEET);
        };
        if identity != *name {
            let reason = format!("it has the certificate of {identity}, and calls itself {name}");
            self.refused(remote, reason);
            return Some(NAME);
        }
        let known = self
            .peers
            .get(instance)
            .and_then(|peer| peer.identity.clone());
        if let Some(known) = known.filter(|known| *known != identity) {
            let reason = format!("{identity} says that it is the running service of {known}");
            self.refused(remote, reason);
            return Some(NAME);
        }
        None
    }

    /// A robot of the fleet was met: names that are its own are taken from whoever else has them.
    pub(super) fn robot_met(&mut self, now: Now, robot: &Text) {
        let Some(fleet) = &mut self.fleet else {
            return;
        };
        if !fleet.robots.insert(robot.clone()) {
            return;
        }
        let names = self
            .neighbours
            .keys()
            .filter(|name| fleet.robot_of(name).is_some());
        for name in names.cloned().collect::<Vec<_>>() {
            self.neighbour_gone(now, &name);
        }
        let records = self
            .directory
            .iter()
            .filter(|record| record.owner != self.config.instance);
        let entries = records.map(|record| (record.owner, record.entry.clone()));
        for (owner, entry) in entries.collect::<Vec<_>>() {
            let Some(peer) = self.peers.get(owner) else {
                continue;
            };
            let Some(identity) = peer.identity.clone() else {
                continue;
            };
            if let Some(reason) = self.entry_refusal(&identity, &entry.name) {
                self.directory.remove(now, owner, &entry.name);
                self.refused(identity, reason);
            }
        }
    }

    /// Whether what a peer says of its agent is taken into the directory.
    pub(super) fn is_admitted(&mut self, instance: InstanceId, entry: &Entry) -> bool {
        let identity = self
            .peers
            .get(instance)
            .and_then(|peer| peer.identity.clone());
        let Some(robot) = identity.filter(|_| self.fleet.is_some()) else {
            let refusal = self.registration_refusal(entry);
            if let Some(reason) = &refusal {
                self.refused(self.peer_name(instance), reason.clone());
            }
            return refusal.is_none();
        };
        if let Some(reason) = self.entry_refusal(&robot, &entry.name) {
            self.refused(robot, reason);
            return false;
        }
        let Some(holder) = self.holder_of(instance, &entry.name) else {
            return true;
        };
        if let Some(fleet) = &mut self.fleet {
            let claim = (entry.name.clone(), instance);
            if fleet.claims.insert(claim, entry.clone()).is_none() {
                self.refused(robot, format!("{} is an agent of {holder}", entry.name));
            }
        }
        false
    }

    /// Why nobody may have an agent of this name, wherever it is.
    fn registration_refusal(&self, entry: &Entry) -> Option<String> {
        if self.config.rules.is_empty() {
            return None;
        }
        let request = Request {
            action: Action::Register,
            agent: &entry.name,
            to: None,
            robot: None,
            address: None,
            keyless: false,
        };
        match self.config.rules.judge(&request) {
            Judgement::Denied(rule) => Some(denied(rule, &entry.name, "register")),
            _ => None,
        }
    }

    /// Why a robot may not have an agent of this name, whoever else has one.
    fn entry_refusal(&self, robot: &Text, name: &Text) -> Option<String> {
        let request = Request {
            action: Action::Register,
            agent: name,
            to: None,
            robot: Some(robot),
            address: None,
            keyless: false,
        };
        let judged = self.config.rules.judge(&request);
        self.name_refusal(judged, robot, name, "register")
    }

    fn name_refusal(
        &self,
        judged: Judgement,
        robot: &Text,
        name: &str,
        action: &str,
    ) -> Option<String> {
        match judged {
            Judgement::Denied(rule) => Some(denied(rule, name, action)),
            Judgement::Allowed { by_name: true } => None,
            _ => {
                let owner = self.fleet.as_ref()?.robot_of(name)?;
                (owner != robot).then(|| format!("{name}{NAME_OF}{owner}, not of {robot}"))
            }
        }
    }

    /// The robot, of those that have shown who they are, that has an agent of this name.
    fn holder_of(&self, but: InstanceId, name: &Text) -> Option<Text> {
        let records = self.directory.find_all(name);
        let mut others = records.iter().filter(|record| record.owner != but);
        others.find_map(|record| {
            if record.owner == self.config.instance {
                return Some(self.config.name.clone());
            }
            let peer = self.peers.get(record.owner)?;
            let alive = peer.state != State::Gone;
            peer.identity.clone().filter(|_| alive)
        })
    }

    /// A peer claims a name no longer.
    pub(super) fn drop_claim(&mut self, instance: InstanceId, name: &Text) {
        if let Some(fleet) = &mut self.fleet {
            fleet.claims.remove(&(name.clone(), instance));
        }
    }

    /// A peer claims no name any longer.
    pub(super) fn drop_claims(&mut self, instance: InstanceId) {
        if let Some(fleet) = &mut self.fleet {
            fleet
                .claims
                .retain(|(_, claimant), _| *claimant != instance);
        }
    }

    /// A name is free: whoever claims it may have it now.
    pub(super) fn settle_claims(&mut self, now: Now, name: &Text) {
        let Some(fleet) = &mut self.fleet else {
            return;
        };
        let claims = fleet.claims.keys().filter(|(claimed, _)| claimed == name);
        let Some(claim) = claims.min().cloned() else {
            return;
        };
        let Some(entry) = fleet.claims.remove(&claim) else {
            return;
        };
        let instance = claim.1;
        if self.is_admitted(instance, &entry)
            && let Some(peer) = self.peers.get(instance)
        {
            let source = peer.source();
            self.directory.put(now, instance, source, entry);
        }
    }

    /// Why an agent here may not have this name.
    pub(super) fn local_refusal(&self, name: &Text) -> Option<RegisterError> {
        if self.fleet.is_none() && self.config.rules.is_empty() {
            return None;
        }
        let reason = self.entry_refusal(&self.config.name, name)?;
        Some(RegisterError::Refused(Text::from(reason)))
    }

    /// Why a letter from there may not go to this receiver.
    pub(super) fn letter_refusal(
        &self,
        origin: &Origin,
        envelope: &Envelope,
        to: &str,
    ) -> Option<Text> {
        if self.fleet.is_none() && self.config.rules.is_empty() {
            return None;
        }
        let sender = self.sender(origin);
        let from = envelope
            .from()
            .map(|from| from.name.clone())
            .unwrap_or_default();
        let keyless = self.fleet.is_some() && sender.robot.is_none();
        let request = Request {
            action: Action::Send,
            agent: &from,
            to: Some(to),
            robot: sender.robot.as_deref(),
            address: sender.address,
            keyless,
        };
        let judged = self.config.rules.judge(&request);
        if keyless && judged == Judgement::Silent {
            return Some(Text::from_static(NO_RULE));
        }
        let robot = sender
            .robot
            .unwrap_or_else(|| Text::from_static("whoever has no key"));
        self.name_refusal(judged, &robot, &from, "send")
            .map(Text::from)
    }

    fn sender(&self, origin: &Origin) -> Sender {
        let own = || Sender {
            robot: Some(self.config.name.clone()),
            address: None,
        };
        match origin {
            Origin::Ticket(_)
            | Origin::Program { .. }
            | Origin::Outbox(_)
            | Origin::Notice { .. } => own(),
            Origin::Peer { conn, .. } => {
                let open = self.conns.get(conn);
                Sender {
                    robot: open.and_then(|open| open.identity.clone()),
                    address: open.and_then(|open| address_in(&open.remote)),
                }
            }
            Origin::Caller { from, .. } => Sender {
                robot: None,
                address: address_in(from),
            },
        }
    }

    /// Why nothing at all is taken from somebody without a key.
    pub(super) fn keyless_refusal(&self, remote: &str) -> Option<&'static str> {
        let is_fleet = self.fleet.is_some();
        let admitted = self.config.rules.may_admit(address_in(remote));
        (is_fleet && !admitted).then_some(NO_RULE)
    }

    /// Why a letter may not leave to somebody without a key.
    pub(super) fn leave_refusal(
        &self,
        from: &str,
        to: &str,
        address: &Address,
    ) -> Option<&'static str> {
        self.fleet.as_ref()?;
        let request = Request {
            action: Action::Send,
            agent: from,
            to: Some(to),
            robot: Some(&self.config.name),
            address: ip_of(address),
            keyless: true,
        };
        match self.config.rules.judge(&request) {
            Judgement::Allowed { .. } => None,
            _ => Some(NO_RULE),
        }
    }

    /// Whether somebody without a key may be at an address that a letter brought along, where no
    /// robot of the fleet was found.
    pub(super) fn is_for_keyless(&self, seed: u64) -> bool {
        let Some(seed) = self.seeds.get(seed).filter(|_| self.fleet.is_some()) else {
            return false;
        };
        let mut addresses = seed.addresses.iter().filter_map(ip_of);
        let is_open = !seed.kept && !seed.myself && seed.instance.is_none();
        is_open && addresses.any(|ip| self.config.rules.may_admit(Some(ip)))
    }

    /// Whether an agent of another make is let into the directory.
    pub(super) fn is_neighbour_admitted(&mut self, entry: &Entry) -> bool {
        let keyless = self.fleet.is_some();
        if !keyless {
            return self.registration_refusal(entry).is_none();
        }
        let addresses = entry
            .locations
            .iter()
            .filter_map(|l| l.address.parse().ok());
        let addresses: Vec<Address> = addresses.collect();
        let admitted = |address: &Address| {
            let request = Request {
                action: Action::Register,
                agent: &entry.name,
                to: None,
                robot: None,
                address: ip_of(address),
                keyless,
            };
            matches!(self.config.rules.judge(&request), Judgement::Allowed { .. })
        };
        let free = self
            .fleet
            .as_ref()
            .is_none_or(|fleet| fleet.robot_of(&entry.name).is_none());
        if free && !addresses.is_empty() && addresses.iter().all(admitted) {
            return true;
        }
        let Some(fleet) = &mut self.fleet else {
            return true;
        };
        if fleet.told.len() < MAX_TOLD && fleet.told.insert(entry.name.clone()) {
            self.refused(entry.name.clone(), NO_RULE.to_owned());
        }
        false
    }

    /// Tells all robots what is revoked.
    pub(super) fn tell_revoked(&mut self, now: Now, list: Bytes) {
        let Some(fleet) = &mut self.fleet else {
            return;
        };
        if list.is_empty() || fleet.revoked.as_ref() == Some(&list) {
            return;
        }
        fleet.revoked = Some(list.clone());
        let linked = self.conns.iter().filter(|(_, open)| {
            open.identity.is_some() && matches!(open.partner, Partner::Daemon { .. })
        });
        for conn in linked.map(|(conn, _)| *conn).collect::<Vec<_>>() {
            self.send(now, conn, Frame::Revoked(list.clone()));
        }
    }

    /// Tells a robot that was just met what is revoked.
    pub(super) fn tell_newcomer_revoked(&mut self, now: Now, conn: ConnId) {
        if let Some(list) = self.fleet.as_ref().and_then(|fleet| fleet.revoked.clone()) {
            self.send(now, conn, Frame::Revoked(list));
        }
    }

    fn refused(&mut self, who: Text, reason: String) {
        let reason = Text::from(reason);
        self.notice(Notice::Refused { who, reason });
    }
}

/// Why somebody without a key is not heard.
const NO_RULE: &str = "it has no key of the fleet, and no rule of the configuration admits it";

/// In the middle of what is said of a name that belongs to another robot, and of a rule that denies.
const NAME_OF: &str = " is a name of ";
const DENIES: &str = " of the configuration denies ";

fn denied(rule: usize, name: &str, action: &str) -> String {
    format!("rule {rule}{DENIES}{name} to {action}")
}

/// Whether a letter was refused because of who sent it, here or at another service.
pub(super) fn is_ruled_out(told: &ReceiverOutcome) -> bool {
    let reasons = [NO_RULE, NAME_OF, DENIES];
    told.outcome == Outcome::Refused && reasons.iter().any(|why| told.reason.contains(why))
}

fn ip_of(address: &Address) -> Option<IpAddr> {
    match address {
        Address::Tcp { host, .. }
        | Address::Quic { host, .. }
        | Address::Http { host, .. }
        | Address::Other { host, .. } => host.parse().ok(),
        Address::Unix(_) => None,
    }
}

fn address_in(remote: &str) -> Option<IpAddr> {
    ip_of(&remote.parse().ok()?)
}
