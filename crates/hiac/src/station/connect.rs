//! Setting up connections, and what their end takes with it.

use alloc::string::{String, ToString};
use alloc::vec::Vec;
use core::time::Duration;

use super::link::{Link, Partner, Recon, State};
use super::receive::Arrival;
use super::types::{Ended, Event, Failure, LinkId, Role};
use super::{Pair, Purpose, Station, expired};
use crate::content::STATION_LOST;
use crate::sys::{self, Outcome, Parameters, Subtype};
use crate::{Address, Addressing, Check, Content, Mask, Packet, PacketType};

/// The longest name in INCON and ACCON, and where they are checked by CRC-32: so they fit the
/// smallest packet.
const LONGEST_NAME: usize = 14;
const LONGEST_NAME_CRC32: usize = 11;

/// The shortest period that can be kept.
const SHORTEST_PERIOD: u16 = 20;

/// What an employee takes from an INCON or RECON.
struct Position {
    address: Address,
    mask: Mask,
    partner: Partner,
}

impl Station {
    /// Gives the employee of a link an address and begins to call it.
    pub(super) fn start_calling(&mut self, now: Duration, id: LinkId) {
        let Some(link) = self.links.get(&id) else {
            return;
        };
        let expected = self.transfers.expected_on(now, id, &link.config);
        let until = expected.map(|(_, until)| until);
        let given = expected.map(|(given, _)| given).or(link.config.address);
        let place = match given {
            Some(address) => self.group_of(address).map(|group| (group, address)),
            None => self.lowest_free(),
        };
        let workgroups = &self.config.workgroups;
        let place = place.and_then(|(group, peer)| Some((group, peer, workgroups.get(group)?)));
        let Some((group, peer, workgroup)) = place else {
            self.events.push_back(Event::ConnectionRefused {
                link: id,
                outcome: Outcome::REFUSED,
                reason: Some("there is no free address".to_string()),
            });
            return;
        };
        if let Some(link) = self.links.get_mut(&id) {
            link.role = Role::Employer;
            link.group = group;
            link.mask = Some(workgroup.mask);
            link.local = workgroup.address;
            link.peer = peer;
            link.state = State::Calling { next: now, until };
        }
        self.call(now, id);
    }

    /// The workgroup that an address is of.
    pub(super) fn group_of(&self, address: Address) -> Option<usize> {
        let mut groups = self.config.workgroups.iter();
        groups.position(|group| group.mask.same_subnetwork(group.address, address))
    }

    fn lowest_free(&self) -> Option<(usize, Address)> {
        let groups = 0..self.config.workgroups.len();
        let free = |group| Some((group, self.free_in(group, None)?));
        groups.into_iter().find_map(free)
    }

    /// This level of a workgroup if it is free, else the lowest free one.
    pub(super) fn free_in(&self, group: usize, level: Option<u32>) -> Option<Address> {
        let workgroup = self.config.workgroups.get(group)?;
        let levels = level.into_iter().chain(1..workgroup.mask.broadcast());
        let legal = |level: &u32| (1..workgroup.mask.broadcast()).contains(level);
        let addresses = levels
            .filter(legal)
            .filter_map(|level| workgroup.mask.address(workgroup.address, level));
        addresses.into_iter().find(|address| self.is_free(*address))
    }

    pub(super) fn is_free(&self, address: Address) -> bool {
        let employs = |link: &Link| {
            let active = link.state != State::Idle || link.config.address.is_some();
            let configured = link.config.address.unwrap_or(link.peer);
            let moves = link.recon.map(|recon| recon.peer);
            link.role == Role::Employer
                && active
                && (link.peer == address || configured == address || moves == Some(address))
        };
        !self.links.values().any(employs)
            && !self.config.aliases.contains(&address)
            && !self.transfers.is_promised(address)
    }

    /// Sends INCON or RECON where one is due.
    pub(super) fn call(&mut self, now: Duration, id: LinkId) {
        let period = self.config.period;
        let Some(link) = self.links.get_mut(&id) else {
            return;
        };
        let mut packets = Vec::new();
        match &mut link.state {
            State::Calling { until, .. } if until.is_some_and(|until| now >= until) => {
                link.state = State::Idle;
                self.not_passed_over(id);
                return;
            }
            State::Calling { next, .. } if now >= *next => {
                *next = now + period;
                packets.push((Subtype::Initialize, link.peer, link.peer, link.local));
            }
            _ => {}
        }
        if let Some(recon) = &mut link.recon
            && now >= recon.next
        {
            recon.next = now + period;
            packets.push((Subtype::Reinitialize, recon.peer, link.peer, link.local));
        }
        let mask = link.mask;
        // On a slow line the last one may still wait.
        if !link.queue.is_empty() && link.state != State::Connected {
            return;
        }
        for (subtype, given, target, source) in packets {
            let check = self.usual_check();
            let parameters = Parameters {
                address: Some(given),
                mask,
                role: Some(sys::EMPLOYER),
                ..self.own_parameters(check)
            };
            let packet = sys_packet(check, 0, subtype, (target, source), &parameters);
            self.push_packet(id, 0, packet);
        }
    }

    /// The check of INCON and RECON.
    pub(super) fn usual_check(&self) -> Check {
        match self.config.checks.has(Check::Sum) {
            true => Check::Sum,
            false => Check::Crc32,
        }
    }

    /// What INCON and ACCON tell of the own station.
    pub(super) fn own_parameters(&self, check: Check) -> Parameters<'_> {
        let longest = match check {
            Check::Sum => LONGEST_NAME,
            Check::Crc32 => LONGEST_NAME_CRC32,
        };
        let milliseconds = self.config.period.as_millis();
        let abilities = self.config.abilities;
        Parameters {
            period: Some(u16::try_from(milliseconds).unwrap_or(u16::MAX)),
            largest: Some(self.config.largest),
            checks: Some(self.config.checks),
            types: Some(self.config.types),
            name: self.config.name.as_deref().map(|name| cut(name, longest)),
            abilities: Some(abilities).filter(|able| *able != sys::NUMBERS | sys::FRAGMENTS),
            ..Parameters::default()
        }
    }

    fn push_connection(
        &mut self,
        id: LinkId,
        check: Check,
        subtype: Subtype,
        (target, source): Pair,
        parameters: &Parameters<'_>,
    ) {
        let packet = sys_packet(check, 0, subtype, (target, source), parameters);
        self.push_packet(id, 0, packet);
    }

    /// A connection packet came. Whether it was for this link, and not for a colleague.
    pub(super) fn connection(&mut self, now: Duration, arrival: &Arrival<'_>) -> bool {
        let Some((subtype, octets)) = arrival.data.split_first() else {
            return false;
        };
        let Some(link) = self.links.get(&arrival.link) else {
            return false;
        };
        let parameters = Parameters::decode(octets);
        let role = parameters.ok().and_then(|read| read.role);
        let to_own = arrival.target == link.local
            || link
                .recon
                .is_some_and(|recon| arrival.target == recon.local);
        let from_partner = arrival.source == link.peer;
        match (Subtype::new(*subtype), link.role) {
            (Some(Subtype::Initialize), Role::Employee) => {
                let unclear = parameters.is_err() && link.is_connected() && !from_partner;
                if role.unwrap_or(sys::EMPLOYER) != sys::EMPLOYER || unclear {
                    return false;
                }
                self.employed(now, arrival, parameters.ok());
            }
            (Some(Subtype::Initialize), Role::Employer) => {
                if role.unwrap_or(sys::EMPLOYER) != sys::EMPLOYER {
                    return false;
                }
                self.both_call(now, arrival, parameters.ok());
            }
            (Some(Subtype::Accept), Role::Employer) if to_own && role != Some(sys::COLLEAGUE) => {
                self.accepted(now, arrival, parameters.ok());
            }
            (Some(Subtype::Refuse), Role::Employer) if to_own && from_partner => {
                self.refused(arrival, parameters.ok());
            }
            (Some(Subtype::Refuse), Role::Employee) if to_own && from_partner => {
                if link.is_connected() {
                    self.end_connection(now, arrival.link, Ended::Removed, false);
                } else {
                    self.drops.unconnected += 1;
                }
            }
            (Some(Subtype::Reinitialize), Role::Employee) if link.is_connected() => {
                self.moved(now, arrival, parameters.ok());
            }
            _ => return false,
        }
        true
    }

    /// INCON came to an employee.
    fn employed(&mut self, now: Duration, arrival: &Arrival<'_>, read: Option<Parameters<'_>>) {
        match self.judge(now, arrival, read) {
            Ok(position) => self.take_position(now, arrival, position),
            Err((outcome, reason)) => self.refuse(arrival, outcome, reason),
        }
    }

    fn judge(
        &self,
        now: Duration,
        arrival: &Arrival<'_>,
        read: Option<Parameters<'_>>,
    ) -> Result<Position, (Outcome, &'static str)> {
        let own = self.links.get(&arrival.link);
        let again = own.is_some_and(|link| link.is_connected() && link.peer == arrival.source);
        if self.up.is_some() && !again {
            return Err((Outcome::REFUSED, "it has an employer"));
        }
        if self.transfers.awaits_other(now, arrival.source) {
            return Err((Outcome::REFUSED, "it passes over to another employer"));
        }
        let position = self.position(read, arrival.source)?;
        if position.address != arrival.target {
            return Err((Outcome::MALFORMED, "the address is not the target"));
        }
        Ok(position)
    }

    /// The position that the parameters give, under the employer at `source`.
    fn position(
        &self,
        read: Option<Parameters<'_>>,
        source: Address,
    ) -> Result<Position, (Outcome, &'static str)> {
        let malformed = |reason| (Outcome::MALFORMED, reason);
        let read = read.ok_or(malformed("a parameter is malformed"))?;
        let address = read.address.ok_or(malformed("the address is missing"))?;
        let mask = read.mask.ok_or(malformed("the mask is missing"))?;
        let level = mask.level(address);
        let employer = mask.address(address, 0);
        let fits = employer == Some(source)
            && (1..mask.broadcast()).contains(&level)
            && mask.address(source, level) == Some(address);
        if !fits {
            return Err(malformed("the address does not fit mask and source"));
        }
        let below = mask.bits().trailing_zeros();
        let inside = |bits: u32| bits.checked_shr(below).unwrap_or(0) == 0;
        let groups = self.config.workgroups.iter();
        if !groups.into_iter().all(|group| inside(group.mask.bits())) {
            return Err(malformed("its workgroup does not fit below this mask"));
        }
        if read.largest.is_some_and(|largest| largest < 64) {
            return Err(malformed("the largest packet is below 64 octets"));
        }
        let partner = Partner::of(&read);
        if partner.checks.common(self.config.checks).is_none() {
            return Err((Outcome::UNSUPPORTED, "there is no check in common"));
        }
        if read.period.is_some_and(|period| period < SHORTEST_PERIOD) {
            return Err((Outcome::UNSUPPORTED, "the period is below 20 ms"));
        }
        Ok(Position {
            address,
            mask,
            partner,
        })
    }

    fn take_position(&mut self, now: Duration, arrival: &Arrival<'_>, position: Position) {
        let id = arrival.link;
        if self.up == Some(id) {
            // The employer starts anew.
            self.end_connection(now, id, Ended::Lost, false);
        }
        let partner = Partner {
            period: position.partner.period.min(self.config.period),
            ..position.partner
        };
        let name = partner.name.clone();
        let Some(link) = self.links.get_mut(&id) else {
            return;
        };
        link.role = Role::Employee;
        link.mask = Some(position.mask);
        link.local = position.address;
        link.peer = arrival.source;
        link.connect(now, partner);
        self.up = Some(id);
        self.transfers.arrived();
        self.accept(arrival, position.address, position.mask);
        self.events.push_back(Event::Connected {
            link: id,
            role: Role::Employee,
            own: position.address,
            partner: arrival.source,
            name,
        });
        self.change_address(now, position.address);
    }

    fn accept(&mut self, arrival: &Arrival<'_>, address: Address, mask: Mask) {
        let parameters = Parameters {
            address: Some(address),
            mask: Some(mask),
            role: Some(sys::EMPLOYEE),
            ..self.own_parameters(arrival.check)
        };
        let ends = (arrival.source, address);
        let packet = sys_packet(arrival.check, 0, Subtype::Accept, ends, &parameters);
        self.push_packet(arrival.link, 0, packet);
    }

    pub(super) fn refuse(&mut self, arrival: &Arrival<'_>, outcome: Outcome, reason: &str) {
        let parameters = Parameters {
            result: Some(outcome),
            reason: Some(reason),
            ..Parameters::default()
        };
        let ends = (arrival.source, arrival.target);
        self.push_connection(
            arrival.link,
            arrival.check,
            Subtype::Refuse,
            ends,
            &parameters,
        );
    }

    /// Both ends want to employ the other.
    fn both_call(&mut self, now: Duration, arrival: &Arrival<'_>, read: Option<Parameters<'_>>) {
        let connected = self
            .links
            .get(&arrival.link)
            .is_some_and(Link::is_connected);
        let own = self.address;
        let holds_own =
            |mask: Mask| own.is_some_and(|own| mask.same_subnetwork(arrival.source, own));
        let theirs = read.and_then(|read| read.mask).is_some_and(holds_own);
        if connected || self.own_block_holds(arrival.source) || !theirs {
            self.refuse(arrival, Outcome::NOT_PERMITTED, "this end is the employer");
            return;
        }
        if let Some(link) = self.links.get_mut(&arrival.link) {
            link.role = Role::Employee;
            link.state = State::Idle;
            link.queue.clear(false);
        }
        self.employed(now, arrival, read);
    }

    /// Whether an address is of the block from which the own employees come.
    pub(super) fn own_block_holds(&self, address: Address) -> bool {
        let up = self.up.and_then(|up| self.links.get(&up));
        match up.and_then(|up| Some((up.mask?, up.local))) {
            Some((mask, own)) => mask.same_block(own, address),
            None => self.group_of(address).is_some(),
        }
    }

    /// ACCON came from an employee.
    fn accepted(&mut self, now: Duration, arrival: &Arrival<'_>, read: Option<Parameters<'_>>) {
        let (own, period) = (self.config.checks, self.config.period);
        let id = arrival.link;
        let (Some(read), Some(link)) = (read, self.links.get_mut(&id)) else {
            self.drops.unconnected += 1;
            return;
        };
        let repeats = |address| read.address == Some(address) && read.mask == link.mask;
        let partner = Partner::of(&read);
        let shortest = Duration::from_millis(SHORTEST_PERIOD.into());
        let partner = Partner {
            period: partner.period.clamp(shortest, period),
            largest: partner.largest.max(64),
            ..partner
        };
        let fits = partner.checks.common(own).is_some();
        let taken = match (link.state, link.recon) {
            (_, Some(recon)) if repeats(recon.peer) && arrival.source == recon.peer => {
                link.recon = None;
                link.local = recon.local;
                link.peer = recon.peer;
                let (own, partner) = (link.local, link.peer);
                self.events.push_back(Event::Moved {
                    link: id,
                    own,
                    partner,
                });
                true
            }
            (State::Calling { .. }, _)
                if fits && repeats(link.peer) && arrival.source == link.peer =>
            {
                let name = partner.name.clone();
                link.queue.clear(false);
                link.connect(now, partner);
                let event = Event::Connected {
                    link: id,
                    role: Role::Employer,
                    own: link.local,
                    partner: link.peer,
                    name,
                };
                self.events.push_back(event);
                self.transfers.connected(id);
                true
            }
            // It answers an INCON that was repeated.
            (State::Connected, _) => repeats(link.peer) && arrival.source == link.peer,
            _ => false,
        };
        match taken {
            true => self.heard.forget_link(id),
            false => self.drops.unconnected += 1,
        }
    }

    /// REFCON came from an employee.
    fn refused(&mut self, arrival: &Arrival<'_>, read: Option<Parameters<'_>>) {
        let Some(link) = self.links.get_mut(&arrival.link) else {
            return;
        };
        match link.state {
            // It has not yet been told that it passes over.
            State::Calling { until: Some(_), .. } => return,
            State::Calling { .. } => link.state = State::Idle,
            State::Connected if link.recon.is_some() => link.recon = None,
            _ => {
                self.drops.unconnected += 1;
                return;
            }
        }
        let outcome = read.and_then(|read| read.result);
        let reason = read.and_then(|read| read.reason);
        self.events.push_back(Event::ConnectionRefused {
            link: arrival.link,
            outcome: outcome.unwrap_or(Outcome::REFUSED),
            reason: reason.map(str::to_string),
        });
    }

    /// RECON came from the employer.
    fn moved(&mut self, now: Duration, arrival: &Arrival<'_>, read: Option<Parameters<'_>>) {
        let Some(link) = self.links.get(&arrival.link) else {
            return;
        };
        let (own, employer) = (link.local, link.peer);
        let new = read.and_then(|read| read.mask?.address(read.address?, 0));
        let known = arrival.source == employer || Some(arrival.source) == new;
        if arrival.target != own || !known {
            self.drops.unconnected += 1;
            return;
        }
        let position = match self.position(read, new.unwrap_or(employer)) {
            Ok(position) => position,
            Err((outcome, reason)) => return self.refuse(arrival, outcome, reason),
        };
        let period = position.partner.period.min(self.config.period);
        self.accept(arrival, position.address, position.mask);
        self.colleagues.retain(|(link, _), _| *link != arrival.link);
        if let Some(link) = self.links.get_mut(&arrival.link) {
            link.mask = Some(position.mask);
            link.local = position.address;
            link.peer = new.unwrap_or(employer);
            link.partner = Partner {
                period,
                ..position.partner
            };
            let event = Event::Moved {
                link: arrival.link,
                own: link.local,
                partner: link.peer,
            };
            self.events.push_back(event);
        }
        self.change_address(now, position.address);
    }

    /// The own address, and with it those of the workgroups; the employees keep their levels.
    fn change_address(&mut self, now: Duration, new: Address) {
        let Some(old) = self.address.replace(new).filter(|old| *old != new) else {
            return;
        };
        let change = |address: Address| Address(address.0 ^ old.0 ^ new.0);
        for group in &mut self.config.workgroups {
            group.address = change(group.address);
        }
        for alias in &mut self.config.aliases {
            *alias = change(*alias);
        }
        let mut ids = Vec::new();
        for (id, link) in &mut self.links {
            if link.role != Role::Employer {
                continue;
            }
            link.config.address = link.config.address.map(change);
            let (local, peer) = (change(link.local), change(link.peer));
            match link.state {
                State::Connected => {
                    link.recon = Some(Recon {
                        local,
                        peer,
                        next: now,
                    });
                }
                _ => (link.local, link.peer) = (local, peer),
            }
            ids.push(*id);
        }
        for id in ids {
            self.call(now, id);
        }
    }

    /// Removes an employee from the network.
    pub fn remove(&mut self, now: Duration, id: LinkId) {
        let Some(link) = self.links.get(&id) else {
            return;
        };
        if !(link.is_connected() && link.role == Role::Employer) {
            return;
        }
        let (ends, check) = ((link.peer, link.local), self.usual_check());
        self.end_connection(now, id, Ended::Removed, false);
        let parameters = Parameters {
            result: Some(Outcome::REFUSED),
            reason: Some("removed"),
            ..Parameters::default()
        };
        self.push_connection(id, check, Subtype::Refuse, ends, &parameters);
    }

    /// A connection is over; the stream goes, or the line is used again.
    pub(super) fn disconnect(&mut self, now: Duration, id: LinkId, reason: Ended, goes_on: bool) {
        self.end_connection(now, id, reason, false);
        let Some(link) = self.links.get(&id).filter(|_| goes_on) else {
            return;
        };
        match (link.config.closes, link.role) {
            (true, _) => self.events.push_back(Event::Close(id)),
            (false, Role::Employer) => self.start_calling(now, id),
            (false, Role::Employee) => {}
        }
    }

    /// Forgets what hung on a connection.
    pub(super) fn end_connection(
        &mut self,
        now: Duration,
        id: LinkId,
        reason: Ended,
        keep_packets: bool,
    ) {
        let Some(link) = self.links.get_mut(&id) else {
            return;
        };
        let connected = link.is_connected();
        let (role, peer, group) = (link.role, link.peer, link.group);
        link.state = State::Idle;
        link.recon = None;
        let gone = link.queue.clear(keep_packets);
        if self.up == Some(id) {
            self.up = None;
        }
        self.heard.forget_link(id);
        self.colleagues.retain(|(link, _), _| *link != id);
        for question in expired(&mut self.questions, |question| question.link == id) {
            self.fail(question.ticket, Failure::Lost);
        }
        for reading in expired(&mut self.readings, |reading| reading.link == id) {
            self.fail(reading.ticket, Failure::Lost);
        }
        for purpose in gone {
            self.failed(now, purpose, Failure::Lost);
        }
        self.forget_party(now, |party| party.link == id);
        self.transfers.link_lost(id);
        if !connected {
            return;
        }
        self.events.push_back(Event::Disconnected {
            link: id,
            role,
            partner: peer,
            reason,
        });
        if (role, reason) == (Role::Employer, Ended::Lost) {
            self.tell_lost(group, peer);
        }
    }

    /// Tells a workgroup that one of it is lost.
    fn tell_lost(&mut self, group: usize, lost: Address) {
        let octets = lost.octets();
        let signal = Content::Signal {
            number: STATION_LOST,
            arguments: &octets,
        };
        if let Some(workgroup) = self.config.workgroups.get(group).copied() {
            self.broadcast(workgroup, &signal, super::Options::default());
        }
    }

    /// The confirmed farewell of this station to its employer is written.
    pub(super) fn pass_over(
        &mut self,
        now: Duration,
        id: LinkId,
        employer: Address,
        place: Option<String>,
    ) {
        self.end_connection(now, id, Ended::Transferred, true);
        self.transfers.pass_over(now, employer);
        self.events.push_back(Event::PassOver { employer, place });
    }

    pub(super) fn push_purpose(
        &mut self,
        id: LinkId,
        priority: u8,
        octets: Vec<u8>,
        purpose: Purpose,
    ) {
        if let Some(link) = self.links.get_mut(&id) {
            link.queue.push_packet(priority, octets, purpose);
        }
    }
}

/// The octets of a SYS packet that is neither numbered nor confirmed, from PV to CHK.
pub(super) fn sys_packet(
    check: Check,
    priority: u8,
    subtype: Subtype,
    (target, source): Pair,
    parameters: &Parameters<'_>,
) -> Vec<u8> {
    let content = Content::System {
        subtype,
        parameters: *parameters,
    };
    let data = Station::data_of(&content).unwrap_or_default();
    let packet = Packet {
        check,
        ..Packet::new(
            PacketType::SYS,
            priority,
            Addressing::Full { target, source },
            &data,
        )
    };
    // It has no level addresses, a priority below 8 and few octets.
    let encoded = packet.encode(None);
    encoded
        .map(|encoded| encoded.octets().collect())
        .unwrap_or_default()
}

/// The beginning of a text, of whole characters.
fn cut(text: &str, octets: usize) -> &str {
    text.get(..text.floor_char_boundary(octets)).unwrap_or(text)
}
