//! Tells others of the instances of a service type: announcements, answers and goodbyes (RFC 6762
//! sections 6 to 10).
//!
//! Whoever asks and knows something need not be told it again, in however many packets he says what
//! he knows: of fifty robots with twenty agents each, everybody knows more than fits into one.
//! There is nothing to probe for: a name that others have as well is told to people, not changed
//! behind their backs.
use std::collections::{BTreeMap, BTreeSet, HashSet, VecDeque};
use std::net::{Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use super::answer::{Asked, OneShot, Teller, Told, Want};
use super::packet::Record;
use super::{key, packet};

/// The pause between the two announcements (RFC 6762 section 8.3), and between two times that the
/// same is told to all (section 6).
const PAUSE: Duration = Duration::from_secs(1);
/// The pause between the two goodbyes.
const GOODBYE_PAUSE: Duration = Duration::from_millis(100);
/// The shortest time before an answer that others may give as well, the least random part of it,
/// and five times that is the longest (section 6).
const BEFORE_ANSWER: Duration = Duration::from_millis(20);
/// The time for the rest of what somebody knows already, and for each further packet of that
/// (section 7.2).
const BEFORE_ANSWER_TO_MANY: Duration = Duration::from_millis(400);
/// Nobody makes others wait for longer by going on and on.
const LONGEST_WAIT: Duration = Duration::from_secs(2);
/// Instances that are told of in one go, and the pause until the next: the sockets of others hold
/// a few hundred packets.
const BATCH: usize = 64;
const BETWEEN_BATCHES: Duration = Duration::from_millis(10);
/// Askers who wait for an answer, at most; of more than that it is not asked what they know.
const MOST_ASKERS: usize = 100;

/// The instances of one daemon.
#[derive(Debug)]
pub(crate) struct Responder {
    teller: Teller,
    /// The port of those who hear what all are told.
    port: u16,
    services: BTreeMap<String, Service>,
    askers: VecDeque<Asker>,
    /// When those are announced that are new.
    announce_at: Instant,
    random: fastrand::Rng,
    outputs: VecDeque<Send>,
}

/// A packet to be sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Send {
    /// To the group.
    ToAll(Vec<u8>),
    /// To one who asked.
    To(SocketAddr, Vec<u8>),
}

#[derive(Debug)]
struct Service {
    told: Told,
    leaves: bool,
    /// When it is announced, or says goodbye, and how often still.
    due: Option<Instant>,
    times: u8,
    /// When all were told of it last.
    sent: Option<Instant>,
}

/// Somebody who waits for an answer.
#[derive(Debug)]
struct Asker {
    from: SocketAddr,
    asked: Instant,
    due: Instant,
    types: bool,
    host: bool,
    instances: bool,
    named: BTreeSet<String>,
    known: HashSet<String>,
    /// Whether more of what he knows is to come.
    goes_on: bool,
}

impl Responder {
    /// A responder without instances; it hears at this port.
    pub(crate) fn new(teller: Teller, port: u16, seed: u64, now: Instant) -> Responder {
        Responder {
            teller,
            port,
            services: BTreeMap::new(),
            askers: VecDeque::new(),
            announce_at: now,
            random: fastrand::Rng::with_seed(seed),
            outputs: VecDeque::new(),
        }
    }

    /// Announces an instance, or what has changed of it.
    pub(crate) fn put(&mut self, now: Instant, told: Told) {
        if self.announce_at <= now {
            self.announce_at = now + self.before_answer();
        }
        let sent = self.services.remove(&key(&told.label)).and_then(|s| s.sent);
        let service = Service {
            due: Some(self.announce_at),
            times: 2,
            leaves: false,
            sent,
            told,
        };
        self.services.insert(key(&service.told.label), service);
    }

    /// Says goodbye to an instance.
    pub(crate) fn remove(&mut self, now: Instant, label: &str) {
        if let Some(service) = self.services.get_mut(&key(label)) {
            service.leaves = true;
            service.times = 2;
            service.due = Some(now);
        }
    }

    /// Says goodbye to all.
    pub(crate) fn remove_all(&mut self, now: Instant) {
        let stay = self.services.values_mut().filter(|service| !service.leaves);
        for service in stay {
            service.leaves = true;
            service.times = 2;
            service.due = Some(now);
        }
    }

    /// Announces all anew: there is somebody who may not have heard it.
    pub(crate) fn announce_anew(&mut self, now: Instant) {
        let at = now + self.before_answer();
        for service in self.services.values_mut().filter(|service| !service.leaves) {
            service.times = 2;
            service.due = Some(at);
        }
    }

    /// The addresses of this host are other ones now.
    pub(crate) fn set_addresses(&mut self, addresses: Vec<Ipv4Addr>) {
        self.teller.addresses = addresses;
    }

    /// Takes in a packet.
    pub(crate) fn handle_packet(&mut self, now: Instant, packet: &[u8], from: SocketAddr) {
        let Some((mut asked, one_shot)) = self.teller.read(packet) else {
            return self.leave_to_others(packet);
        };
        let services = &self.services;
        let is_there = |key: &String| services.get(key).is_some_and(|service| !service.leaves);
        asked.known.retain(is_there);
        asked.wants.retain(|want| match want {
            Want::Types | Want::Instances | Want::Host => services.values().any(|s| !s.leaves),
            Want::Instance(key) => is_there(key),
        });
        if from.port() != self.port {
            return self.answer_once(&asked, &one_shot, from);
        }
        if asked.wants.is_empty() {
            let mut askers = self.askers.iter_mut().rev();
            if let Some(asker) = askers.find(|asker| asker.goes_on && asker.from == from) {
                asker.add(now, asked);
            }
            return;
        }
        let due = now + self.before_answer();
        let crowded = self.askers.len() >= MOST_ASKERS;
        if !crowded {
            self.askers.push_back(Asker::new(from, now, due));
        }
        if let Some(asker) = self.askers.back_mut() {
            asker.add(now, asked);
            if crowded {
                asker.known.clear();
                asker.goes_on = false;
            }
        }
    }

    /// When something is due.
    pub(crate) fn poll_timeout(&self) -> Option<Instant> {
        let services = self.services.values().filter_map(|service| service.due);
        let askers = self.askers.iter().map(|asker| asker.due);
        services.chain(askers).min()
    }

    /// Does what is due.
    pub(crate) fn handle_timeout(&mut self, now: Instant) {
        self.announce(now);
        self.say_goodbye(now);
        let mut room = BATCH;
        for _ in 0..self.askers.len() {
            if let Some(mut asker) = self.askers.pop_front()
                && (asker.due > now || !self.answer(now, &mut asker, &mut room))
            {
                self.askers.push_back(asker);
            }
        }
    }

    /// The next packet.
    pub(crate) fn poll_output(&mut self) -> Option<Send> {
        self.outputs.pop_front()
    }

    fn before_answer(&mut self) -> Duration {
        BEFORE_ANSWER * self.random.u32(100..600) / 100
    }

    fn announce(&mut self, now: Instant) {
        let services = self.services.values_mut();
        let due = services.filter(|s| !s.leaves && s.due.is_some_and(|at| at <= now));
        let mut told = Vec::new();
        for (i, service) in due.enumerate() {
            if i >= BATCH {
                service.due = Some(now + BETWEEN_BATCHES);
                continue;
            }
            service.times -= 1;
            service.due = (service.times > 0).then_some(now + PAUSE);
            service.sent = Some(now);
            told.push(&service.told);
        }
        let packets = self.teller.tell(&told, None);
        self.outputs.extend(packets.into_iter().map(Send::ToAll));
    }

    fn say_goodbye(&mut self, now: Instant) {
        let services = self.services.values_mut();
        let due = services.filter(|s| s.leaves && s.due.is_some_and(|at| at <= now));
        let mut labels = Vec::new();
        for service in due {
            service.times -= 1;
            service.due = (service.times > 0).then_some(now + GOODBYE_PAUSE);
            labels.push(service.told.label.clone());
        }
        self.services
            .retain(|_, service| !service.leaves || service.times > 0);
        let packets = self.teller.say_goodbye(&labels);
        self.outputs.extend(packets.into_iter().map(Send::ToAll));
    }

    /// Says no second goodbye to an agent that somebody else has announced meanwhile: it has moved.
    fn leave_to_others(&mut self, answer: &[u8]) {
        if !self.services.values().any(|service| service.leaves) {
            return;
        }
        let records = packet::read(answer, &self.teller.service_type);
        for record in records.into_iter().flatten() {
            if let Record::Instance { label, ttl: 1.. } = record {
                let key = key(&label);
                let moved = |service: &Service| service.leaves && service.times < 2;
                if self.services.get(&key).is_some_and(moved) {
                    self.services.remove(&key);
                }
            }
        }
    }

    /// Answers somebody, unless all were told meanwhile what he asks for, as long as there is room
    /// for so many instances; whether that is done.
    fn answer(&mut self, now: Instant, asker: &mut Asker, room: &mut usize) -> bool {
        let mut told = Vec::new();
        let mut later = None;
        for (key, service) in &mut self.services {
            let wanted = asker.instances && !asker.known.contains(key) || asker.named.contains(key);
            let was_told = service.sent.is_some_and(|sent| sent > asker.asked);
            if !wanted || was_told || service.leaves {
                continue;
            }
            let free = service.sent.map_or(now, |sent| sent + PAUSE).max(now);
            if free == now && *room > 0 {
                *room -= 1;
                service.sent = Some(now);
                told.push(&service.told);
                continue;
            }
            let at = free.max(now + BETWEEN_BATCHES);
            later = Some(later.map_or(at, |later: Instant| later.min(at)));
        }
        let packets = self.teller.tell(&told, None);
        self.outputs.extend(packets.into_iter().map(Send::ToAll));
        if asker.types || asker.host {
            let packet = self.teller.tell_beside(asker.types, asker.host, None);
            self.outputs.extend(packet.map(Send::ToAll));
            (asker.types, asker.host) = (false, false);
        }
        asker.due = later.unwrap_or(asker.due);
        later.is_none()
    }

    /// Answers somebody who does not hear what all are told.
    fn answer_once(&mut self, asked: &Asked, one_shot: &OneShot, to: SocketAddr) {
        let wants = |want: Want| asked.wants.contains(&want);
        let instances = wants(Want::Instances);
        let services = self.services.iter().filter(|(key, service)| {
            let named = || wants(Want::Instance((*key).clone()));
            !service.leaves && (instances && !asked.known.contains(key) || named())
        });
        let told: Vec<&Told> = services.take(BATCH).map(|(_, s)| &s.told).collect();
        let mut packets = self.teller.tell(&told, Some(one_shot));
        let (types, host) = (wants(Want::Types), wants(Want::Host));
        if types || host {
            packets.extend(self.teller.tell_beside(types, host, Some(one_shot)));
        }
        let replies = packets.into_iter().map(|packet| Send::To(to, packet));
        self.outputs.extend(replies);
    }
}

impl Asker {
    fn new(from: SocketAddr, now: Instant, due: Instant) -> Asker {
        Asker {
            from,
            asked: now,
            due,
            types: false,
            host: false,
            instances: false,
            named: BTreeSet::new(),
            known: HashSet::new(),
            goes_on: false,
        }
    }

    /// Takes in more of what he asks and knows.
    fn add(&mut self, now: Instant, asked: Asked) {
        for want in asked.wants {
            match want {
                Want::Types => self.types = true,
                Want::Instances => self.instances = true,
                Want::Instance(key) => drop(self.named.insert(key)),
                Want::Host => self.host = true,
            }
        }
        self.known.extend(asked.known);
        self.goes_on = asked.truncated;
        if asked.truncated {
            let due = self.due.max(now + BEFORE_ANSWER_TO_MANY);
            self.due = due.min(self.asked + LONGEST_WAIT);
        }
    }
}

#[cfg(test)]
mod tests;
