//! From a letter taken in to one delivery a receiver.

use std::collections::HashSet;
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Received, Slots, Text};
use fipa_directory::{Address, Field, InstanceId, Now, Source};
use fipa_link::Outcome;
use smallvec::{SmallVec, smallvec};

use super::Mts;
use super::deliveries::{Origin, Target};
use super::dialects::Foreign;
use super::neighbours::owner_of;
use super::patterns::{Names, NoPattern};
use super::posting::preference;
use super::programs::Local;
use crate::Urgency;
use crate::machine::ConnId;
use crate::pieces::{Pieces, joined};

/// Stamps that a letter may bear before it is taken for one that travels in circles (SC00067F
/// section 4 leaves the number open).
pub(super) const MAX_HOPS: usize = 32;

/// Receivers for whom memory is kept.
const SPARE: usize = 16;

/// What the reason begins with when a letter travels in circles: nobody is told of that by a notice.
pub(super) const LOOP: &str = "the letter travels in circles: ";

/// The transport of letters that come over HTTP.
pub(super) const POSTED: &str = "http";

/// A letter as it came.
#[derive(Debug)]
pub(super) struct Inbound {
    /// Its octets, in parts that follow each other. They are passed on as they are.
    pub(super) parts: Pieces,
    pub(super) envelope: Envelope,
    /// Where the payload begins.
    pub(super) payload: usize,
    /// The service that passed it on to us.
    pub(super) from: Option<Text>,
    /// The transport by which it came.
    pub(super) via: Option<&'static str>,
    /// What the names of its receivers may be.
    pub(super) names: Names,
}

/// What its sender wants done with a letter.
#[derive(Debug)]
pub(super) struct Terms {
    /// How long the outcome is waited for.
    pub(super) timeout: Duration,
    /// After that the letter is not to be sent any more: its reply-by has passed.
    pub(super) expires: bool,
    /// The transports that are preferred.
    pub(super) transports: Vec<Text>,
    /// Whether a queue that is full is waited for.
    pub(super) patient: bool,
    /// In whose name the letter is, and how urgent it is: what decides on its turn in a queue.
    pub(super) sender: Text,
    pub(super) urgency: Urgency,
}

impl Terms {
    /// Nothing but how long the outcome is waited for.
    pub(super) fn within(timeout: Duration) -> Terms {
        Terms {
            timeout,
            expires: false,
            transports: Vec::new(),
            patient: false,
            sender: Text::default(),
            urgency: Urgency::default(),
        }
    }

    /// The same, and a queue that is full is waited for.
    pub(super) fn patient_within(timeout: Duration) -> Terms {
        Terms {
            patient: true,
            ..Terms::within(timeout)
        }
    }
}

/// A receiver, and what is to be done for it.
struct Resolved {
    to: AgentId,
    route: Route,
}

pub(super) enum Route {
    Mailbox,
    Program(ConnId),
    Peer(InstanceId),
    Neighbour,
    Addresses(Vec<Address>),
    /// It has just left, and may turn up elsewhere.
    Held,
    /// Its robot is away.
    Away,
    Nowhere(Outcome, Text),
}

impl Mts {
    /// Takes in a letter and starts a delivery to each agent that it is for. `origin` learns the
    /// outcomes once all are known.
    pub(super) fn take_in(&mut self, now: Now, origin: Origin, inbound: Inbound, mut terms: Terms) {
        if self.tap.is_some() {
            self.tap_letter(now, &inbound);
        }
        if inbound.envelope.stamps().count() >= MAX_HOPS {
            let reason = Text::from(format!("{LOOP}it has passed {MAX_HOPS} services"));
            self.answer_whole(now, origin, Outcome::Refused, reason);
            return;
        }
        let mut resolved = self.resolve_all(now, &inbound);
        if self.has_been_here(&inbound.envelope) {
            resolved.iter_mut().for_each(|one| self.end_circle(one));
        }
        for one in &mut resolved {
            let refusal = self.letter_refusal(&origin, &inbound.envelope, &one.to.name);
            if let Some(reason) = refusal {
                one.route = Route::Nowhere(Outcome::Refused, reason);
            }
        }
        if resolved.is_empty() {
            let reason = match inbound.envelope.intended_receiver() {
                [] => Text::from_static("the envelope names no receiver"),
                _ => Text::from_static("the pattern matches nobody but the sender"),
            };
            self.answer_whole(now, origin, Outcome::Unknown, reason);
            return;
        }
        terms.expires &= terms.timeout <= self.config.longest_wait;
        terms.timeout = terms.timeout.min(self.config.longest_wait);
        terms.urgency = Urgency::of(&inbound.envelope);
        let sender = inbound.envelope.from();
        terms.sender = sender.map(|from| from.name.clone()).unwrap_or_default();
        let pending = self.open_pending(origin, &resolved, |resolved| resolved.to.name.clone());
        for (slot, resolved) in resolved.into_iter().enumerate() {
            self.start(now, (pending, slot), &inbound, resolved, &terms);
        }
        self.keep_spare(inbound.envelope);
    }

    /// Keeps the memory of an envelope for the next one, unless it is much.
    fn keep_spare(&mut self, mut envelope: Envelope) {
        let lists = [&envelope.base.to, &envelope.base.intended_receiver];
        if lists.iter().all(|list| list.capacity() <= SPARE) {
            envelope.clear();
            self.spare = envelope;
        }
    }

    /// Whether we have stamped the letter before.
    fn has_been_here(&self, envelope: &Envelope) -> bool {
        let ours = |id: &Text| self.stamps.is_own(id.as_bytes());
        envelope
            .stamps()
            .any(|stamp| stamp.id.as_ref().is_some_and(ours))
    }

    /// A letter that came back is not passed on again. Its receiver may have come back as well.
    fn end_circle(&self, resolved: &mut Resolved) {
        if !matches!(resolved.route, Route::Mailbox | Route::Program(_)) {
            let reason = format!(
                "{LOOP}it came back to {}, where it has been before",
                self.config.name
            );
            resolved.route = Route::Nowhere(Outcome::Refused, Text::from(reason));
        }
    }

    /// Every agent that the letter is for, once each.
    fn resolve_all(&mut self, now: Now, inbound: &Inbound) -> SmallVec<[Resolved; 1]> {
        let sender = inbound.envelope.from().map(|from| &from.name);
        let receivers = inbound.envelope.intended_receiver();
        let mut resolve = |receiver| self.resolve(now, receiver, sender, inbound);
        if let [only] = receivers {
            return resolve(only);
        }
        let mut seen: HashSet<Text> = HashSet::new();
        let all = receivers.iter().flat_map(resolve);
        all.filter(|resolved| seen.insert(resolved.to.name.clone()))
            .collect()
    }

    /// Exact name first; then the addresses that the receiver brings along; then the services of
    /// its resolvers, which may know more names than we do (SC00067F: addresses first, then
    /// resolvers); then the name as mDNS announces it; then as an anchored pattern, which never
    /// matches the sender.
    fn resolve(
        &mut self,
        now: Now,
        receiver: &AgentId,
        sender: Option<&Text>,
        inbound: &Inbound,
    ) -> SmallVec<[Resolved; 1]> {
        let only = |to: AgentId, route| smallvec![Resolved { to, route }];
        if let Some(route) = self.route_to(&receiver.name) {
            return only(receiver.clone(), route);
        }
        let posted = inbound.via == Some(POSTED);
        if let Some(name) = self.local_in_another_case(receiver, posted)
            && let Some(route) = self.route_to(&name)
        {
            return only(AgentId::new(name), route);
        }
        let nowhere = |reason: String| {
            let route = Route::Nowhere(Outcome::Unknown, Text::from(reason));
            only(receiver.clone(), route)
        };
        let elsewhere = self.route_by_addresses(receiver, posted).or_else(|| {
            let mut resolvers = receiver.resolvers.iter();
            resolvers.find_map(|resolver| self.route_to_service_of(resolver, posted))
        });
        if let Some(route) = elsewhere {
            return only(receiver.clone(), route);
        }
        if self.is_moving(now, &receiver.name) {
            return only(receiver.clone(), Route::Held);
        }
        if self.is_away(now, &receiver.name) {
            return only(receiver.clone(), Route::Away);
        }
        if inbound.names == Names::Exact {
            let here = &self.config.name;
            return nowhere(format!("no agent of this name is known at {here}"));
        }
        if let Some(name) = self.announced_as(&receiver.name)
            && let Some(route) = self.route_to(&name)
        {
            return only(AgentId::new(name), route);
        }
        let of_stranger = inbound.names == Names::FewPatterns;
        let pattern = self.patterns.get(now.mono, &receiver.name, of_stranger);
        let pattern = match pattern {
            Ok(pattern) => pattern,
            Err(NoPattern::Wrong(error)) => {
                return nowhere(format!("no agent of this name is known, and {error}"));
            }
            Err(NoPattern::TooMany) => {
                let reason =
                    "no agent of this name is known, and patterns come too fast to be looked for";
                let route = Route::Nowhere(Outcome::Refused, Text::from_static(reason));
                return only(receiver.clone(), route);
            }
        };
        let mut names: Vec<&Text> = self
            .directory
            .search(&pattern, Field::Name)
            .map(|record| &record.entry.name)
            .collect();
        if names.is_empty() {
            return nowhere("no agent of this name is known".to_owned());
        }
        names.sort();
        names
            .into_iter()
            .filter(|name| Some(*name) != sender)
            .filter_map(|name| {
                let route = self.route_to(name)?;
                let to = AgentId::new(name);
                Some(Resolved { to, route })
            })
            .collect()
    }

    /// The agent that services of another make know by this name: mDNS has `?` for each `.`.
    pub(super) fn announced_as(&self, name: &str) -> Option<Text> {
        if !name.contains('?') {
            return None;
        }
        let same = |known: &str| {
            let mut octets = known.bytes().zip(name.bytes());
            known.len() == name.len() && octets.all(|(k, n)| k == n || k == b'.' && n == b'?')
        };
        let mut names = self.directory.iter().map(|record| &record.entry.name);
        names.find(|known| same(known)).cloned()
    }

    /// The agent here that is meant by an AID with one of our URLs, or in a letter that was posted
    /// here: JADE does not tell names apart that differ in case only.
    fn local_in_another_case(&self, receiver: &AgentId, posted: bool) -> Option<Text> {
        let mut urls = receiver.addresses.iter();
        let is_ours = |url: &Text| {
            let address = url.parse::<Address>();
            address.is_ok_and(|address| self.config.http.contains(&address))
        };
        if !posted && !urls.any(is_ours) {
            return None;
        }
        let mut locals = self.locals.keys();
        let same = |name: &&Text| name.eq_ignore_ascii_case(&receiver.name);
        locals.find(same).cloned()
    }

    /// Where a letter goes first that is to be tried at these addresses in turn: a link is looked for
    /// at the first one, unless letters are handed over there one by one.
    pub(super) fn target_at(&mut self, now: Now, addresses: &[Address]) -> Target {
        match addresses.first() {
            Some(first) if first.is_link() => {
                let links = addresses.iter().filter(|address| address.is_link());
                Target::Seed(self.seed_for(now, links.cloned().collect()))
            }
            _ => Target::Post,
        }
    }

    /// What was posted here is not posted on: its sender could post it there, and where the URL is
    /// one of ours that we do not know, it would only come back.
    fn route_by_addresses(&self, receiver: &AgentId, posted: bool) -> Option<Route> {
        let addresses: Vec<Address> = receiver
            .addresses
            .iter()
            .filter_map(|url| url.parse().ok())
            .filter(|address| !self.config.endpoints.contains(address))
            .filter(|address| !self.config.http.contains(address))
            .filter(|address| !(posted && address.is_http()) && self.is_spoken(address))
            .collect();
        (!addresses.is_empty()).then_some(Route::Addresses(addresses))
    }

    /// The way to the service at which a resolver is registered; it looks the receiver up in its
    /// own directory. A resolver here knows no more than we do, and one that is known by resolvers
    /// of its own only is not looked for.
    fn route_to_service_of(&self, resolver: &AgentId, posted: bool) -> Option<Route> {
        match self.route_to(&resolver.name) {
            Some(Route::Peer(instance)) => Some(Route::Peer(instance)),
            Some(_) => None,
            None => self.route_by_addresses(resolver, posted),
        }
    }

    pub(super) fn route_to(&self, name: &Text) -> Option<Route> {
        match self.locals.get(name) {
            Some(Local::Mailbox(_)) => return Some(Route::Mailbox),
            Some(Local::Program(conn)) => return Some(Route::Program(*conn)),
            None => {}
        }
        let Some(record) = self.directory.find(name) else {
            return self.route_to_management(name);
        };
        if record.source == Source::Local {
            return None;
        }
        if record.owner != owner_of(name) {
            return Some(Route::Peer(record.owner));
        }
        let peer = self.peer_at(&record.entry);
        Some(peer.map_or(Route::Neighbour, Route::Peer))
    }

    fn start(
        &mut self,
        now: Now,
        (pending, slot): (u64, usize),
        inbound: &Inbound,
        Resolved { to, route }: Resolved,
        terms: &Terms,
    ) {
        let name = to.name.clone();
        let id = self.id();
        let (target, addresses) = match route {
            // Those that wait for it go first.
            Route::Peer(_) | Route::Program(_) if self.outbox.has(&name) => (Target::Away, None),
            Route::Nowhere(outcome, reason) => {
                self.settle(now, pending, slot, outcome, None, reason);
                return;
            }
            Route::Mailbox if terms.patient && self.is_crowded(inbound, &name) => {
                (Target::Full, None)
            }
            Route::Mailbox => {
                let overlay = self.overlay(now, id, inbound, to);
                self.put_into_mailbox(now, pending, slot, inbound, overlay, &name);
                return;
            }
            Route::Program(conn) => (Target::Program(conn), None),
            Route::Peer(instance) => (Target::Peer(instance), None),
            Route::Neighbour => (Target::Post, Some(Vec::new())),
            Route::Addresses(mut addresses) => {
                addresses.sort_by_key(|at| preference(&at.to_text(), &terms.transports));
                (self.target_at(now, &addresses), Some(addresses))
            }
            Route::Held => (Target::Held, None),
            Route::Away => (Target::Away, None),
        };
        let overlay = self.overlay(now, id, inbound, to.clone());
        let mut parts = Pieces::new();
        match self.stamps.encode(&overlay) {
            Ok(head) => parts.push(head),
            Err(error) => {
                let reason = Text::from(error.to_string());
                self.settle(now, pending, slot, Outcome::Refused, None, reason);
                return;
            }
        }
        parts.extend(inbound.parts.iter().cloned());
        let foreign = addresses.map(|addresses| {
            Box::new(Foreign {
                // fipa_services delivers to nobody whom no layer names.
                overlay: Slots {
                    intended_receiver: vec![to.clone()],
                    ..overlay
                },
                envelope: inbound.envelope.clone(),
                to,
                from: inbound
                    .envelope
                    .from()
                    .map(|from| from.name.clone())
                    .unwrap_or_default(),
                parts: inbound.parts.clone(),
                payload: inbound.payload,
                addresses,
                transports: terms.transports.clone(),
            })
        });
        self.deliver(now, (id, pending, slot), target, parts, foreign, terms);
    }

    fn put_into_mailbox(
        &mut self,
        now: Now,
        pending: u64,
        slot: usize,
        inbound: &Inbound,
        overlay: Slots,
        name: &Text,
    ) {
        let mut envelope = inbound.envelope.clone();
        envelope.overlays.push(overlay);
        let letter = Letter {
            envelope,
            payload: joined(&inbound.parts, inbound.payload),
        };
        let via = Some(Text::from_static("local"));
        let Some(Local::Mailbox(mailbox)) = self.locals.get_mut(name) else {
            let reason = Text::from_static("the agent is not registered any more");
            self.settle(now, pending, slot, Outcome::Unknown, None, reason);
            return;
        };
        match mailbox.push(letter) {
            Ok(()) => {
                self.mail_has_come(now, name);
                self.settle(now, pending, slot, Outcome::Delivered, via, Text::default());
            }
            Err(full) => {
                let reason = Text::from(full.to_string());
                self.settle(now, pending, slot, Outcome::Refused, via, reason);
            }
        }
    }

    /// Whether a letter has to wait for room in the mailbox of an agent.
    fn is_crowded(&self, inbound: &Inbound, name: &Text) -> bool {
        let octets: usize = inbound.parts.iter().map(Bytes::len).sum();
        let full = match self.locals.get(name) {
            Some(Local::Mailbox(mailbox)) => !mailbox.has_room_for(octets - inbound.payload),
            _ => false,
        };
        full || self.backlog.has(name)
    }

    /// Our stamp, and the receiver that this copy is dedicated to where the letter had others.
    fn overlay(&mut self, now: Now, id: u64, inbound: &Inbound, to: AgentId) -> Slots {
        let dedicated = match inbound.envelope.intended_receiver() {
            [only] => *only == to,
            _ => false,
        };
        Slots {
            received: Some(Received {
                by: self.config.name.clone(),
                from: inbound.from.clone(),
                date: FipaTime::from_unix_millis(now.unix_millis),
                id: Some(self.stamps.id(id)),
                via: inbound.via.map(Text::from_static),
                user_defined: Vec::new(),
            }),
            intended_receiver: if dedicated { Vec::new() } else { vec![to] },
            ..Slots::default()
        }
    }
}
